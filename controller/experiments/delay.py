"""The loop's delay, from the sample a torque was computed with to the motion that it causes.

The torque is stepped, and the instant at which the shaft's acceleration changes is found from the
motion on both sides, far finer than a sampling period. The same with periods inserted on purpose
must find that much more: what the measurement is worth shows in what it recovers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from haptic_wall.controller.experiments.holding import torque_limit_of, without_hand
from haptic_wall.controller.experiments.steps.shaken import Shaken, Shaking, plan_shaking, shake
from haptic_wall.controller.experiments.steps.step_fit import StepFit, from_command
from haptic_wall.controller.experiments.testbed import Testbed
from haptic_wall.controller.settings.config import Config

BURSTS = 8
BURST_S = 2.6
"""Duration of a burst and its return in real time, about [s]"""
CHECK_STEPS = 5
"""Periods inserted beside the configured ones, to be recovered."""
GUARD_SHARE = 2.0
"""The bounds to believe in are so many standard errors from the value."""


@dataclass(frozen=True, slots=True)
class Measured:
    """A value and its standard error."""

    value: float
    stderr: float

    def report(self) -> dict[str, float]:
        """For JSON."""
        return {"value": self.value, "stderr": self.stderr}


@dataclass(frozen=True, slots=True)
class DelayPoint:
    """The delay with one number of inserted periods."""

    steps: int
    inserted: float
    """Set [s]"""
    total: Measured
    """From the sample to the motion [s]: t_d of the theory"""
    device: Measured
    """From the sending to the motion [s]"""
    age: Measured
    """Of a sample when a torque is sent in the same period, mean over the steps [s]"""
    recovered: Measured | None
    """Of the inserted delay, against the run with the fewest [s]; None: that is this one"""
    shaken: Shaken
    commanded: StepFit
    """The fit with the lag counted from the sample"""


@dataclass(frozen=True, slots=True)
class LoopDelay:
    """Delay of the loop, and the parts it is made of."""

    total: Measured
    """At the configured inserted delay [s]"""
    device: Measured
    """By all runs [s]"""
    age_median: float
    age_high: float
    """Percentile that the guard counts with [s]"""
    points: tuple[DelayPoint, ...]
    configured: int
    """Periods inserted by the configuration"""

    @property
    def notes(self) -> list[str]:
        """Remarks for a person."""
        return [p.shaken.note for p in self.points if p.shaken.note]


def planned(
    config: Config, delay_steps: Sequence[int], bursts: int, seed: int
) -> tuple[list[Shaking], str]:
    """The runs that will be made, and what they will do, for a person.

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
        f" within ±{reach:.2g} rad of where it is, under torques of up to {plan.torque:.3g} N·m;"
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
        config: The servo, and what it runs on; a scripted hand is kept off.
        folder: Where the logs go.
        delay_steps: Periods to be inserted and recovered, beside the configured ones.
        bursts: Of torque steps, for each run.
        seed: Of the random lengths and amplitudes of the steps.
        tell: Called with what a person should know meanwhile.

    Raises:
        UserError: The torque limit is unknown, or too small against friction.
        ExperimentFailedError: The servo did not move, or not as asked.
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
    """As JSON-ready values.

    Args:
        found: The result.
        period: [s].
        believed: The longest lag of the device that is believed [s].
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
    age = Measured(float(np.mean(ages)), float(np.std(ages) / np.sqrt(ages.size)))
    total = Measured(commanded.lag, commanded.stderr)
    recovered = None
    if reference:
        first = reference[0]
        recovered = Measured(
            first.inserted + (total.value - age.value) - (first.total.value - first.age.value),
            float(np.hypot(total.stderr, first.total.stderr)),
        )
    device = Measured(fit.lag, fit.stderr)
    return DelayPoint(steps, steps * period, total, device, age, recovered, shaken, commanded)


def _together(fits: Sequence[StepFit]) -> Measured:
    """The mean lag, each weighted with what it knows; what all have in common stays."""
    weights = np.array([fit.stderr**-2 for fit in fits])
    values = np.array([fit.lag for fit in fits])
    common = max(fit.systematic for fit in fits)
    return Measured(
        float(weights @ values / weights.sum()), max(float(weights.sum() ** -0.5), common)
    )
