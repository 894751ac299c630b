"""Names what no run writes in the content of a log: rows, changes of the wall, the report."""

from __future__ import annotations

from typing import Annotated, Any, Final

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from haptic_wall.controller.detector.state import State
from haptic_wall.controller.runtime.telemetry import FLOAT_FIELDS, INT_FIELDS
from haptic_wall.hw.servo import Outcome

_LONGEST_NS: Final = 1 << 50
"""Longest plausible time within a tick: some thirteen days"""
_LONGEST_S: Final = 1e9
"""Longest plausible time of a run"""
_MOST: Final = 1 << 53
_RANGES: Final = {
    "seq": (0, _MOST),
    "deadline_ns": (0, 1 << 61),
    "sampled_ns": (-_LONGEST_NS, 1 << 61),
    "outcome": (0, max(Outcome)),
    "oscillation": (0, max(State)),
    "flags": (0, (1 << 16) - 1),
    "phase": (-1, 1 << 20),
    "missed": (0, 1 << 40),
}
"""Least and largest values of the whole columns that hold no time within a tick"""
_LARGEST: Final = 1e18
"""Largest plausible value of other columns, in SI units; NaN is unknown, and a defect may be
infinite"""
_LIMITS: Final = [_RANGES.get(name, (-_LONGEST_NS, _LONGEST_NS)) for name in INT_FIELDS]
_LOW, _HIGH = np.array(_LIMITS, np.int64).T


def fault_of_rows(rows: NDArray[np.void], before: np.void | None) -> str | None:
    """Name an implausible value in rows; None: all are plausible.

    Args:
        rows: Shape (n, axes), n > 0, dtype ``telemetry.ROW``.
        before: The row before them, of the first axis.
    """
    numbers = rows.reshape(-1).view(np.int64).reshape(rows.size, -1)
    whole, real = np.split(numbers, [len(INT_FIELDS)], axis=1)
    wrong = np.argwhere((whole < _LOW) | (whole > _HIGH))
    if wrong.size:
        row, at = wrong[0]
        return f"{INT_FIELDS[at]} is {whole[row, at]} in it, wanted {_LOW[at]} to {_HIGH[at]}"
    real = np.ascontiguousarray(real).view(np.float64)
    wrong = np.argwhere((np.abs(real) > _LARGEST) & np.isfinite(real))
    if wrong.size:
        row, at = wrong[0]
        return f"{FLOAT_FIELDS[at]} is {real[row, at]:g} in it, which is too large"
    for name in ("seq", "deadline_ns"):
        times = rows[name][:, 0]
        if (np.diff(times) <= 0).any() or (before is not None and times[0] <= before[name]):
            return f"{name} does not increase in it"
    return None


_Number = Annotated[float, Field(ge=0.0, le=_MOST)] | None
_Whole = Annotated[int, Field(ge=0, le=_MOST)] | None


class _Part(BaseModel):
    """A part of a log's texts, of which only what is used is named."""

    model_config = ConfigDict(strict=True)


class _Change(_Part):
    set: list[str]
    outcome: str
    row: _Whole = None
    at_s: Annotated[float, Field(ge=-_LONGEST_S, le=_LONGEST_S)] | None = None
    changed: dict[str, Any] | None = None
    why: str | None = None


class _Guard(_Part):
    reasons: list[str] | None = None


class _Oscillation(_Part):
    state: str | None = None
    frequency_hz: _Number = None
    amplitude_rad: _Number = None
    first_alarm_s: _Number = None
    probes: _Whole = None
    probed_s: _Number = None


class _Axis(_Part):
    guard: _Guard | None = None
    oscillation: _Oscillation | None = None


class _Report(_Axis):
    stop_reason: str | None = None
    message: str | None = None
    schedule: str | None = None
    warnings: list[str] | None = None
    rows: _Whole = None
    axes: dict[str, _Axis] | None = None


def fault_of_change(change: object) -> str | None:
    """Name the implausible part of a change of the wall; None: there is none."""
    return _fault(change, _Change, "an event")


def fault_of_report(report: object) -> str | None:
    """Name the implausible part of a run's report; None: all of it is plausible."""
    return _fault(report, _Report, "its report")


def _fault(found: object, kind: type[_Part], what: str) -> str | None:
    try:
        kind.model_validate(found)
    except ValidationError as error:
        names = [each for each in error.errors()[0]["loc"] if isinstance(each, str)]
        if not names:
            return f"{what} is no object"
        within = f"{what}'s {names[-2]}" if len(names) > 1 else what
        return f"{names[-1]} is not what a run writes in {within}"
    return None
