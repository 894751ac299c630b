"""Finds the events in a run's rows: alarms, changes of stiffness, losses, missed ticks, on and off.

Rows come in blocks of any size; their division has no effect on the marks.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.detector.state import State
from haptic_wall.controller.live.log_events import change_text
from haptic_wall.controller.runtime.telemetry import FLAG_OFF, FLAG_WARM_UP
from haptic_wall.hw.servo import Outcome

SETTLED_S: Final = 0.1
"""Pause after which the next loss, or step of the stiffness, is another event [s]"""
LEAST_STEP: Final = 0.01
"""Smallest relative change of the stiffness that is reported [1]"""
_LOST: Final = {"lost": ("reply lost", "replies lost"), "missed": ("tick missed", "ticks missed")}


@dataclass(frozen=True, slots=True)
class Mark:
    """An event."""

    time_s: float
    """Time since the run's first row [s]"""
    kind: str
    """``alarm``, ``reduction``, ``loss``, ``change``, ``wall``, ``note`` or ``end``"""
    words: str

    def plain(self) -> dict[str, object]:
        """Return the mark in JSON types."""
        return {"t": self.time_s, "kind": self.kind, "words": self.words}


def change_mark(change: Mapping[str, Any]) -> Mark:
    """Return the mark of a change of the wall; ``change`` is as in a report."""
    return Mark(change["at_s"], "change", change_text(change))


@dataclass(slots=True)
class _Burst:
    """A burst of events that counts as one event."""

    begin_s: float
    last_s: float
    amount: float
    """Their number; of the stiffness, its value before [N·m/rad]"""


class MarkFinder:
    """Finds the events of one run; call ``look`` with all its rows in order."""

    def __init__(self) -> None:
        self._state = 0
        self._off: bool | None = None
        self._stiffness = math.nan
        self._bursts: dict[str, _Burst] = {}

    def look(self, rows: NDArray[np.void], origin_ns: int) -> list[Mark]:
        """Process the next rows; return the events that are complete.

        Args:
            rows: Shape (n,), n > 0, dtype ``telemetry.ROW``.
            origin_ns: Zero of the time [ns].
        """
        time = (rows["deadline_ns"] - origin_ns) * 1e-9
        fine = rows["outcome"] == Outcome.OK
        off = (rows["flags"] & (FLAG_WARM_UP | FLAG_OFF)) != 0
        before = np.concatenate(([self._stiffness], rows["stiffness"][:-1]))
        stepped = (rows["stiffness"] != before) & ~np.isnan(before)
        was_off = np.concatenate(([off[0] if self._off is None else self._off], off[:-1]))
        states = rows["oscillation"]
        was = np.concatenate(([self._state], states[:-1]))
        alarm = (states > was) & (states >= State.SUSTAINED)
        notable = ~fine | (rows["missed"] > 0) | stepped | (off != was_off) | alarm
        marks: list[Mark] = []
        for i in np.flatnonzero(notable):
            now_s = float(time[i])
            marks += self._ended(now_s, float(before[i]))
            if alarm[i]:
                words = f"oscillation: {State(int(states[i])).name.lower()}"
                marks.append(Mark(now_s, "alarm", words))
            if off[i] != was_off[i]:
                words = "the wall is off" if off[i] else "the wall is on"
                marks.append(Mark(now_s, "wall", words))
            if not fine[i]:
                self._count("lost", now_s, 1.0)
            if rows["missed"][i] > 0:
                self._count("missed", now_s, float(rows["missed"][i]))
            if stepped[i]:
                burst = self._bursts.setdefault("step", _Burst(now_s, now_s, float(before[i])))
                burst.last_s = now_s
        self._state, self._off = int(states[-1]), bool(off[-1])
        self._stiffness = float(rows["stiffness"][-1])
        return marks + self._ended(float(time[-1]), self._stiffness)

    def _count(self, what: str, now_s: float, amount: float) -> None:
        burst = self._bursts.setdefault(what, _Burst(now_s, now_s, 0.0))
        burst.amount += amount
        burst.last_s = now_s

    def _ended(self, now_s: float, stiffness: float) -> list[Mark]:
        """Return the bursts that are over."""
        over = [kind for kind, each in self._bursts.items() if now_s > each.last_s + SETTLED_S]
        marks = []
        for kind in over:
            burst = self._bursts.pop(kind)
            if kind != "step":
                count = int(burst.amount)
                words = f"{count} {_LOST[kind][count > 1]}"
                marks.append(Mark(burst.begin_s, "loss", words))
            elif not min(stiffness, burst.amount) > 0.0:
                continue  # the wall came on, or went off
            elif abs(stiffness - burst.amount) > LEAST_STEP * max(stiffness, burst.amount):
                which = "reduction" if stiffness < burst.amount else "change"
                words = f"stiffness {burst.amount:.4g} → {stiffness:.4g} N·m/rad"
                marks.append(Mark(burst.begin_s, which, words))
        return marks
