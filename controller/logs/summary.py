"""Summarises a log block by block: rows, losses, extremes."""

from __future__ import annotations

import math
from collections import Counter
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


def summarised(log: LogReader) -> dict[str, Any]:
    """Summarise a log, or a stretch of it, for JSON; None for unknown values."""
    begins = log.stretch.start_s <= 0.0  # else rows before the first are left out, not missing
    counts, statistics = Counter[str](), RunStatistics()
    next_seq: int | None = 0 if begins else None
    first_ns = last_ns = 0
    position, torque = [math.inf, -math.inf], [math.inf, -math.inf]
    worst, oscillates_ns, latest = State.QUIET, None, (-1, 0)
    phases: set[int] = set()
    for rows in log.blocks():
        seq, times, flags = rows["seq"], rows["deadline_ns"], rows["flags"]
        before = int(seq[0]) if next_seq is None else next_seq
        next_seq = int(seq[-1]) + 1
        first_ns = first_ns if counts["rows"] else int(times[0])
        last_ns = int(times[-1])
        on = (flags & FLAG_WARM_UP) == 0
        oscillates = np.flatnonzero(rows["oscillation"] >= State.SUSTAINED)
        counts.update(
            rows=len(rows),
            unrecorded=next_seq - before - len(rows),
            missed=int(rows["missed"].sum()),
            failed=_count(~np.isin(rows["outcome"], (Outcome.OK, Outcome.WAITING))),
            warm_up=_count(~on),
            off=_count(flags & FLAG_OFF),
            # While the wall is off there is no contact, wherever the shaft is.
            contact=_count((flags & (FLAG_CONTACT | FLAG_WARM_UP | FLAG_OFF)) == FLAG_CONTACT),
            oscillating=oscillates.size,
        )
        statistics.add(rows)
        _widen(position, rows["position"])
        _widen(torque, rows["torque"])
        phases.update(np.unique(rows["phase"][rows["phase"] >= 0]).tolist())
        late = np.where(on, rows["lateness_ns"], -1)
        at = int(np.argmax(late))
        latest = max(latest, (int(late[at]), int(times[at])))
        worst = max(worst, State(int(rows["oscillation"].max())))
        if oscillates.size and oscillates_ns is None:
            oscillates_ns = int(times[oscillates[0]])
    end = log.end or {}
    if log.end is not None and log.stretch.end_s == math.inf and next_seq is not None:
        counts["unrecorded"] += max(0, int(end.get("rows", 0)) - next_seq)
    some = counts["rows"] > 0

    def known(name: str) -> int | None:
        return counts[name] if some else None

    def since(instant_ns: int | None) -> float | None:
        return None if instant_ns is None else (instant_ns - log.origin_ns) / 1e9

    elapsed = (last_ns - first_ns) / 1e9
    return {
        "rows": counts["rows"],
        "from_s": since(first_ns) if some else None,
        "to_s": since(last_ns) if some else None,
        "duration_s": elapsed if some else None,
        "rate_hz": (counts["rows"] - 1) / elapsed if elapsed else None,
        "missed_ticks": known("missed"),
        "failed_readings": known("failed"),
        "unrecorded_rows": known("unrecorded"),
        "position_rad": _span(position),
        "torque_nm": _span(torque),
        "saturated_ticks": statistics.saturated if some else None,
        "warm_up_ticks": known("warm_up"),
        "off_ticks": known("off"),
        "contact_ticks": known("contact"),
        "oscillation": {
            "state": worst.name.lower() if some else None,
            "first_s": since(oscillates_ns),
            "ticks": counts["oscillating"],
        },
        "lateness_us": statistics.lateness.as_report(50, 99, 99.9)
        | {"max_at_s": since(latest[1]) if latest[0] >= 0 else None},
        "phases": len(phases),
        "changes": {"count": len(log.changes), "last": list(log.changes[-MOST_CHANGES:])},
        "stop_reason": end.get("stop_reason"),
        "message": end.get("message") or None,
        "schedule": end.get("schedule"),
        "guard": end.get("guard"),
        "warnings": end.get("warnings") or [],
    }


def _count(which: NDArray[Any]) -> int:
    return int(np.count_nonzero(which))


def _widen(extremes: list[float], values: FloatArray) -> None:
    """Widen a range to hold the finite ones of some values."""
    known = values[np.isfinite(values)]
    if known.size:
        extremes[:] = [min(extremes[0], float(known.min())), max(extremes[1], float(known.max()))]


def _span(extremes: list[float]) -> list[float] | None:
    return list(extremes) if extremes[0] <= extremes[1] else None
