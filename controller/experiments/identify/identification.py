"""Identifies a servo's inertia, friction and delay from motions of its own.

Pulses find the torque that moves the shaft, and verify its sign; a gentle program corrects the
belief; the model is fitted to the program at full size. Positions alone give the torque only in
commanded
units: the results are inertia and friction per commanded torque, which decide on stability. Where
the servo measures its current, all results are in the unit of that measurement.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from haptic_wall.controller.errors import UserError
from haptic_wall.controller.experiments.estimated import Estimated
from haptic_wall.controller.experiments.holding import (
    changed,
    sample_age,
    torque_limit_of,
    without_hand,
)
from haptic_wall.controller.experiments.identify.bench import (
    Bench,
    UnidentifiableError,
)
from haptic_wall.controller.experiments.identify.excitation import Bounds, Guess
from haptic_wall.controller.experiments.identify.fit import Fit, Friction
from haptic_wall.controller.experiments.identify.fitting import rounding_of
from haptic_wall.controller.experiments.identify.misfit import misfit
from haptic_wall.controller.experiments.identify.mode import Mode, find_mode
from haptic_wall.controller.experiments.identify.output_error import Prior
from haptic_wall.controller.experiments.identify.torque_gain import torque_gain
from haptic_wall.controller.experiments.identify.vibration import (
    Vibration,
    heaviest_load,
    vibration_of,
)
from haptic_wall.controller.experiments.testbed import Played, Testbed
from haptic_wall.controller.settings.config import Config

REACH = 0.6
"""Default of the largest excursion from the start [rad]"""
SECONDS = 60.0
"""Approximate duration of all motions in real time [s]"""
FULL, GENTLE = 0.5, 0.2
"""Fractions of the reach for which the motions are planned"""
_SPEED = 0.4
"""Fraction of ``safety.max_speed`` for which they are planned"""
_ERRORS = 2.0
"""Standard errors within which an inertia counts as zero"""
_DROOP, _DRIVEN = 0.015, 0.64
"""Drag expected of a drive, over its stall torque at the no-load speed: 0.02 fits an MX-106; and
the planned speed over the no-load speed"""
_FADING = (1.8, 0.8)
"""Speed over which friction fades, and its deviation [rad/s]: 1.1 to 2.6 in bam's fits"""
_BENDS = 0.01
"""Least relative standard error of the inertia with a vibration"""
_LEAST, _WARMS = 1e-12, 0.05
"""Least deviation of a prior; that of the damping over its mean, because servos warm up"""


@dataclass(frozen=True, slots=True)
class Identified:
    """Identified parameters, and the data of their fit."""

    inertia: Estimated
    """[kg·m²]"""
    damping: Estimated
    """In the direction where it is less [N·m·s/rad]"""
    damping_least: float | None
    """Its lower bound, where friction that fades with the speed may hide more of it; None: the
    standard error tells"""
    coulomb: Estimated
    """[N·m]"""
    friction: Friction
    """In commanded units"""
    delay: Estimated
    """From sending a torque until it acts [s]"""
    torque_gain: Estimated
    """Measured torque per commanded torque; 1 without a measurement, by the unit of the others"""
    gain_measured: bool
    """Whether the servo measures its current"""
    backlash: Estimated | None
    """Between shaft and encoder, full width [rad]; None: not visible"""
    vibration: Vibration | None
    """Vibration of a load behind the gear's compliance; None: it was not looked for, because the
    motions were too small, or the encoder is on the motor"""
    residual: float
    """Root mean square of measured minus fitted position [rad]"""
    noise: float
    """Part of it that comes from noise and rounding of the readings [rad]"""
    rounding: float
    """The same from rounding alone [rad]"""
    warnings: tuple[str, ...]
    fit: Fit
    played: Played
    logs: tuple[Path, ...]

    @property
    def effects(self) -> dict[str, float]:
        """Return the sizes of the friction and drive effects, in the unit of the other torques."""
        fit, scale = self.fit, self.torque_gain.value
        sizes = {name: max(scale * fit[name], 0.0) for name in ("excess", "drag", "dead_band")}
        fading = fit["fading"] or 1.0  # of no importance without an excess
        return {**sizes, "gear": max(fit["gear"], 0.0), "fading": fading}


def bounds_of(config: Config, reach: float) -> Bounds:
    """Return the limits of the motions on the servo of a configuration.

    Raises:
        UserError: The reach is too small, or no torque limit is known.
    """
    limit = torque_limit_of(config)
    step = config.servo.position_step
    least = max(60.0 * step, 0.02)
    if not least <= reach <= math.pi:
        raise UserError(
            f"found {reach:g}",
            field="--reach",
            wanted=f"{least:.2g} to {math.pi:.3g} rad: the encoder does not resolve less",
        )
    return Bounds(
        reach=reach,
        torque=limit,
        speed=_SPEED * config.planned_speed,
        step=step,
        period=config.period_s,
    )


def announcement(bounds: Bounds) -> str:
    """Announce the motions and their size, for a person nearby."""
    return (
        f"the shaft will move by itself for about a minute, up to {FULL * bounds.reach:.2g} rad"
        f" ({math.degrees(FULL * bounds.reach):.0f}°) to each side of its position, with at most"
        f" {bounds.torque:.2g} N·m; a motion of more than {bounds.reach:.2g} rad is ended. The"
        " shaft must be free to turn; do not hold it"
    )


def identify(
    config: Config,
    folder: Path,
    reach: float = REACH,
    tell: Callable[[str], None] = lambda _text: None,
) -> Identified:
    """Move the servo, and fit the model to its motion.

    Args:
        config: The servo. Its wall, guard, inserted delay and scripted operator are not used.
        folder: Folder for the logs of all runs.
        reach: Largest excursion from the start [rad].
        tell: Called with messages for a person.

    Raises:
        UnidentifiableError: It does not move, moves too far, or not by its torque.
        ServoError: The servo could not be started.
        ExperimentInterruptedError: A person has ended it.
        ExperimentTrippedError: A trip has ended it.
        UserError: The reach, the torque limit or the folder is invalid.
    """
    bounds = bounds_of(config, reach)
    bench, fit = begun(config, folder, bounds, tell)
    played, fit = bench.fitted("motions", bench.corrected(fit), FULL * reach)
    heaviest = heaviest_load(fit["inertia"], config.belief())
    mode = None
    if config.servo.encoder == "output":
        mode = find_mode(bench, fit, bounds, FULL * reach)
    found = _judged(played, fit, bounds, tuple(bench.logs), mode, heaviest)
    return replace(found, warnings=(*found.warnings, *_echo(fit, config)))


def begun(
    config: Config, folder: Path, bounds: Bounds, tell: Callable[[str], None]
) -> tuple[Bench, Fit]:
    """Move the servo gently, and fit its motion roughly, for the scale of other motions.

    Args:
        config: As ``identify``.
        folder: As ``identify``.
        bounds: Limits of the motions.
        tell: As ``identify``.
    """
    # No wall is rendered; the springs are planned for one sample.
    alone = changed(without_hand(config), wall={"velocity_samples": 1})
    bed = Testbed(alone, folder, tell)
    bench = Bench(bed, bounds, tell, _priors(config, bounds))
    guess = bench.find_moving_torque(_believed(config))
    return bench, bench.fitted("gentle", guess, GENTLE * bounds.reach, rough=True)[1]


def _believed(config: Config) -> Guess:
    """Return the cautious corner of the belief, in commanded torque."""
    belief = config.belief()
    gain = belief.torque_gain.high
    return Guess(
        belief.inertia.low / gain,
        belief.damping.low / gain,
        belief.coulomb.low / gain,
        belief.delay.high + sample_age(config),
    )


def _priors(config: Config, bounds: Bounds) -> dict[str, Prior]:
    """Return priors for values that a short motion hardly determines."""
    belief = config.belief()
    mean, width = belief.damping.value, belief.damping.high - belief.damping.low
    damping = Prior(mean, max(width, _WARMS * mean, _LEAST))
    drag = _DROOP * bounds.torque / (bounds.speed / _DRIVEN) ** 2
    gain = belief.torque_gain.value
    return {
        "damping": Prior(damping.mean / gain, damping.deviation / gain),
        "drag": Prior(drag, drag),
        "fading": Prior(*_FADING),
    }


def _echo(fit: Fit, config: Config) -> Iterator[str]:
    """Yield a sentence where the damping that was found is only the believed one."""
    believed = config.belief().damping
    if fit["excess"] and believed.high - believed.low < _LEAST:
        yield (
            "the damping is the believed one, which has no bounds: with friction that fades, the"
            " motion determines it only within believed bounds; give model.damping as"
            " {value, low, high}"
        )


def _judged(
    played: Played,
    fit: Fit,
    bounds: Bounds,
    logs: tuple[Path, ...],
    mode: Mode | None,
    heaviest: float,
) -> Identified:
    rounding = rounding_of(bounds.step)
    noise = max(fit.noise, rounding)
    warnings = tuple(misfit(fit, noise, rounding))
    if fit["inertia"] <= _ERRORS * fit.error("inertia"):
        raise UnidentifiableError(
            f"{'; '.join(warnings)}: the motion in {played.log} does not determine the inertia",
            advice="free the shaft of attached parts, and do not touch it",
        )
    backlash = fit["backlash"]
    gain = torque_gain(played.rows, fit["delay"], fit["dead_band"])
    scale = 1.0 if gain is None else gain.value
    damping, its_error = fit.weaker
    values = [scale * v for v in (fit["inertia"], max(damping, 0.0), fit["coulomb"])]
    errors = [scale * e for e in (fit.error("inertia"), its_error, fit.error("coulomb"))]
    vibration = None
    if mode is not None:
        most = damping + _ERRORS * its_error
        vibration = vibration_of(mode, most, scale, heaviest, 1.0 / bounds.period)
        if vibration.ratio is not None:  # a rigid shaft was fitted to what bends
            apart = abs(vibration.inertia - values[0])
            errors[0] = max(errors[0], _BENDS * vibration.inertia, 0.5 * apart)
            values[0] = vibration.inertia
    three = list(map(Estimated, values, errors))
    return Identified(
        inertia=three[0],
        damping=three[1],
        damping_least=None if fit.least is None else scale * fit.least,
        coulomb=three[2],
        delay=Estimated(max(fit["delay"], 0.0), fit.error("delay")),
        torque_gain=gain or Estimated(1.0, 0.0),
        gain_measured=gain is not None,
        friction=fit.friction,
        backlash=None if backlash <= 0.0 else Estimated(backlash, fit.error("backlash")),
        vibration=vibration,
        residual=fit.residual,
        noise=noise,
        rounding=rounding,
        warnings=warnings,
        fit=fit,
        played=played,
        logs=logs,
    )
