"""Identification: a servo's inertia, friction and delay from motions of its own.

Pulses find the torque that moves the shaft, and prove its sign; a gentle program corrects what was
believed; the program at full size is what the model is fitted to. From positions alone torque is
known only in the unit in which it was commanded: what is found are inertia and friction per torque
commanded, which is what decides on stability. Where the servo measures its current, all of them are
given in the unit of that measurement.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from controller.config import Config
from controller.errors import HapticWallError, UserError
from controller.experiments.excitation import (
    PULSE_S,
    Bounds,
    Guess,
    first_pulse,
    motions,
    pulses,
)
from controller.experiments.fitting import Fit, NoFitError, fit_motion
from controller.experiments.motion_model import Motion, motion_of
from controller.experiments.outside_forces import outside_forces
from controller.experiments.testbed import Played, Testbed
from controller.experiments.torque_gain import torque_gain
from controller.program import Phase

REACH = 0.6
"""How far from its beginning the shaft may come unless told otherwise [rad]"""
FULL, GENTLE = 0.5, 0.2
"""Share of the reach that the motions aim at"""
_SPEED = 0.4
"""Share of ``safety.max_speed`` that is aimed at"""
_STRONGER = 1.5
"""Each pulse that did not move the shaft is followed by one stronger by this"""
_MOVED = 6
"""Counts by which a pulse must move the shaft"""
_MOVED_RAD = 0.005
"""The same where nothing is counted [rad]"""
_FRICTION_SHARE = 0.4
"""Of the torque limit that friction may take: the rest is for the motion"""
_TRIES = 3
_SOFTER = 0.6
"""By this a program that went too far is repeated smaller"""
_ROUNDING = 1.0 / math.sqrt(12.0)
"""Root mean square of rounding [counts]"""
_UNQUANTISED = 1e-5
"""Residual of a servo without an encoder's counts that is still taken for none [rad]"""
STRUCTURED, UNLIKE = 3.0, 10.0
"""Residual, in shares of what rounding leaves, from which it is told, and refused"""


class UnidentifiableError(HapticWallError):
    """The servo is not what the model can describe, or does not move as it must."""


@dataclass(frozen=True, slots=True)
class Estimated:
    """A value and its standard error."""

    value: float
    stderr: float


@dataclass(frozen=True, slots=True)
class Identified:
    """What was found, and what it was found from."""

    inertia: Estimated
    """[kg·m²]"""
    damping: Estimated
    """[N·m·s/rad]"""
    coulomb: Estimated
    """[N·m]"""
    delay: Estimated
    """From a torque's sending to its action [s]"""
    torque_gain: Estimated
    """Measured torque per torque commanded; where none is measured 1, by the unit of the others"""
    gain_measured: bool
    """Whether the servo measures its current"""
    backlash: Estimated | None
    """Between shaft and encoder, full width [rad]; None: not to be seen"""
    residual: float
    """Root mean square of measured less fitted position [rad]"""
    rounding: float
    """What rounding alone would leave of it [rad]"""
    warnings: tuple[str, ...]
    fit: Fit
    played: Played
    logs: tuple[Path, ...]


def bounds_of(config: Config, reach: float) -> Bounds:
    """What the motions keep to on the servo of a configuration.

    Raises:
        UserError: The reach is too small, or no torque limit is known.
    """
    limit = config.servo.torque_limit
    if limit is None and config.servo.kind != "simulated":
        raise UserError(
            "servo.torque_limit: found nothing, wanted the largest torque the motions may use"
            " [N·m]; set it to the servo's stall torque or less"
        )
    step = math.tau / config.servo.counts_per_rev if config.servo.counts_per_rev else 0.0
    least = max(60.0 * step, 0.02)
    if not least <= reach <= math.pi:
        raise UserError(
            f"--reach: found {reach:g}, wanted {least:.2g} to {math.pi:.3g} rad: less cannot be"
            " told from the encoder's counts"
        )
    return Bounds(
        reach=reach,
        torque=4.1 if limit is None else limit,
        speed=_SPEED * config.safety.max_speed,
        step=step,
        period=config.period_s,
    )


def announcement(bounds: Bounds) -> str:
    """What will move, and how far; for whoever stands near."""
    return (
        f"the shaft will move by itself for about a minute: up to {FULL * bounds.reach:.2g} rad"
        f" ({math.degrees(FULL * bounds.reach):.0f}°) to each side of where it is now; one that"
        f" comes {bounds.reach:.2g} rad away is ended; at most {bounds.torque:.2g} N·m. It must"
        " be free to turn, with nothing and nobody holding it"
    )


def identify(
    config: Config,
    folder: Path,
    reach: float = REACH,
    tell: Callable[[str], None] = lambda _text: None,
) -> Identified:
    """Move the servo, and fit the model to how it moved.

    Args:
        config: The servo. Its wall, guard and inserted delay take no part, and no hand is scripted.
        folder: Where the logs of all runs go.
        reach: How far the shaft may come from where it is [rad].
        tell: Called with what a person should know meanwhile.

    Raises:
        UnidentifiableError: It does not move, moves too far, or is not what the model describes.
        ServoError: The servo could not be started.
        ExperimentInterruptedError: A person has ended it.
        ExperimentTrippedError: A trip has ended it.
        UserError: The reach, the torque limit or the folder is wrong.
    """
    bounds = bounds_of(config, reach)
    raw = config.model_dump(mode="json")
    if config.servo.kind != "hardware":
        raw["servo"]["hand"] = "none"
    bench = _Bench(Testbed(Config.model_validate(raw), folder, tell), bounds, tell)
    guess = bench.find_moving_torque(_believed(config))
    _, fit = bench.fitted("gentle", guess, GENTLE * reach)
    played, fit = bench.fitted("motions", bench.corrected(fit), FULL * reach)
    return _judged(played, fit, bounds, tuple(bench.logs))


def _believed(config: Config) -> Guess:
    """The careful corner of the belief, in torque commanded."""
    belief = config.belief()
    age = config.guard.sample_age
    if config.servo.kind != "simulated":
        age = max(age, config.period_s * (1.0 if config.servo.schedule == "pipelined" else 0.5))
    gain = belief.torque_gain.high
    return Guess(
        belief.inertia.low / gain,
        belief.damping.low / gain,
        belief.coulomb.low / gain,
        belief.delay.high + age,
    )


class _Bench:
    """Plays the motions, again and smaller where they went too far; keeps the names of the logs."""

    def __init__(self, testbed: Testbed, bounds: Bounds, tell: Callable[[str], None]) -> None:
        self._testbed = testbed
        self._bounds = bounds
        self._tell = tell
        self._age = 0.0
        self.logs: list[Path] = []

    def find_moving_torque(self, guess: Guess) -> Guess:
        """Stronger pulses until the shaft moves, each way with the torque; the friction it has."""
        bounds = self._bounds
        least = max(_MOVED * bounds.step, _MOVED_RAD)
        torque = min(first_pulse(guess), bounds.torque)
        tried: list[float] = []
        while True:
            self._tell(f"pulses of {torque:.3g} N·m")
            phases = pulses(torque, bounds)
            played = self._play(f"pulse-{len(tried) + 1}", phases)
            moved = [_moved(played, first) for first in (0, 2)]
            tried.append(torque)
            if min(map(abs, moved)) >= least:
                break
            if torque >= bounds.torque:
                raise UnidentifiableError(_unmoved(tried, moved, bounds))
            torque = min(_STRONGER * torque, bounds.torque)
        _check_sign(moved, torque)
        way = 0.5 * (abs(moved[0]) + abs(moved[1]))
        # Driven for PULSE_S, then slowed by friction alone: u (u - c) / c = 2 m x / t².
        friction = torque**2 / (torque + 2.0 * guess.inertia * way / PULSE_S**2)
        if friction > _FRICTION_SHARE * bounds.torque:
            raise UnidentifiableError(
                f"friction takes {friction:.2g} N·m of the torque limit of {bounds.torque:.2g}"
                f" N·m, wanted at most {_FRICTION_SHARE:g} of it so that enough is left to move"
                " the shaft; raise servo.torque_limit if the servo allows more, or free the shaft"
            )
        return Guess(guess.inertia, guess.damping, friction, guess.delay)

    def fitted(self, name: str, guess: Guess, amplitude: float) -> tuple[Played, Fit]:
        """A program and the model fitted to it, on data that stayed within the reach."""
        bounds = self._bounds
        furthest = 0.0
        for attempt in range(1, _TRIES + 1):
            self._tell(f"motions of about {amplitude:.2g} rad to each side")
            label = name if attempt == 1 else f"{name}-{attempt}"
            played = self._play(label, motions(guess, bounds, amplitude))
            position = played.rows["position"]
            furthest = float(np.max(np.abs(position - position[0])))
            motion = motion_of(played.rows)
            self._age = float(np.median(played.rows["age_ns"])) * 1e-9
            try:
                fit = fit_motion(motion, bounds.step)
            except NoFitError as error:
                raise UnidentifiableError(
                    f"the motion in {played.log} cannot be fitted: {error}; see that the shaft is"
                    " free, and give it more --reach or servo.torque_limit"
                ) from error
            if furthest <= bounds.reach:
                return played, fit
            guess, amplitude = self.corrected(fit), _SOFTER * amplitude
        raise UnidentifiableError(
            f"the shaft was driven {furthest:.2g} rad away in {_TRIES} tries, wanted at most"
            f" {bounds.reach:.2g} rad; give it more --reach, or see what else moves it"
        )

    def corrected(self, fit: Fit) -> Guess:
        """What to scale the next motions to."""
        least = (
            0.1 * fit.inertia
        )  # a spring must be stable even if there is no friction to speak of
        return Guess(
            fit.inertia, max(fit.damping, least), fit.coulomb, max(fit.delay, 0.0) + self._age
        )

    def _play(self, name: str, phases: list[Phase]) -> Played:
        played = self._testbed.play(name, phases, delay_steps=0)
        self.logs.append(played.log)
        return played


def _moved(played: Played, first: int) -> float:
    """How far the shaft came from the beginning of a pulse to its rest [rad]."""
    rows = played.rows
    position = rows["position"][(rows["phase"] == first) | (rows["phase"] == first + 1)]
    return float(position[-1] - position[0]) if position.size else 0.0


def _unmoved(tried: list[float], moved: list[float], bounds: Bounds) -> str:
    torques = ", ".join(f"{torque:.2g}" for torque in tried)
    ways = " and ".join(f"{way:+.2g}" for way in moved)
    return (
        f"the servo does not move: pulses of {torques} N·m each way, the last at the torque limit,"
        f" turned it by {ways} rad, wanted {max(_MOVED * bounds.step, _MOVED_RAD):.2g} at least;"
        " see that the shaft is not blocked, or raise servo.torque_limit"
    )


def _check_sign(moved: list[float], torque: float) -> None:
    forward, back = moved
    if forward > 0.0 > back:
        return
    if forward < 0.0 < back:
        raise UnidentifiableError(
            f"a torque of +{torque:.2g} N·m turned the shaft by {forward:+.2g} rad: its sign is"
            " reversed; set the servo's Drive Mode to normal (reverse bit 0)"
        )
    raise UnidentifiableError(
        f"torques of +{torque:.2g} and -{torque:.2g} N·m turned the shaft by {forward:+.2g} and"
        f" {back:+.2g} rad, both the same way: something else moves it (a weight, a spring, a"
        " hand); take it off"
    )


def _judged(played: Played, fit: Fit, bounds: Bounds, logs: tuple[Path, ...]) -> Identified:
    motion = motion_of(played.rows)
    rounding = _ROUNDING * bounds.step or _UNQUANTISED
    warnings = []
    if fit.residual > STRUCTURED * rounding:
        text = (
            f"the residual is {1e3 * fit.residual:.2g} mrad where rounding leaves"
            f" {1e3 * rounding:.2g}: this is more than an inertia with friction"
            f" ({outside_forces(motion, fit)})"
        )
        if fit.residual > UNLIKE * rounding:
            raise UnidentifiableError(
                f"{text}; take off what is attached, or expect no model of it; {played.log} holds"
                " the motion"
            )
        warnings.append(f"{text}; the standard errors allow for it, the model does not")
    gain = torque_gain(played.rows, fit.delay)
    scale = 1.0 if gain is None else gain.value
    values = [scale * v for v in (fit.inertia, fit.damping, fit.coulomb)]
    errors = [scale * e for e in fit.stderr[:3]]
    inertia, damping, coulomb = map(Estimated, values, errors)
    return Identified(
        inertia=inertia,
        damping=damping,
        coulomb=coulomb,
        delay=Estimated(max(fit.delay, 0.0), fit.stderr[3]),
        torque_gain=Estimated(1.0, 0.0) if gain is None else Estimated(gain.value, gain.stderr),
        gain_measured=gain is not None,
        backlash=Estimated(fit.play, fit.stderr[4]) if fit.play > 0.0 else None,
        residual=fit.residual,
        rounding=rounding,
        warnings=tuple(warnings),
        fit=fit,
        played=played,
        logs=logs,
    )


def whole_motion(identified: Identified) -> Motion:
    """The motion that the model was fitted to."""
    return motion_of(identified.played.rows)
