"""Names what no run writes in the content of a log: rows, changes of the wall, the report."""

from __future__ import annotations

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
        rows: Shape (n,), n > 0, dtype ``telemetry.ROW``.
        before: The row before them.
    """
    numbers = rows.view(np.int64).reshape(rows.size, -1)
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
        if (np.diff(rows[name]) <= 0).any() or (
            before is not None and rows[name][0] <= before[name]
        ):
            return f"{name} does not increase in it"
    return None


def fault_of_change(change: object) -> str | None:
    """Name the implausible part of a change of the wall; None: there is none.

    A missing part counts as None, and only ``set`` and ``outcome`` may not be that.
    """
    if not isinstance(change, dict):
        return "an event has no change"
    row, at_s, sets = (change.get(name) for name in ("row", "at_s", "set"))
    if row is not None and not (type(row) is int and 0 <= row <= _MOST):
        return "row is no count in an event"
    if not isinstance(change.get("changed"), dict | None):
        return "changed is no object in an event"
    if not isinstance(sets, list) or not all(isinstance(each, str) for each in sets):
        return "set is no list of texts in an event"
    if at_s is not None and not (isinstance(at_s, int | float) and abs(at_s) <= _LONGEST_S):
        return "at_s is no time in an event"
    if not isinstance(change.get("outcome"), str):
        return "outcome is no text in an event"
    if not isinstance(change.get("why"), str | None):
        return "why is no text in an event"
    return None


def fault_of_report(report: object) -> str | None:
    """Name the implausible part of a run's report; None: all of it is plausible."""
    if not isinstance(report, dict):
        return "its report is no object"
    for name in ("stop_reason", "message", "schedule"):
        if not isinstance(report.get(name), str | None):
            return f"{name} is no text in its report"
    guard = report.get("guard") or {}
    if not isinstance(guard, dict) or not _are_texts(guard.get("reasons")):
        return "guard has no list of texts as its reasons in its report"
    if not _are_texts(report.get("warnings")):
        return "warnings is no list of texts in its report"
    rows = report.get("rows", 0)
    if not isinstance(rows, int) or not 0 <= rows <= _MOST:
        return "rows is no count in its report"
    return None


def _are_texts(found: Any) -> bool:  # noqa: ANN401 - JSON
    """Whether it is a list of texts, or None."""
    texts = found or []
    return isinstance(texts, list) and all(isinstance(each, str) for each in texts)
