"""What a log holds, told from its blocks one after the other: rows, losses, extremes, the end."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from controller.detector.oscillation import State
from controller.log.reader import Damage, End
from controller.log.rows import LogRows, gathered
from controller.statistics import RunStatistics
from controller.telemetry import FLAG_CONTACT, FLAG_OFF, FLAG_WARM_UP
from hw.servo import Outcome


class LogSummary:
    """Counts a log's pieces in memory that does not grow.

    Args:
        begins: Whether the first row should be the run's first: else rows that lack before it were
            cut away on purpose.

    Attributes:
        rows: Rows that are there.
        ended: How the run ended, as the log tells; None: it does not.
    """

    def __init__(self, begins: bool) -> None:
        self.rows = 0
        self.ended: dict[str, Any] | None = None
        self._statistics = RunStatistics()
        self._next_seq: int | None = 0 if begins else None
        self._first_ns = self._last_ns = 0
        self._after_damage = False
        self._damaged: list[Damage] = []
        self._damaged_rows = self._unrecorded = 0
        self._missed = self._failed = self._contact = self._warm_up = self._off = 0
        self._position = [math.inf, -math.inf]
        self._torque = [math.inf, -math.inf]
        self._worst = State.QUIET
        self._oscillating = 0
        self._first_oscillation_ns: int | None = None
        self._latest = (-1, 0)
        self._phases: set[int] = set()

    def add(self, piece: NDArray[np.void] | Damage | End) -> None:
        """Count the next piece of the log."""
        if isinstance(piece, Damage):
            self._damaged.append(piece)
            self._after_damage = True
        elif isinstance(piece, End):
            self.ended = piece.ended
            self._count_missing(int(piece.ended.get("rows", self._next_seq or 0)))
        else:
            self._add_rows(piece)

    def _count_missing(self, seq: int) -> None:
        """Rows between the last and the one numbered ``seq`` lack, whatever the reason."""
        missing = 0 if self._next_seq is None else max(0, seq - self._next_seq)
        if self._after_damage:
            self._damaged_rows += missing
        else:
            self._unrecorded += missing
        self._after_damage = False

    def _add_rows(self, rows: NDArray[np.void]) -> None:
        first, last = int(rows["seq"][0]), int(rows["seq"][-1])
        self._count_missing(first)
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
        # A shaft inside a wall that is off touches nothing.
        touched = (rows["flags"] & (FLAG_CONTACT | FLAG_WARM_UP | FLAG_OFF)) == FLAG_CONTACT
        self._contact += int(np.count_nonzero(touched))
        for extremes, field in ((self._position, "position"), (self._torque, "torque")):
            known = rows[field][np.isfinite(rows[field])]
            if known.size:
                extremes[0] = min(extremes[0], float(known.min()))
                extremes[1] = max(extremes[1], float(known.max()))
        self._phases.update(np.unique(rows["phase"]).tolist())
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

    def report(self, origin_ns: int) -> dict[str, Any]:
        """All of it as JSON can hold it; times since ``origin_ns`` [ns], what is not known None."""

        def since(instant_ns: int | None) -> float | None:
            return None if instant_ns is None else (instant_ns - origin_ns) / 1e9

        some = self.rows > 0
        elapsed = (self._last_ns - self._first_ns) / 1e9
        ended = self.ended or {}
        return {
            "rows": self.rows,
            "from_s": since(self._first_ns) if some else None,
            "to_s": since(self._last_ns) if some else None,
            "duration_s": elapsed if some else None,
            "rate_hz": (self.rows - 1) / elapsed if elapsed else None,
            "missed_ticks": self._missed if some else None,
            "failed_readings": self._failed if some else None,
            "unrecorded_rows": self._unrecorded if some else None,
            "damaged": {
                "places": len(self._damaged),
                "bytes": sum(damage.size for damage in self._damaged),
                "rows": None if self._after_damage else self._damaged_rows,
                "cut_off": bool(self._damaged) and self._damaged[-1].last,
            },
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
            "stop_reason": ended.get("stop_reason"),
            "message": ended.get("message") or None,
        }


def summarised(rows: LogRows) -> LogSummary:
    """The summary of a log, or of a stretch of it."""
    begins = rows.stretch.start_s <= 0.0 and "cut" not in rows.log.metadata
    summary = LogSummary(begins)
    for piece in gathered(rows.pieces()):
        summary.add(piece)
        del piece  # or it would be there while the next one is put together
    return summary


def _span(extremes: list[float]) -> list[float] | None:
    return list(extremes) if extremes[0] <= extremes[1] else None
