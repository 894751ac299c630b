"""Summarises a log block by block: rows, losses, extremes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.detector.state import State
from haptic_wall.controller.logs.reader import LogReader
from haptic_wall.controller.runtime.statistics import RunStatistics
from haptic_wall.controller.runtime.telemetry import FLAG_CONTACT, FLAG_OFF, FLAG_WARM_UP
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.hw.servo import Outcome

MOST_CHANGES = 1000
"""Number of changes of the running wall that a summary holds: the last ones"""


class LogSummary:
    """Counts a log's rows in bounded memory.

    Args:
        begins: The first row should be the run's first; otherwise earlier rows are left out.

    Attributes:
        rows: Number of rows.
    """

    def __init__(self, begins: bool) -> None:
        self.rows = 0
        self._first_ns = self._last_ns = 0
        self._statistics = RunStatistics()
        self._next_seq: int | None = 0 if begins else None
        self._unrecorded = 0
        self._missed = self._failed = self._contact = self._warm_up = self._off = 0
        self._position = [math.inf, -math.inf]
        self._torque = [math.inf, -math.inf]
        self._worst = State.QUIET
        self._oscillating = 0
        self._first_oscillation_ns: int | None = None
        self._latest = (-1, 0)
        self._phases: set[int] = set()

    def count_missing(self, seq: int) -> None:
        """Count the missing rows between the last one and the one numbered ``seq``."""
        self._unrecorded += 0 if self._next_seq is None else max(0, seq - self._next_seq)

    def add(self, rows: NDArray[np.void]) -> None:
        """Count the next rows of the log, shape (n,), n > 0."""
        first, last = int(rows["seq"][0]), int(rows["seq"][-1])
        self.count_missing(first)
        self._unrecorded += max(0, last + 1 - first - len(rows))
        self._next_seq = last + 1
        if self.rows == 0:
            self._first_ns = int(rows["deadline_ns"][0])
        self._last_ns = int(rows["deadline_ns"][-1])
        self.rows += len(rows)
        self._statistics.add(rows)
        self._missed += int(rows["missed"].sum())
        good = np.isin(rows["outcome"], (Outcome.OK, Outcome.WAITING))
        self._failed += int(np.count_nonzero(~good))
        on = (rows["flags"] & FLAG_WARM_UP) == 0
        self._warm_up += int(np.count_nonzero(~on))
        self._off += int(np.count_nonzero(rows["flags"] & FLAG_OFF))
        # While the wall is off there is no contact, wherever the shaft is.
        touched = (rows["flags"] & (FLAG_CONTACT | FLAG_WARM_UP | FLAG_OFF)) == FLAG_CONTACT
        self._contact += int(np.count_nonzero(touched))
        for extremes, field in ((self._position, "position"), (self._torque, "torque")):
            values: FloatArray = rows[field]
            known = values[np.isfinite(values)]
            if known.size:
                extremes[0] = min(extremes[0], float(known.min()))
                extremes[1] = max(extremes[1], float(known.max()))
        phases = rows["phase"]
        self._phases.update(np.unique(phases[phases >= 0]).tolist())
        late = np.where(on, rows["lateness_ns"], -1)
        at = int(np.argmax(late))
        self._latest = max(self._latest, (int(late[at]), int(rows["deadline_ns"][at])))
        self._add_oscillation(rows)

    def _add_oscillation(self, rows: NDArray[np.void]) -> None:
        self._worst = max(self._worst, State(int(rows["oscillation"].max())))
        oscillates = np.flatnonzero(rows["oscillation"] >= State.SUSTAINED)
        self._oscillating += oscillates.size
        if oscillates.size and self._first_oscillation_ns is None:
            self._first_oscillation_ns = int(rows["deadline_ns"][oscillates[0]])

    def report(self, log: LogReader) -> dict[str, Any]:
        """Return the summary of a log for JSON; None for unknown values."""
        origin_ns = log.origin_ns

        def since(instant_ns: int | None) -> float | None:
            return None if instant_ns is None else (instant_ns - origin_ns) / 1e9

        some = self.rows > 0
        elapsed = (self._last_ns - self._first_ns) / 1e9
        end = log.end or {}
        return {
            "rows": self.rows,
            "from_s": since(self._first_ns) if some else None,
            "to_s": since(self._last_ns) if some else None,
            "duration_s": elapsed if some else None,
            "rate_hz": (self.rows - 1) / elapsed if elapsed else None,
            "missed_ticks": self._missed if some else None,
            "failed_readings": self._failed if some else None,
            "unrecorded_rows": self._unrecorded if some else None,
            "position_rad": _span(self._position),
            "torque_nm": _span(self._torque),
            "saturated_ticks": self._statistics.saturated if some else None,
            "warm_up_ticks": self._warm_up if some else None,
            "off_ticks": self._off if some else None,
            "contact_ticks": self._contact if some else None,
            "oscillation": {
                "state": self._worst.name.lower() if some else None,
                "first_s": since(self._first_oscillation_ns),
                "ticks": self._oscillating,
            },
            "lateness_us": self._statistics.lateness.as_report(50, 99, 99.9)
            | {"max_at_s": since(self._latest[1]) if self._latest[0] >= 0 else None},
            "phases": len(self._phases),
            "changes": {"count": len(log.changes), "last": list(log.changes[-MOST_CHANGES:])},
            "stop_reason": end.get("stop_reason"),
            "message": end.get("message") or None,
            "schedule": end.get("schedule"),
            "guard": end.get("guard"),
            "warnings": end.get("warnings") or [],
        }


def summarised(log: LogReader) -> LogSummary:
    """Count the rows of a log, or of a stretch of it."""
    summary = LogSummary(begins=log.stretch.start_s <= 0.0)
    for rows in log.blocks():
        summary.add(rows)
    if log.end is not None and log.stretch.end_s == math.inf:
        summary.count_missing(int(log.end.get("rows", 0)))
    return summary


def _span(extremes: list[float]) -> list[float] | None:
    return list(extremes) if extremes[0] <= extremes[1] else None
