"""Plans the motions for an identification: bounded, both ways, scaled to the belief.

Pulses in both directions grow until the shaft moves: they verify the torque's sign and find the
torque that overcomes friction. The program follows: a frequency sweep from fast and small to slow
and large about a soft spring, torque steps to and fro, and throws from each side, after which the
shaft coasts without torque.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from haptic_wall.controller.laws.program import Phase
from haptic_wall.controller.theory import critical_stiffness, max_virtual_damping

PULSE_S = 0.06
"""Length of a pulse [s]"""
PULSE = 0.02
"""Wanted travel during one pulse [rad]"""
COAST_S = 0.8
"""Longest coasting after a pulse [s]"""
SHAKE_S = 4.0
"""Length of the frequency sweep [s]"""
QUICKER = 6.0
"""Ratio of the sweep's first frequency to its last"""
STEP_S = 0.1
"""Half the length of a torque step [s]"""
COASTING_S = 0.8
"""Longest coasting after a throw [s]"""
COAST_TRAVEL, COAST = 0.8, 0.6
"""Travel of a throw over the way from one side to the other; that of the smaller throws over the
larger ones'"""
_BRAKED = 0.2
"""Least brake of a coast, over the Coulomb friction: a heavier weight does not stay where it is"""
_LOST = 2.0
"""Excursion at which the shaft is released, as a multiple of the reach. From one reach it is still
brought back: a motion that was too large ends there, and a smaller one begins."""


@dataclass(frozen=True, slots=True)
class Guess:
    """Parameters for scaling the motions."""

    inertia: float
    """[kg·m²]"""
    damping: float
    """[N·m·s/rad]"""
    coulomb: float
    """[N·m]"""
    delay: float
    """From a sample until its torque acts, in total [s]"""
    dead_band: float = 0.0
    """Torque that is missing of what is commanded; a coasting shaft is not braked by it [N·m]"""
    sine: float = 0.0
    """Torque of a weight against the shaft, over the sine of the angle from the start [N·m]"""
    cosine: float = 0.0
    """The same over the cosine: the torque that holds the weight at the start [N·m]"""

    def weight(self, begin: float, end: float) -> float:
        """Return the mean torque of the weight against the shaft from one angle to another [N·m].

        Args:
            begin: [rad], from the start.
            end: Another one [rad].
        """
        lifted = self.sine * (math.cos(begin) - math.cos(end))
        lifted += self.cosine * (math.sin(end) - math.sin(begin))
        return lifted / (end - begin)

    @property
    def heaviest(self) -> float:
        """Return the largest torque of the weight [N·m]; 0: there is none."""
        return math.hypot(self.sine, self.cosine)

    @property
    def lost(self) -> float:
        """Return the commanded torque that does not accelerate the shaft [N·m]."""
        return self.coulomb + self.dead_band


@dataclass(frozen=True, slots=True)
class Bounds:
    """Limits of the motions."""

    reach: float
    """Largest distance from the shaft's start [rad]"""
    torque: float
    """Largest torque [N·m]"""
    speed: float
    """Largest planned speed [rad/s]"""
    step: float
    """One count of the encoder [rad]"""
    period: float
    """Sampling period [s]"""


_WIDTH = 25.0
"""Angular frequency of the spring that moves the shaft somewhere [rad/s]"""


def first_pulse(guess: Guess, bounds: Bounds) -> float:
    """Return the torque [N·m] of a pulse that moves such a servo by about ``PULSE``."""
    speed = min(2.0 * PULSE / PULSE_S, bounds.speed)
    return min(guess.lost + guess.inertia * speed / PULSE_S, bounds.torque)


def pulses(forward: float, back: float, bounds: Bounds) -> list[Phase]:
    """Return a pulse each way, with coasting after each.

    Args:
        forward: Torque of the first [N·m].
        back: Torque of the second, counted the other way [N·m].
        bounds: The first pulse ends at a quarter of the reach.
    """
    coast = Phase(COAST_S, still_s=0.1, still_band=2.0 * bounds.step)
    return [
        Phase(PULSE_S, torque=forward, reach=0.25 * bounds.reach),
        coast,
        Phase(PULSE_S, torque=-back, reach=bounds.reach),
        coast,
    ]


def motions(guess: Guess, bounds: Bounds, amplitude: float) -> list[Phase]:
    """Return the program for the fit of the model.

    Args:
        guess: Parameters for scaling.
        bounds: Limits.
        amplitude: Wanted excursion to each side [rad].
    """
    return [
        *_shaking(guess, bounds, amplitude),
        *_steps(guess, bounds, amplitude),
        *_coasts(guess, bounds, amplitude),
    ]


def _shaking(guess: Guess, bounds: Bounds, amplitude: float) -> list[Phase]:
    """Return a sweep from fast to slow, so that its start throws the shaft aside only a little."""
    slow = min(2.0, bounds.speed / (math.tau * amplitude))
    torque, slow = _shaken(guess, amplitude, slow, 0.7 * bounds.torque)
    spring = _spring(guess, bounds, math.tau * 0.35 * slow)
    shake = Phase(
        SHAKE_S,
        stiffness=spring,
        torque=torque,
        bias=guess.cosine,
        wave="sine",
        from_hz=QUICKER * slow,
        to_hz=slow,
        reach=bounds.reach,
    )
    return [shake, _held(guess, bounds)]


def _shaken(guess: Guess, amplitude: float, hertz: float, limit: float) -> tuple[float, float]:
    """Return torque and frequency of a sine with this amplitude; slower where torque is lacking."""
    while True:
        w = math.tau * hertz
        friction = guess.damping * w * amplitude + 4.0 * guess.lost / math.pi
        torque = math.hypot(guess.inertia * w * w * amplitude, friction)
        if torque <= limit or hertz < 0.5:
            return min(torque, limit), hertz
        hertz *= 0.9


def _steps(guess: Guess, bounds: Bounds, amplitude: float) -> list[Phase]:
    """Return a motion there, back past the start, and there again, with four torque reversals."""
    torque = guess.lost + guess.inertia * amplitude / STEP_S**2
    torque = min(torque, 0.7 * bounds.torque, guess.lost + guess.inertia * bounds.speed / STEP_S)
    return [
        *(
            Phase(length * STEP_S, torque=way * torque, bias=guess.cosine, reach=bounds.reach)
            for way, length in ((1, 1), (-1, 2), (1, 2), (-1, 1))
        ),
        _held(guess, bounds),
    ]


def _coasts(guess: Guess, bounds: Bounds, amplitude: float) -> list[Phase]:
    """Return slow travel to each side, and throws across, after which the shaft coasts.

    No torque acts then: the friction is that of each direction by itself, without the part that
    grows with the gear's load. A weight brakes one throw and drives the other, which is weaker.
    """
    phases = []
    for side, share in ((1.0, 1.0), (-1.0, 1.0), (1.0, COAST), (-1.0, COAST)):
        way = COAST_TRAVEL * share * 2.0 * amplitude
        begin = -side * amplitude
        weight = side * guess.weight(begin, begin + side * way)
        brake = max(guess.coulomb + weight, _BRAKED * guess.coulomb)
        speed = min(math.sqrt(2.0 * way * brake / guess.inertia), bounds.speed)
        torque = guess.lost + guess.damping * speed / 2.0 + guess.inertia * speed / STEP_S
        torque = side * min(torque + weight, 0.7 * bounds.torque)
        reach, band = 2.0 * bounds.reach, 1.5 * bounds.step  # it starts from the other side
        phases += [
            _held(guess, bounds, begin),
            Phase(STEP_S, torque=torque, reach=reach),
            Phase(COASTING_S, reach=reach, still_s=0.05, still_band=band),
        ]
    return [*phases, _held(guess, bounds)]


def undamped_home(guess: Guess, bounds: Bounds) -> Phase:
    """Move the shaft back to its start without virtual damping, which could drive a vibration."""
    return replace(_held(guess, bounds), stiffness=_spring(guess, bounds, _WIDTH), damping=0.0)


def _held(guess: Guess, bounds: Bounds, center: float = 0.0) -> Phase:
    """Move the shaft somewhere at constant speed, by default home, and wait until it rests."""
    loop = (guess.inertia, guess.damping)
    ceiling = float(max_virtual_damping(*loop, bounds.period, guess.delay))
    damping = min(1.4 * guess.inertia * _WIDTH, 0.25 * ceiling)
    if bounds.step > 0.0:  # one encoder count makes a step of the torque
        damping = min(damping, 0.03 * bounds.torque * bounds.period / bounds.step)
    most = float(critical_stiffness(*loop, damping, bounds.period, guess.delay))
    return Phase(
        2.0,
        stiffness=min(guess.inertia * _WIDTH**2, 0.4 * most),
        damping=damping,
        center=center,
        speed=0.5,
        reach=_LOST * bounds.reach,
        still_s=0.03,
        still_band=1.5 * bounds.step + 1e-5,
    )


def _spring(guess: Guess, bounds: Bounds, width: float) -> float:
    """Return the stiffness [N·m/rad] for that angular frequency [rad/s], or the largest stable."""
    loop = (guess.inertia, guess.damping)
    most = float(critical_stiffness(*loop, 0.0, bounds.period, guess.delay))
    return min(guess.inertia * width**2, 0.4 * most)
