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

from haptic_wall.controller.errors import UserError
from haptic_wall.controller.experiments.identify.bench import (
    Bench,
    UnidentifiableError,
    rounding_of,
)
from haptic_wall.controller.experiments.identify.excitation import Bounds, Guess
from haptic_wall.controller.experiments.identify.fitting import Fit
from haptic_wall.controller.experiments.identify.misfit import misfit
from haptic_wall.controller.experiments.identify.motion_model import Motion, motion_of
from haptic_wall.controller.experiments.identify.torque_gain import torque_gain
from haptic_wall.controller.experiments.testbed import Played, Testbed
from haptic_wall.controller.settings.config import Config

REACH = 0.6
"""How far from its beginning the shaft may come unless told otherwise [rad]"""
SECONDS = 60.0
"""Duration of all motions in real time, about [s]"""
FULL, GENTLE = 0.5, 0.2
"""Share of the reach that the motions aim at"""
_SPEED = 0.4
"""Share of ``safety.max_speed`` that is aimed at"""
_ERRORS = 2.0
"""Standard errors within which an inertia of zero is no inertia"""


@dataclass(frozen=True, slots=True)
class Estimated:
    """A value and its standard error."""

    value: float
    stderr: float


@dataclass(frozen=True, slots=True)
class Identified:
    """Identified parameters, and the data they were found from."""

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
    """Part of it that rounding alone would leave [rad]"""
    warnings: tuple[str, ...]
    fit: Fit
    played: Played
    logs: tuple[Path, ...]


def bounds_of(config: Config, reach: float) -> Bounds:
    """Limits of the motions on the servo of a configuration.

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
        speed=_SPEED * config.planned_speed,
        step=step,
        period=config.period_s,
    )


def announcement(bounds: Bounds) -> str:
    """Announce which motions will be made, and how far; for whoever stands near."""
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
        UnidentifiableError: It does not move, moves too far, or by something else than its torque.
        ServoError: The servo could not be started.
        ExperimentInterruptedError: A person has ended it.
        ExperimentTrippedError: A trip has ended it.
        UserError: The reach, the torque limit or the folder is wrong.
    """
    bounds = bounds_of(config, reach)
    raw = config.model_dump(mode="json")
    raw["wall"]["velocity_samples"] = 1  # no wall is rendered, and the springs are planned for it
    if config.servo.kind != "hardware":
        raw["servo"]["hand"] = "none"
    bed = Testbed(Config.model_validate(raw), folder, tell, option="--logs")
    bench = Bench(bed, bounds, tell)
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


def _judged(played: Played, fit: Fit, bounds: Bounds, logs: tuple[Path, ...]) -> Identified:
    rounding = rounding_of(bounds)
    warnings = tuple(misfit(fit, rounding))
    if fit.inertia <= _ERRORS * fit.stderr[0]:
        raise UnidentifiableError(
            f"{'; '.join(warnings)}: no inertia can be told from the motion in {played.log}; take"
            " off what is attached, and keep away from the shaft"
        )
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
        warnings=warnings,
        fit=fit,
        played=played,
        logs=logs,
    )


def whole_motion(identified: Identified) -> Motion:
    """The motion that the model was fitted to."""
    return motion_of(identified.played.rows)
