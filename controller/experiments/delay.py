"""Measures the loop's delay, from the sample of a torque to the motion that the torque causes.

The servo makes the motions of its identification, and the same model is fitted: it gives the lag
from the sending of a torque. The log shows when a torque was computed and when it was sent. Runs
with inserted periods must find exactly that much more, which proves the measurement.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.experiments.estimated import Estimated
from haptic_wall.controller.experiments.identify.bench import (
    SPOILT,
    Bench,
    UnidentifiableError,
)
from haptic_wall.controller.experiments.identify.excitation import Bounds
from haptic_wall.controller.experiments.identify.fit import Fit
from haptic_wall.controller.experiments.identify.fitting import rounding_of
from haptic_wall.controller.experiments.identify.identification import (
    FULL,
    REACH,
    begun,
    bounds_of,
)
from haptic_wall.controller.experiments.testbed import Played
from haptic_wall.controller.guard.delay_parts import ms
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.theory.checks import FloatArray, IntArray

START_S, RUN_S = 30.0, 25.0
"""Approximate duration of the first motions, and of each run, in real time [s]"""
CHECK_STEPS = 5
"""Periods inserted in addition to the configured ones, to be recovered."""
_DOUBTFUL = 1.2
"""Residual without noise, over the rounding's, from which the lag is doubtful"""
_MORE = 5
"""Periods beside twice the inserted ones that are tried for the sending row"""
GUARD_SHARE = 2.0
"""Standard errors between the value and its bounds."""


@dataclass(frozen=True, slots=True)
class DelayPoint:
    """The motions with one number of inserted periods, and their fit."""

    steps: int
    inserted: float
    """Set [s]"""
    fit: Fit
    """Delay from sending a torque until it acts"""
    wait: float
    """From the sample of a torque to its sending [s]"""
    ages: FloatArray
    """Ages of all samples when their torque was sent [s]"""
    played: Played
    note: str
    """Remark for a person; empty: none"""
    recovered: Estimated | None = None
    """Measured inserted delay, relative to the run with the fewest periods [s]; None: this is that
    run"""

    @property
    def device(self) -> Estimated:
        """Return the delay from sending a torque to the motion [s]."""
        return Estimated(self.fit["delay"], self.fit.error("delay"))

    @property
    def total(self) -> Estimated:
        """Return the delay from the sample to the motion [s]: t_d of the theory."""
        return Estimated(self.wait + self.fit["delay"], self.fit.error("delay"))

    @property
    def age(self) -> Estimated:
        """Return the mean age of a sample when a torque is sent in the same period [s]."""
        ages = self.ages
        return Estimated(float(np.mean(ages)), float(np.std(ages) / np.sqrt(ages.size)))

    def beside(self, first: DelayPoint) -> DelayPoint:
        """Return this point with the inserted delay that it recovers, beside the first one."""
        more = self.total.value - self.age.value - (first.total.value - first.age.value)
        error = float(np.hypot(self.total.stderr, first.total.stderr))
        return replace(self, recovered=Estimated(first.inserted + more, error))


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
        return [point.note for point in self.points if point.note]


def measure_delay(
    config: Config,
    folder: Path,
    delay_steps: Sequence[int],
    tell: Callable[[str], None] = lambda _text: None,
) -> LoopDelay:
    """Measure the loop's delay on the servo of a configuration.

    Args:
        config: The servo and its settings; a scripted operator is switched off.
        folder: Folder for the logs.
        delay_steps: Periods to be inserted and recovered, in addition to the configured ones.
        tell: Called with messages for a person.

    Raises:
        UserError: The torque limit or the folder is invalid.
        UnidentifiableError: The servo did not respond, or not as a rigid one.
        ExperimentInterruptedError: A person has ended it.
        ExperimentTrippedError: A trip has ended it.
        ServoError: The servo could not be started.
    """
    bounds = bounds_of(config, REACH)
    bench, fit = begun(config, folder, bounds, tell)
    points: list[DelayPoint] = []
    runs = sorted({config.delay.steps, *delay_steps})
    for place, steps in enumerate(runs):
        tell(f"run {place + 1} of {len(runs)}: {steps} periods inserted")
        point = _measured(bench, fit, bounds, steps)
        fit = point.fit
        points.append(point.beside(points[0]) if points else point)
    ages = np.concatenate([point.ages for point in points])
    device = _together([point.device for point in points])
    wait = next(point.wait for point in points if point.steps == config.delay.steps)
    return LoopDelay(
        total=Estimated(wait + device.value, device.stderr),
        device=device,
        age_median=float(np.median(ages)),
        age_high=float(np.percentile(ages, config.guard.delay_percentile)),
        points=tuple(points),
        configured=config.delay.steps,
    )


def _measured(bench: Bench, fit: Fit, bounds: Bounds, steps: int) -> DelayPoint:
    """Move the servo with inserted periods, and fit its delay.

    Args:
        bench: The servo.
        fit: Fit of an earlier motion, for the scale.
        bounds: Limits of the motions.
        steps: Periods to be inserted.
    """
    bench.delay_steps = steps
    played, fit = bench.fitted(f"delay-{steps}", bench.corrected(fit), FULL * bounds.reach)
    rounding = rounding_of(bounds.step)
    left = fit.smooth_part(rounding)
    if left > SPOILT * rounding:
        raise UnidentifiableError(
            f"the motion in {played.log} is not that of a rigid servo, and does not determine the"
            f" lag: {1e3 * left:.2g} mrad remain, wanted at most {1e3 * SPOILT * rounding:.2g}",
            advice="check for a loose horn, an elastic link or transmission, and contact with the"
            " shaft",
        )
    note = ""
    if left > _DOUBTFUL * rounding:
        note = (
            f"the residual without noise is {1e3 * left:.2g} mrad, of which rounding explains"
            f" {1e3 * rounding:.2g}: the lag may be further off than its error says, as where a"
            " load vibrates"
        )
    ages: FloatArray = played.rows["age_ns"] * 1e-9
    wait = _waiting(played.rows, steps)
    return DelayPoint(steps, steps * bounds.period, fit, wait, ages, played, note)


def _waiting(rows: NDArray[np.void], steps: int) -> float:
    """Return the time from the sample that a torque was computed of to its sending [s].

    The row that sends it is found by comparing the sent torques with the computed ones.

    Args:
        rows: Dtype ``telemetry.ROW``.
        steps: Inserted periods, roughly.
    """
    rows = rows[rows["sampled_ns"] > 0]
    computed, sent = rows["wall_torque"], rows["torque"]
    off = [
        float(np.mean(np.abs(sent[later:] - computed[: rows.size - later])))
        for later in range(2 * steps + _MORE)
    ]
    later = int(np.argmin(off))
    sampled, age = rows["sampled_ns"], rows["age_ns"]
    waits: IntArray = sampled[later:] + age[later:] - sampled[: rows.size - later]
    return float(np.median(waits)) * 1e-9


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
                "residual_rad": point.fit.residual,
                "log": point.played.log,
            }
            for point in found.points
        ],
        "notes": found.notes,
    }


def _together(found: Sequence[Estimated]) -> Estimated:
    """Return the mean weighted by information."""
    weights = np.array([max(each.stderr, 1e-9) ** -2 for each in found])
    values = np.array([each.value for each in found])
    return Estimated(float(weights @ values / weights.sum()), float(weights.sum() ** -0.5))


def delay_text(found: LoopDelay, period: float) -> list[str]:
    """Format a table of the parts, one of the recovered delays, and the notes."""
    lines = [
        f"delay from sample to motion  {found.total.in_ms()}",
        f"  inserted                   {ms(found.configured * period)}",
        f"  age of the sample          {ms(found.age_median)} (median; the guard counts"
        f" {ms(found.age_high)})",
        f"  device, sending to motion  {found.device.in_ms()}",
        "",
        f"{'inserted':>10}  {'measured':>20}  {'recovered':>20}",
    ]
    for point in found.points:
        recovered = point.recovered.in_ms() if point.recovered else "(reference)"
        lines.append(f"{ms(point.inserted):>10}  {point.total.in_ms():>20}  {recovered:>20}")
    return [*lines, *found.notes]
