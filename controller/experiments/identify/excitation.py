"""The motions that a servo is identified from: bounded, both ways, scaled to what is believed.

First pulses, each way, that rise until the shaft moves: they prove the torque's sign and find the
torque that overcomes friction. Then the program: a shaking from quick and small to slow and large
about a soft spring, torque steps to and fro, and free swings about a spring after travelling to
each side.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from haptic_wall.controller.laws.program import Phase
from haptic_wall.controller.theory import critical_stiffness, max_virtual_damping

PULSE_S = 0.06
"""Length of a pulse [s]"""
PULSE = 0.02
"""How far one pulse should move the shaft while it lasts [rad]"""
COAST_S = 0.3
"""How long the shaft may coast after a pulse [s]"""
SHAKE_S = 4.0
"""Length of the shaking [s]"""
QUICKER = 6.0
"""How much quicker than at its end the shaking begins"""
STEP_S = 0.1
"""Half the length of a torque step [s]"""
SWING_S = 1.2
"""How long a swing is left alone [s]"""
_LOST = 2.0
"""So many times the reach away the shaft is let go. Once the reach it is still brought back from:
there a motion that threw it too far has ended, and a smaller one is to begin where it did."""


@dataclass(frozen=True, slots=True)
class Guess:
    """Parameters that the motions are scaled to."""

    inertia: float
    """[kg·m²]"""
    damping: float
    """[N·m·s/rad]"""
    coulomb: float
    """[N·m]"""
    delay: float
    """From a sample to its torque acting, in all [s]"""


@dataclass(frozen=True, slots=True)
class Bounds:
    """Limits that the motions keep to."""

    reach: float
    """Furthest from where the shaft is at the beginning [rad]"""
    torque: float
    """Largest torque [N·m]"""
    speed: float
    """Largest speed that is aimed at [rad/s]"""
    step: float
    """One count of the encoder [rad]"""
    period: float
    """Sampling period [s]"""


def first_pulse(guess: Guess, bounds: Bounds) -> float:
    """Torque [N·m] of a pulse that moves such a servo by about ``PULSE``."""
    speed = min(2.0 * PULSE / PULSE_S, bounds.speed)
    return min(guess.coulomb + guess.inertia * speed / PULSE_S, bounds.torque)


def pulses(torque: float, bounds: Bounds) -> list[Phase]:
    """A pulse each way, coasting after each.

    Args:
        torque: [N·m]
        bounds: The first pulse ends at a quarter of the reach.
    """
    coast = Phase(COAST_S, still_s=0.1, still_band=2.0 * bounds.step)
    return [
        Phase(PULSE_S, torque=torque, reach=0.25 * bounds.reach),
        coast,
        Phase(PULSE_S, torque=-torque, reach=bounds.reach),
        coast,
    ]


def motions(guess: Guess, bounds: Bounds, amplitude: float) -> list[Phase]:
    """The program that the model is fitted to.

    Args:
        guess: What it is scaled to.
        bounds: What it keeps to.
        amplitude: How far the shaft should come to each side [rad].
    """
    return [
        *_shaking(guess, bounds, amplitude),
        *_steps(guess, bounds, amplitude),
        *_swings(guess, bounds, amplitude),
    ]


def _shaking(guess: Guess, bounds: Bounds, amplitude: float) -> list[Phase]:
    """From quick to slow: so the beginning, which throws the shaft to one side, does so little."""
    slow = min(2.0, bounds.speed / (math.tau * amplitude))
    torque, slow = _shaken(guess, amplitude, slow, 0.7 * bounds.torque)
    spring = _spring(guess, bounds, math.tau * 0.35 * slow)
    shake = Phase(
        SHAKE_S,
        stiffness=spring,
        torque=torque,
        wave="sine",
        from_hz=QUICKER * slow,
        to_hz=slow,
        reach=bounds.reach,
    )
    return [shake, *_home(guess, bounds)]


def _shaken(guess: Guess, amplitude: float, hertz: float, limit: float) -> tuple[float, float]:
    """Torque and frequency of a sine that moves the shaft so far; slower where torque lacks."""
    while True:
        w = math.tau * hertz
        friction = guess.damping * w * amplitude + 4.0 * guess.coulomb / math.pi
        torque = math.hypot(guess.inertia * w * w * amplitude, friction)
        if torque <= limit or hertz < 0.5:
            return min(torque, limit), hertz
        hertz *= 0.9


def _steps(guess: Guess, bounds: Bounds, amplitude: float) -> list[Phase]:
    """There, back past the beginning, and there again: the torque turns four times."""
    torque = guess.coulomb + guess.inertia * amplitude / STEP_S**2
    torque = min(torque, 0.7 * bounds.torque, guess.coulomb + guess.inertia * bounds.speed / STEP_S)
    reach = bounds.reach
    return [
        Phase(STEP_S, torque=torque, reach=reach),
        Phase(2 * STEP_S, torque=-torque, reach=reach),
        Phase(2 * STEP_S, torque=torque, reach=reach),
        Phase(STEP_S, torque=-torque, reach=reach),
        *_home(guess, bounds),
    ]


def _swings(guess: Guess, bounds: Bounds, amplitude: float) -> list[Phase]:
    """To each side slowly, which shows friction alone, and let go at a spring."""
    width = min(12.0, bounds.speed / amplitude)
    spring = _spring(guess, bounds, width, friction_at=amplitude)
    phases = []
    for side in (1.0, -1.0):
        phases += [
            *_held(guess, bounds, side * amplitude),
            Phase(SWING_S, stiffness=spring, reach=bounds.reach),
        ]
    return [*phases, *_home(guess, bounds)]


def _home(guess: Guess, bounds: Bounds) -> list[Phase]:
    return _held(guess, bounds, 0.0)


def _held(guess: Guess, bounds: Bounds, center: float) -> list[Phase]:
    """Take the shaft somewhere at an even speed, and wait until it is still."""
    width = 25.0
    loop = (guess.inertia, guess.damping)
    ceiling = float(max_virtual_damping(*loop, bounds.period, guess.delay))
    damping = min(1.4 * guess.inertia * width, 0.25 * ceiling)
    if bounds.step > 0.0:  # a count of the encoder is a jump of the torque
        damping = min(damping, 0.03 * bounds.torque * bounds.period / bounds.step)
    most = float(critical_stiffness(*loop, damping, bounds.period, guess.delay))
    return [
        Phase(
            2.0,
            stiffness=min(guess.inertia * width**2, 0.4 * most),
            damping=damping,
            center=center,
            speed=0.5,
            reach=_LOST * bounds.reach,
            still_s=0.03,
            still_band=1.5 * bounds.step + 1e-5,
        )
    ]


def _spring(guess: Guess, bounds: Bounds, width: float, friction_at: float = 0.0) -> float:
    """Stiffness [N·m/rad] for a swing of that angular frequency, or what is stable.

    Args:
        guess: Of the servo.
        bounds: For the period.
        width: [rad/s]
        friction_at: Friction may help as much as it does at this amplitude [rad]; 0: not at all.
    """
    damping = guess.damping
    if friction_at > 0.0:
        damping += 4.0 * guess.coulomb / (math.pi * friction_at * width)
    most = float(critical_stiffness(guess.inertia, damping, 0.0, bounds.period, guess.delay))
    return min(guess.inertia * width**2, 0.4 * most)
