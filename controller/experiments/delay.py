"""Measures the loop's delay, from the sample of a torque to the motion that the torque causes.

The servo makes the motions of its identification, and the same model is fitted: it gives the lag
from the sending of a torque. The log shows when a torque was computed and when it was sent.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.experiments.estimated import Estimated
from haptic_wall.controller.experiments.identify.bench import SPOILT, UnidentifiableError
from haptic_wall.controller.experiments.identify.fitting import rounding_of
from haptic_wall.controller.experiments.identify.identification import (
    FULL,
    REACH,
    begun,
    bounds_of,
)
from haptic_wall.controller.experiments.testbed import Played
from haptic_wall.controller.milliseconds import ms
from haptic_wall.controller.runtime.assembly import AGE_PERCENTILE
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.theory.checks import IntArray

SECONDS = 55.0
"""Approximate duration of all motions in real time [s]"""
_DOUBTFUL = 1.2
"""Residual without noise, over the rounding's, from which the lag is doubtful"""
_MORE = 5
"""Periods beside twice the inserted ones that are tried for the sending row"""
GUARD_SHARE = 2.0
"""Standard errors between the value and its bounds."""


@dataclass(frozen=True, slots=True)
class LoopDelay:
    """The delay of the loop, and its parts."""

    device: Estimated
    """From sending a torque to the motion [s]"""
    wait: float
    """From the sample of a torque to its sending [s]"""
    inserted: float
    """By the configuration [s]"""
    age_median: float
    """Of a sample when a torque is sent in the same period [s]"""
    age_high: float
    """Percentile that the guard uses [s]"""
    residual: float
    """Root mean square of the fit's residual [rad]"""
    log: Path
    notes: tuple[str, ...]
    """Remarks for a person"""

    @property
    def total(self) -> Estimated:
        """Return the delay from the sample to the motion [s]: t_d of the theory."""
        return Estimated(self.wait + self.device.value, self.device.stderr)


def measure_delay(
    config: Config, folder: Path, tell: Callable[[str], None] = lambda _text: None
) -> LoopDelay:
    """Measure the loop's delay on the servo of a configuration.

    Args:
        config: The servo and its settings; a scripted operator is switched off.
        folder: Folder for the logs.
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
    bench.delay_steps = config.delay.steps
    played, fit = bench.fitted("delay", bench.corrected(fit), FULL * bounds.reach)
    rounding = rounding_of(bounds.step)
    left = fit.smooth_part(rounding)
    if left > SPOILT * rounding:
        raise UnidentifiableError(
            f"the motion in {played.log} is not that of a rigid servo, and does not determine the"
            f" lag: {1e3 * left:.2g} mrad remain, wanted at most {1e3 * SPOILT * rounding:.2g}",
            advice="check for a loose horn, an elastic link or transmission, and contact with the"
            " shaft",
        )
    notes: tuple[str, ...] = ()
    if left > _DOUBTFUL * rounding:
        notes = (
            f"the residual without noise is {1e3 * left:.2g} mrad, of which rounding explains"
            f" {1e3 * rounding:.2g}: the lag may be further off than its error says, as where a"
            " load vibrates",
        )
    return LoopDelay(
        device=Estimated(fit["delay"], fit.error("delay")),
        wait=_waiting(played.rows, config.delay.steps),
        inserted=config.delay.steps * bounds.period,
        age_median=float(np.median(played.rows["age_ns"])) * 1e-9,
        age_high=high_age(played),
        residual=fit.residual,
        log=played.log,
        notes=notes,
    )


def high_age(played: Played) -> float:
    """Return the percentile that the guard uses of the samples' ages when a torque is sent [s]."""
    return float(np.percentile(played.rows["age_ns"], AGE_PERCENTILE)) * 1e-9


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


def delay_report(found: LoopDelay) -> dict[str, Any]:
    """Return the result as JSON-ready values."""
    low = found.device.value - GUARD_SHARE * found.device.stderr
    high = found.device.value + GUARD_SHARE * found.device.stderr
    return {
        **found.total.report(),
        "unit": "s",
        "parts": {
            "inserted": found.inserted,
            "age": {"median": found.age_median, "guard": found.age_high},
            "device": found.device.report(),
        },
        "model_delay": {"value": max(found.device.value, 0.0), "low": max(low, 0.0), "high": high},
        "residual_rad": found.residual,
        "log": found.log,
        "notes": list(found.notes),
    }


def delay_text(found: LoopDelay) -> list[str]:
    """Format the parts, one a line, and the notes."""
    return [
        f"delay from sample to motion  {found.total.in_ms()}",
        f"  inserted                   {ms(found.inserted)}",
        f"  age of the sample          {ms(found.age_median)} (median; the guard counts"
        f" {ms(found.age_high)})",
        f"  device, sending to motion  {found.device.in_ms()}",
        *found.notes,
    ]
