"""Measures the loop's delay, from the sample of a torque to the motion that the torque causes.

The torque is stepped. The instant at which the shaft's acceleration changes follows from the motion
before and after it, with far finer resolution than a sampling period. Runs with inserted periods
must find exactly that much more, which proves the measurement.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from haptic_wall.controller.experiments.estimated import Estimated
from haptic_wall.controller.experiments.holding import torque_limit_of, without_hand
from haptic_wall.controller.experiments.steps.shaken import Shaken, Shaking, plan_shaking, shake
from haptic_wall.controller.experiments.steps.step_fit import StepFit, from_command
from haptic_wall.controller.experiments.testbed import Testbed
from haptic_wall.controller.settings.config import Config

BURSTS = 8
BURST_S = 2.6
"""Approximate duration of a burst and its return in real time [s]"""
CHECK_STEPS = 5
"""Periods inserted in addition to the configured ones, to be recovered."""
GUARD_SHARE = 2.0
"""Standard errors between the value and its bounds."""


@dataclass(frozen=True, slots=True)
class DelayPoint:
    """The delay with one number of inserted periods."""

    steps: int
    inserted: float
    """Set [s]"""
    total: Estimated
    """From the sample to the motion [s]: t_d of the theory"""
    device: Estimated
    """From sending to motion [s]"""
    age: Estimated
    """Age of a sample when a torque is sent in the same period, mean over the steps [s]"""
    recovered: Estimated | None
    """Measured inserted delay, relative to the run with the fewest periods [s]; None: this is that
    run"""
    shaken: Shaken
    commanded: StepFit
    """The fit with the lag counted from the sample"""


@dataclass(frozen=True, slots=True)
class LoopDelay:
    """The delay of the loop, and its parts."""

    total: Estimated
    """At the configured inserted delay [s]"""
    device: Estimated
    """From all runs [s]"""
    age_median: float
    age_high: float
    """Percentile that the guard uses [s]"""
    points: tuple[DelayPoint, ...]
    configured: int
    """Periods inserted by the configuration"""

    @property
    def notes(self) -> list[str]:
        """Return remarks for a person."""
        return [p.shaken.note for p in self.points if p.shaken.note]


def planned(
    config: Config, delay_steps: Sequence[int], bursts: int, seed: int
) -> tuple[list[Shaking], str]:
    """Return the planned runs, and their description for a person.

    Raises:
        UserError: The torque limit is unknown, or too small against friction.
    """
    limit = torque_limit_of(config)
    steps = sorted({config.delay.steps, *delay_steps})
    runs = [plan_shaking(config, limit, n, bursts, seed + n) for n in steps]
    plan = runs[0].plan
    reach = max(run.plan.reach for run in runs)
    text = (
        f"the shaft will swing over about {plan.travel:.2g} rad at up to {plan.speed:.2g} rad/s,"
        f" within ±{reach:.2g} rad of its position, with torques of up to {plan.torque:.3g} N·m;"
        f" {len(runs)} runs of about {bursts * BURST_S:.0f} s"
    )
    return runs, text


def measure_delay(
    config: Config,
    folder: Path,
    delay_steps: Sequence[int],
    bursts: int = BURSTS,
    seed: int = 0,
    tell: Callable[[str], None] = lambda _text: None,
) -> LoopDelay:
    """Measure the loop's delay on the servo of a configuration.

    Args:
        config: The servo and its settings; a scripted operator is switched off.
        folder: Folder for the logs.
        delay_steps: Periods to be inserted and recovered, in addition to the configured ones.
        bursts: Bursts of torque steps, for each run.
        seed: Seed of the random lengths and amplitudes of the steps.
        tell: Called with messages for a person.

    Raises:
        UserError: The torque limit is unknown, or too small against friction.
        ExperimentFailedError: The servo did not respond, or not as expected.
        ExperimentInterruptedError: A person has ended it.
        ExperimentTrippedError: A trip has ended it.
        ServoError: The servo could not be started.
    """
    config = without_hand(config)
    runs, text = planned(config, delay_steps, bursts, seed)
    tell(text)
    bed = Testbed(config, folder, tell)
    points: list[DelayPoint] = []
    for place, run in enumerate(runs):
        tell(f"run {place + 1} of {len(runs)}: {run.delay_steps} periods inserted")
        shaken = shake(bed, f"delay-{run.delay_steps}", run)
        points.append(_point(run.delay_steps, config.period_s, shaken, points[:1]))
    ages = np.concatenate([point.shaken.ages for point in points])
    return LoopDelay(
        total=next(point.total for point in points if point.steps == config.delay.steps),
        device=_together([point.shaken.fit for point in points]),
        age_median=float(np.median(ages)),
        age_high=float(np.percentile(ages, config.guard.delay_percentile)),
        points=tuple(points),
        configured=config.delay.steps,
    )


def delay_report(found: LoopDelay, period: float, believed: float) -> dict[str, Any]:
    """Return the result as JSON-ready values.

    Args:
        found: The result.
        period: [s].
        believed: The longest believed lag of the device [s].
    """
    low = found.device.value - GUARD_SHARE * found.device.stderr
    high = found.device.value + GUARD_SHARE * found.device.stderr
    return {
        **found.total.report(),
        "unit": "s",
        "parts": {
            "inserted": found.configured * period,
            "age": {"median": found.age_median, "guard": found.age_high},
            "device": found.device.report(),
        },
        "model_delay": {"value": max(found.device.value, 0.0), "low": max(low, 0.0), "high": high},
        "believed_high": believed,
        "points": [
            {
                "delay_steps": point.steps,
                "inserted": point.inserted,
                "total": point.total.report(),
                "device": point.device.report(),
                "age": point.age.report(),
                "recovered": point.recovered and point.recovered.report(),
                "torque_steps": len(point.shaken.fit.steps),
                "residual_rad": point.shaken.fit.residual,
                "log": point.shaken.played.log,
            }
            for point in found.points
        ],
        "notes": found.notes,
    }


def _point(
    steps: int, period: float, shaken: Shaken, reference: Sequence[DelayPoint]
) -> DelayPoint:
    fit = shaken.fit
    commanded = from_command(fit, period)
    ages = np.array([step.age for step in commanded.steps])
    age = Estimated(float(np.mean(ages)), float(np.std(ages) / np.sqrt(ages.size)))
    total = Estimated(commanded.lag, commanded.stderr)
    recovered = None
    if reference:
        first = reference[0]
        recovered = Estimated(
            first.inserted + (total.value - age.value) - (first.total.value - first.age.value),
            float(np.hypot(total.stderr, first.total.stderr)),
        )
    device = Estimated(fit.lag, fit.stderr)
    return DelayPoint(steps, steps * period, total, device, age, recovered, shaken, commanded)


def _together(fits: Sequence[StepFit]) -> Estimated:
    """Return the mean lag weighted by information; common errors stay."""
    weights = np.array([fit.stderr**-2 for fit in fits])
    values = np.array([fit.lag for fit in fits])
    common = max(fit.systematic for fit in fits)
    return Estimated(
        float(weights @ values / weights.sum()), max(float(weights.sum() ** -0.5), common)
    )
