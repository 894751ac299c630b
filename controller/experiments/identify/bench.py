"""Moves a servo for its identification, and fits it: growing pulses first, then programs."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from haptic_wall.controller.errors import HapticWallError
from haptic_wall.controller.experiments.identify.excitation import (
    PULSE_S,
    Bounds,
    Guess,
    first_pulse,
    motions,
    pulses,
)
from haptic_wall.controller.experiments.identify.fit import Fit
from haptic_wall.controller.experiments.identify.fitting import NoFitError, rounding_of
from haptic_wall.controller.experiments.identify.motion import motion_of
from haptic_wall.controller.experiments.identify.output_error import Prior
from haptic_wall.controller.experiments.identify.servo_fit import fit_servo
from haptic_wall.controller.experiments.testbed import (
    ExperimentTrippedError,
    Played,
    Testbed,
)
from haptic_wall.controller.laws.program import Phase

_STRONGER = 1.5
"""Factor between a pulse that did not move the shaft and the next one"""
_MOVED = 6
"""Counts by which a pulse must move the shaft"""
_MOVED_RAD = 0.005
"""The same without an encoder step [rad]"""
_FRICTION_SHARE = 0.4
"""Largest fraction of the torque limit that friction may take"""
_TRIES = 3
_HEAVY = 0.1
"""Least weight that the motions are planned for, over the Coulomb friction"""
_SOFTER = 0.6
"""Factor on the size of a program that went too far"""
_ONE_WAY = 3
"""Number of growing pulses of both signs that may turn the shaft the same way, as a weight makes
them do"""
SPOILT = 3.0
"""Residual without noise, over the rounding's, from which a motion is repeated: the shaft was
disturbed"""


class UnidentifiableError(HapticWallError):
    """The servo does not fit the model, or does not move as it must."""


class Bench:
    """Executes the motions, repeats them smaller where necessary, and keeps the logs' names.

    Attributes:
        delay_steps: Periods that are inserted between a torque's command and its sending.
        logs: Paths of all logs so far.
    """

    def __init__(
        self,
        testbed: Testbed,
        bounds: Bounds,
        tell: Callable[[str], None],
        priors: Mapping[str, Prior] | None = None,
    ) -> None:
        self._testbed = testbed
        self._bounds = bounds
        self._tell = tell
        self._priors = priors
        self._age = self._start = 0.0
        self.delay_steps = 0
        self.logs: list[Path] = []

    def find_moving_torque(self, guess: Guess) -> Guess:
        """Find the friction with growing pulses, until the shaft follows the torque both ways."""
        bounds = self._bounds
        least = max(_MOVED * bounds.step, _MOVED_RAD)
        # Each way by itself: a weight makes one need more than the other.
        torques = [first_pulse(guess, bounds)] * 2
        tried: list[float] = []
        one_way = 0
        while True:
            strongest = max(torques)
            self._tell(f"pulses of {' and '.join(f'{t:.3g}' for t in dict.fromkeys(torques))} N·m")
            phases = pulses(torques[0], torques[1], bounds)
            played = self.play(f"pulse-{len(tried) + 1}", phases)
            furthest = _furthest(played)
            if furthest > bounds.reach:
                raise UnidentifiableError(
                    f"a pulse of {strongest:.3g} N·m sent the shaft {furthest:.2g} rad away",
                    wanted=f"at most {bounds.reach:.2g} rad: a weight, a spring or a hand moves it "
                    "too, or its inertia is far below model.inertia",
                    advice="free the shaft, or correct model.inertia",
                )
            moved = [_moved(played, pulse) for pulse in (0, 2)]
            tried.append(strongest)
            if min(map(abs, moved)) >= least:
                one_way += moved[0] * moved[1] > 0.0
                if moved[0] * moved[1] < 0.0 or one_way > _ONE_WAY:
                    break
            if strongest >= bounds.torque:
                raise _unmoved(tried, moved, bounds)
            weak = [abs(way) < least for way in moved]
            torques = [
                min(_STRONGER * torque, bounds.torque) if each or not any(weak) else torque
                for torque, each in zip(torques, weak, strict=True)
            ]
        _check_sign(moved, strongest)
        # Driven for PULSE_S, then decelerated by friction alone: u (u - c) / c = 2 m x / t².
        ways = [abs(_moved(played, pulse, coast=True)) for pulse in (0, 2)]
        friction = 0.5 * sum(
            torque**2 / (torque + 2.0 * guess.inertia * way / PULSE_S**2)
            for torque, way in zip(torques, ways, strict=True)
        )
        if friction > _FRICTION_SHARE * bounds.torque:
            raise UnidentifiableError(
                f"friction takes {friction:.2g} N·m of the torque limit of {bounds.torque:.2g} N·m",
                wanted=f"at most {_FRICTION_SHARE:g} of it, so that the rest can move the shaft",
                advice="raise servo.torque_limit if the servo allows more, or free the shaft",
            )
        return Guess(guess.inertia, guess.damping, friction, guess.delay)

    def fitted(
        self, name: str, guess: Guess, amplitude: float, *, rough: bool = False
    ) -> tuple[Played, Fit]:
        """Execute a program within the reach, and fit the model to its motion.

        A motion is repeated if it was too large or too small, or, unless the fit is rough, if it
        does not fit.

        Args:
            name: Name of the log.
            guess: Parameters for scaling the motions.
            amplitude: Wanted excursion to each side [rad].
            rough: The fit is for scaling other motions.

        Raises:
            UnidentifiableError: It stays too large, or cannot be fitted.
        """
        bounds = self._bounds
        rounding = rounding_of(bounds.step)
        furthest, unfit = 0.0, ""
        best: tuple[Played, Fit] | None = None
        for attempt in range(1, _TRIES + 1):
            self._tell(f"motions of about {amplitude:.2g} rad to each side")
            label = name if attempt == 1 else f"{name}-{attempt}"
            try:
                played = self.play(label, motions(guess, bounds, amplitude))
            except ExperimentTrippedError as error:
                if not error.of_motion or attempt == _TRIES:
                    raise
                # As where a load vibrates at a frequency of the motions.
                self._tell(f"{error.stop_reason}; a smaller motion")
                amplitude = _SOFTER * amplitude
                continue
            furthest = _furthest(played)
            self._age = float(np.median(played.rows["age_ns"])) * 1e-9
            self._start = float(played.rows["position"][0])
            try:
                motion = motion_of(played.rows)
                fit = fit_servo(motion, bounds.step, self._priors, rough=rough)
            except NoFitError as error:
                unfit = f"the motion in {played.log} cannot be fitted: {error}"
                self._tell(f"{unfit}; once more")
                continue
            if furthest > bounds.reach:
                guess, amplitude = self.corrected(fit), _SOFTER * amplitude
                continue
            if rough or best is not None or fit.smooth_part(rounding) <= SPOILT * rounding:
                return min((best or (played, fit), (played, fit)), key=lambda b: b[1].residual)
            best = (played, fit)
            self._tell(
                "the model does not explain the motion, perhaps because the shaft was touched;"
                " once more"
            )
        if best is not None:
            return best
        if unfit and furthest <= bounds.reach:
            raise UnidentifiableError(
                f"{unfit}, in {_TRIES} tries",
                advice="free the shaft, and give a larger --reach or servo.torque_limit",
            )
        raise UnidentifiableError(
            f"the shaft was driven {furthest:.2g} rad away in {_TRIES} tries",
            wanted=f"at most {bounds.reach:.2g} rad",
            advice="give a larger --reach, or free the shaft"
            if not guess.heaviest
            else f"take off the weight that pulls it with up to {guess.heaviest:.2g} N·m",
        )

    def corrected(self, fit: Fit) -> Guess:
        """Return the parameters for scaling the next motions."""
        least = 0.1 * fit["inertia"]  # stable even without friction
        sine = cosine = 0.0
        if fit.gravity > _HEAVY * fit["coulomb"]:
            turned = fit.hanging - self._start
            sine = fit.gravity * math.cos(turned)
            cosine = -fit.gravity * math.sin(turned)
        return Guess(
            fit["inertia"],
            max(fit["damping"], least),
            fit["coulomb"],
            max(fit["delay"], 0.0) + self._age + self.delay_steps * self._bounds.period,
            fit["dead_band"],
            sine,
            cosine,
        )

    def play(self, name: str, phases: list[Phase]) -> Played:
        """Execute a program, and keep its log's name."""
        played = self._testbed.play(name, phases, self.delay_steps)
        self.logs.append(played.log)
        return played


def _furthest(played: Played) -> float:
    """Return the largest distance of the shaft from its start [rad]."""
    position = played.rows["position"]
    return float(np.max(np.abs(position - position[0])))


def _moved(played: Played, pulse: int, *, coast: bool = False) -> float:
    """Return the shaft's travel during a pulse [rad], or to the end of the coasting after it."""
    phase = played.rows["phase"]
    of_it = (phase == pulse) | (coast & (phase == pulse + 1))
    position = played.rows["position"][of_it]
    return float(position[-1] - position[0]) if position.size else 0.0


def _unmoved(tried: list[float], moved: list[float], bounds: Bounds) -> UnidentifiableError:
    torques = ", ".join(f"{torque:.2g}" for torque in tried)
    ways = " and ".join(f"{way:+.2g}" for way in moved)
    return UnidentifiableError(
        f"the servo does not move: pulses of {torques} N·m each way, the last at the torque limit,"
        f" turned it by {ways} rad",
        wanted=f"at least {max(_MOVED * bounds.step, _MOVED_RAD):.2g} rad",
        advice="free the shaft if it is blocked, or raise servo.torque_limit",
    )


def _check_sign(moved: list[float], torque: float) -> None:
    forward, back = moved
    if forward > 0.0 > back:
        return
    if forward < 0.0 < back:
        raise UnidentifiableError(
            f"a torque of +{torque:.2g} N·m turned the shaft by {forward:+.2g} rad: "
            "its sign is reversed",
            advice="set the servo's Drive Mode to normal (reverse bit 0)",
        )
    raise UnidentifiableError(
        f"torques of +{torque:.2g} and -{torque:.2g} N·m turned the shaft by "
        f"{forward:+.2g} and {back:+.2g} rad, both the same way: a weight, a spring "
        "or a hand moves it too",
        advice="free the shaft",
    )
