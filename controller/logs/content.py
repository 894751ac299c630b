"""Names what no run writes in the content of a log: rows, changes of the wall, the report."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

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


_CHANGE: Final = {
    "set": list,
    "outcome": str,
    "row": int | None,
    "at_s": int | float | None,
    "changed": dict | None,
    "why": str | None,
}
_REPORT: Final = {
    "stop_reason": str | None,
    "message": str | None,
    "schedule": str | None,
    "guard": dict | None,
    "oscillation": dict | None,
    "warnings": list | None,
    "rows": int | None,
    "axes": dict | None,
}
_NUMBER: Final = int | float | None
_INSIDE: Final[Mapping[str, Mapping[str, Any]]] = {
    "guard": {"reasons": list | None},
    "oscillation": {
        "state": str | None,
        "frequency_hz": _NUMBER,
        "amplitude_rad": _NUMBER,
        "first_alarm_s": _NUMBER,
        "probes": int | None,
        "probed_s": _NUMBER,
    },
}
"""Kinds of the parts that are used; a missing one counts as None"""


def fault_of_change(change: object) -> str | None:
    """Name the implausible part of a change of the wall; None: there is none."""
    return _fault(change, _CHANGE, "an event")


def fault_of_report(report: object) -> str | None:
    """Name the implausible part of a run's report; None: all of it is plausible."""
    fault = _fault(report, _REPORT, "its report")
    if fault is not None or not isinstance(report, dict):
        return fault
    for part in (report, *(report.get("axes") or {}).values()):
        if not isinstance(part, dict):
            return "an axis of its report is no object"
        for name, kinds in _INSIDE.items():
            fault = fault or _fault(part.get(name) or {}, kinds, f"its report's {name}")
    return fault


def _fault(found: object, kinds: Mapping[str, Any], what: str) -> str | None:
    if not isinstance(found, dict):
        return f"{what} is no object"
    for name, kind in kinds.items():
        value, most = found.get(name), _LONGEST_S if name == "at_s" else _MOST
        plausible = isinstance(value, kind) and not isinstance(value, bool)
        if plausible and isinstance(value, int | float):
            plausible = (-most if name == "at_s" else 0) <= value <= most
        if plausible and isinstance(value, list):
            plausible = all(isinstance(each, str) for each in value)
        if not plausible:
            return f"{name} is not what a run writes in {what}"
    return None
