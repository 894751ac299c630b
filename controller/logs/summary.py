"""Summarises a log block by block: rows, losses, extremes, the run's end."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.detector.state import State
from haptic_wall.controller.logs.pieces import Damage, End, Event, Head, Misplaced, Piece
from haptic_wall.controller.logs.rows import LogRows, gathered
from haptic_wall.controller.logs.walls import told_in
from haptic_wall.controller.runtime.statistics import RunStatistics
from haptic_wall.controller.runtime.telemetry import FLAG_CONTACT, FLAG_OFF, FLAG_WARM_UP
from haptic_wall.controller.system.printable import in_line
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.hw.servo import Outcome

MOST_CHANGES = 1000
"""Number of changes of the running wall that a summary holds: the last ones"""


@dataclass(slots=True)
class LogPart:
    """The part of a file that comes from one log: all of it, unless logs were joined."""

    metadata: Mapping[str, Any]
    """Metadata of the log; of later parts only the name"""
    rows: int = 0
    first_ns: int = 0
    """Deadline of the first row [ns]"""
    last_ns: int = 0
    """Deadline of the last row [ns]"""
    ended: Mapping[str, Any] | None = None
    """The run's end, as the log gives it; None: it does not"""

    @property
    def elapsed_ns(self) -> int:
        """Return the time from the first row to the last [ns]."""
        return self.last_ns - self.first_ns


class LogSummary:
    """Counts a log's pieces in bounded memory.

    Args:
        begins: The first row should be the run's first; otherwise earlier rows are missing on
            purpose.
        metadata: Metadata of the log.
        watched: The rows contain the detector's state.

    Attributes:
        rows: Number of rows.
        parts: One, or more where logs are joined in one file.
    """

    def __init__(self, begins: bool, metadata: Mapping[str, Any], watched: bool = True) -> None:
        self.rows = 0
        self._watched = watched
        self.parts = [LogPart(metadata)]
        self._statistics = RunStatistics()
        self._next_seq: int | None = 0 if begins else None
        self._after_damage = False
        self._places = self._damaged_bytes = 0
        self._last_damage: Damage | None = None
        self._why: str | None = None
        self._damaged_rows = self._unrecorded = 0
        self._unknown = False
        self._late = self._twice = 0
        self._missed = self._failed = self._contact = self._warm_up = self._off = 0
        self._position = [math.inf, -math.inf]
        self._torque = [math.inf, -math.inf]
        self._worst = State.QUIET
        self._oscillating = 0
        self._first_oscillation_ns: int | None = None
        self._latest = (-1, 0)
        self._phases: set[int] = set()
        self._changes = 0
        self._last_changes: deque[dict[str, Any]] = deque(maxlen=MOST_CHANGES)

    def add(self, piece: Piece) -> None:
        """Count the next piece of the log."""
        told = told_in(piece)
        self._changes += len(told)
        self._last_changes.extend(told)
        if isinstance(piece, Damage):
            self._add_damage(piece)
        elif isinstance(piece, Misplaced):
            self._add_misplaced(piece)
        elif isinstance(piece, Head):
            self._begin(piece.metadata)
        elif isinstance(piece, Event):
            pass
        elif isinstance(piece, End):
            self.parts[-1].ended = piece.ended
            self._count_missing(int(piece.ended.get("rows", self._next_seq or 0)))
        else:
            self._add_rows(piece)

    def _begin(self, metadata: Mapping[str, Any]) -> None:
        """Continue with another log, which is joined to the one before."""
        if self.parts[-1].rows == 0 and self.parts[-1].ended is None:
            self.parts.pop()
        names = {
            name: in_line(text)
            for name in ("name", "program")
            if isinstance(text := metadata.get(name), str)
        }
        self.parts.append(LogPart(names if self.parts else metadata))
        self._next_seq = None if "cut" in metadata else 0
        self._unknown = self._unknown or self._after_damage
        self._after_damage = False

    def _add_damage(self, damage: Damage) -> None:
        self._places += 1
        self._damaged_bytes += damage.size
        self._last_damage = damage
        self._why = self._why or damage.why
        self._after_damage = True

    def _add_misplaced(self, found: Misplaced) -> None:
        """Count omitted rows; those that came late were counted as missing before."""
        late = found.rows - found.twice
        self._twice += found.twice
        self._late += late
        recorded = min(late, self._unrecorded)
        self._unrecorded -= recorded
        self._damaged_rows = max(0, self._damaged_rows - (late - recorded))

    def _count_missing(self, seq: int) -> None:
        """Count the missing rows between the last one and the one numbered ``seq``."""
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
        part = self.parts[-1]
        if part.rows == 0:
            part.first_ns = int(rows["deadline_ns"][0])
        part.last_ns = int(rows["deadline_ns"][-1])
        part.rows += len(rows)
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

    def report(self, origin_ns: int) -> dict[str, Any]:
        """Return the summary for JSON; times since ``origin_ns`` [ns], None for unknown values."""

        def since(instant_ns: int | None) -> float | None:
            return None if instant_ns is None else (instant_ns - origin_ns) / 1e9

        some = self.rows > 0
        filled = [part for part in self.parts if part.rows]
        elapsed = sum(part.elapsed_ns for part in filled) / 1e9
        damage = self._last_damage
        parts = [
            {
                "name": part.metadata.get("name"),
                "program": part.metadata.get("program"),
                "rows": part.rows,
                "from_s": since(part.first_ns) if part.rows else None,
                "to_s": since(part.last_ns) if part.rows else None,
                **_told(part.ended),
            }
            for part in self.parts
        ]
        return {
            "rows": self.rows,
            "parts": parts,
            "from_s": since(filled[0].first_ns) if some else None,
            "to_s": since(filled[-1].last_ns) if some else None,
            "duration_s": elapsed if some else None,
            "rate_hz": (self.rows - len(filled)) / elapsed if elapsed else None,
            "missed_ticks": self._missed if some else None,
            "failed_readings": self._failed if some else None,
            "unrecorded_rows": self._unrecorded if some else None,
            "misplaced_rows": {"late": self._late, "twice": self._twice},
            "damaged": {
                "places": self._places,
                "bytes": self._damaged_bytes,
                "rows": None if self._after_damage or self._unknown else self._damaged_rows,
                "cut_off": damage is not None and damage.last,
                **({} if self._why is None else {"why": self._why}),
            },
            "position_rad": _span(self._position),
            "torque_nm": _span(self._torque),
            "saturated_ticks": self._statistics.saturated if some else None,
            "warm_up_ticks": self._warm_up if some else None,
            "off_ticks": self._off if some else None,
            "contact_ticks": self._contact if some else None,
            "oscillation": {
                "state": self._worst.name.lower() if some and self._watched else None,
                "first_s": since(self._first_oscillation_ns),
                "ticks": self._oscillating,
            },
            "lateness_us": self._statistics.lateness.as_report(50, 99, 99.9)
            | {"max_at_s": since(self._latest[1]) if self._latest[0] >= 0 else None},
            "phases": len(self._phases),
            "changes": {"count": self._changes, "last": list(self._last_changes)},
            **_told(self.parts[-1].ended),
        }


def summarised(rows: LogRows) -> LogSummary:
    """Return the summary of a log, or of a stretch of it."""
    begins = rows.stretch.start_s <= 0.0 and "cut" not in rows.metadata
    summary = LogSummary(begins, rows.metadata, rows.watched)
    for piece in gathered(rows.pieces()):
        summary.add(piece)
        del piece  # free it before the next one is made
    return summary


def _told(ended: Mapping[str, Any] | None) -> dict[str, Any]:
    """Return the end of a run for the report; None: the log does not contain it."""
    ended = ended or {}
    return {
        "stop_reason": ended.get("stop_reason"),
        "message": ended.get("message") or None,
        "schedule": ended.get("schedule"),
        "guard": ended.get("guard"),
        "warnings": ended.get("warnings") or [],
    }


def _span(extremes: list[float]) -> list[float] | None:
    return list(extremes) if extremes[0] <= extremes[1] else None
