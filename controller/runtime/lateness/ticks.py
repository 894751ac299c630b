"""Finds the late ticks of a run with one comparison each, and explains them from counters.

A tick in time costs only the comparison. The thread's counters are read after a late tick, and
every 20 ms in the idle window before a sleep. The difference of two readings, less the usual
growth, shows what happened. Memory is bounded: the worst ticks are kept, the others are counted by
their cause.
"""

from __future__ import annotations

import gc
import time
from bisect import insort
from collections.abc import Callable
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, Literal

from haptic_wall.controller.runtime.deadlines import Waiter
from haptic_wall.controller.runtime.lateness.causes import (
    Cause,
    Late,
    Machine,
    evidence,
    likely_cause,
)
from haptic_wall.controller.runtime.lateness.overshoots import Overshoots
from haptic_wall.controller.runtime.lateness.thread_counters import CounterReader, Counters

LATE_NS = 100_000
"""A tick that took this much longer than necessary is late [ns]; ..."""
LATE_SHARE = 0.1
"""... and at least this fraction of a period."""
LONG_WAIT_SHARE = 0.7
"""A bus wait of this fraction of a period is long. A reply is given up 0.8 of one after the
wake-up, and sending the request takes a part of that: so a tick with a lost reply counts."""
WORST = 10
"""Number of late ticks that are kept"""
REST_NS = 20_000_000
"""Period of the readings in the idle window [ns]: the resolution of the causes"""
STEAL_RESTS = 50
"""Number of these readings per reading of the steal, which takes longer"""
STALL_NS = 5_000_000
"""A tick overdue by this much, and by ..."""
STALL_PERIODS = 2
"""... as many periods is a stall, which may end a run ..."""
RECENT_NS = 500_000_000
"""... within this time [ns]"""
_SLACK = 10
"""Free time needed for a reading, in multiples of its cost with warm caches"""


@dataclass(frozen=True, slots=True)
class _Kept:
    """One of the worst ticks."""

    overdue_ns: int
    deadline_ns: int
    lateness_ns: int
    missed: int
    late: Late
    cause: Cause


class LateTicks:
    """Finds late ticks of one loop, in the loop's own thread.

    Args:
        machine: Its known properties.
        reader: Of this thread's counters.
        period_ns: Period of the grid [ns].

    Attributes:
        limits: Three numbers: the longest time of a tick from its deadline to its end without bus
            waits [ns]; its longest bus wait [ns]; the number of ticks between calls of ``rest``.
    """

    def __init__(self, machine: Machine, reader: CounterReader, period_ns: int) -> None:
        self._rest_ticks = max(1, REST_NS // period_ns)
        self.limits: tuple[float, float, float] = (
            max(LATE_NS, int(LATE_SHARE * period_ns)),
            int(LONG_WAIT_SHARE * period_ns),
            self._rest_ticks,
        )
        self._machine = machine
        self._reader = reader
        self._cost_ns = _cost_ns(reader.read)
        self._steal_cost_ns = _cost_ns(reader.steal_ns)
        self._period_ns = period_ns
        self._first_ns: int | None = None
        self._ended_ns = 0  # end of the last late tick
        self._stall = 0, 0  # end and duration of the longest recent stall
        self._continued = False
        self._collecting_ns = 0
        self._collected_ns = self._collections = 0
        self._stops = 0
        self._replies_lost = 0
        self._rests = 0
        self._last = reader.read()
        self._steal_ns = reader.steal_ns()
        self._usual = Counters(0, 0, 0, 0, 0, 0, 0)  # of all quiet times

    def __enter__(self) -> LateTicks:
        gc.callbacks.append(self._on_collection)
        return self

    def __exit__(self, *_: object) -> None:
        gc.callbacks.remove(self._on_collection)
        self._reader.close()

    def begin(self, deadline_ns: int) -> None:
        """Count from here on.

        Args:
            deadline_ns: The next deadline [ns]; at the first call the beginning of the log.
        """
        if self._first_ns is None:
            self._first_ns = deadline_ns
        self._worst: list[_Kept] = []
        self._causes = dict.fromkeys(Cause, 0)
        self._late = 0
        self._overshoots = Overshoots()
        self._begun = self._reader.read()
        self._begun_steal_ns = self._reader.steal_ns()
        self._begun_collections = self._collections
        self._begun_stops = self._stops

    def continued(self) -> None:
        """Record a SIGCONT: the process may have been stopped. For a signal handler."""
        self._continued = True
        self._stops += 1

    def late(
        self,
        deadline_ns: int,
        woke_ns: int,
        ended_ns: int,
        waiter: Waiter,
        bus_ns: int,
        replies_lost: int,
        missed: int,
        offsets: tuple[int, int, int] = (0, 0, 0),
    ) -> None:
        """Explain a tick that took longer than ``limits`` allow; ignore any other.

        Args:
            deadline_ns: Its deadline [ns].
            woke_ns: When the loop woke for it [ns].
            ended_ns: When it was over [ns].
            waiter: The loop's waiter.
            bus_ns: Its bus wait [ns].
            replies_lost: Total since the servo's start.
            missed: Whole periods that it made the loop skip.
            offsets: Time taken out of an elastic clock by then, at the first three instants [ns].
        """
        due_at, woke_at, ended_at = offsets
        woke_ns, ended_ns = woke_ns + woke_at, ended_ns + ended_at
        # The time of the tick before is not its fault.
        due_ns = max(deadline_ns + due_at, self._ended_ns)
        self._ended_ns = ended_ns
        held_ns = woke_ns - due_ns
        asleep_ns = max(0, min(waiter.slept_ns + woke_at - due_ns, held_ns))
        work_ns = ended_ns - woke_ns - bus_ns
        if held_ns + work_ns <= self.limits[0] and bus_ns <= self.limits[1]:
            return
        counters = self._reader.read()
        grown = counters.less(self._last)
        self._last = counters
        steal_ns = None
        # The cost of this explanation is not the next tick's fault: at high rates it would make the
        # next tick late, which would need another explanation, and so on.
        self._ended_ns = max(ended_ns, counters.at_ns)
        overdue_ns = ended_ns - due_ns
        if overdue_ns > self._period_ns:
            steal_ns = self._steal_since()
            self._ended_ns += self._steal_cost_ns
        if overdue_ns > max(STALL_NS, STALL_PERIODS * self._period_ns):
            end_ns, longest_ns = self._stall
            if overdue_ns >= longest_ns or ended_ns - end_ns > RECENT_NS:
                self._stall = ended_ns, overdue_ns
        lost = replies_lost > self._replies_lost
        self._replies_lost = replies_lost
        late = Late(
            asleep_ns,
            held_ns - asleep_ns,
            work_ns,
            bus_ns,
            bus_ns > self.limits[1],
            lost,
            self._continued,
            self._collected_ns,
            grown.less(self._usual, (grown.at_ns - overdue_ns) / max(1, self._usual.at_ns)),
            steal_ns,
        )
        self._continued = False
        self._collected_ns = 0
        cause = likely_cause(late, self._machine)
        self._late += 1
        self._causes[cause] += 1
        self._overshoots.add(deadline_ns, waiter, 1)
        if len(self._worst) < WORST or overdue_ns > self._worst[0].overdue_ns:
            lateness_ns = woke_ns - deadline_ns - due_at
            kept = _Kept(overdue_ns, deadline_ns, lateness_ns, missed, late, cause)
            insort(self._worst, kept, key=attrgetter("overdue_ns"))
            del self._worst[:-WORST]

    def rest(self, deadline_ns: int, waiter: Waiter, free_ns: int, replies_lost: int) -> int:
        """Read the counters in the idle window, as the reference of a later reading.

        Args:
            deadline_ns: The last one [ns].
            waiter: The loop's waiter.
            free_ns: Until the next deadline [ns].
            replies_lost: Total since the servo's start.

        Returns:
            The number of ticks until the next call.
        """
        # Events this old cannot explain future ticks.
        self._replies_lost = replies_lost
        self._continued = False
        self._collected_ns = 0
        if free_ns < _SLACK * self._cost_ns:
            return self._rest_ticks
        self._overshoots.add(deadline_ns, waiter, self._rest_ticks)  # one sample represents as many
        counters = self._reader.read()
        grown = counters.less(self._last)
        self._last = counters
        if grown.at_ns * 2 > self._rest_ticks * self._period_ns:
            self._usual = self._usual.less(grown, -1.0)
        self._rests += 1
        if self._rests % STEAL_RESTS == 0 and free_ns > _SLACK * self._steal_cost_ns:
            self._steal_ns = self._reader.steal_ns()
        return self._rest_ticks

    def stalled_s(self, now_ns: int) -> float:
        """Return the longest stall of the last half second before ``now_ns`` [s]; 0: none."""
        end_ns, longest_ns = self._stall
        return longest_ns * 1e-9 if now_ns - end_ns <= RECENT_NS else 0.0

    def report(self) -> dict[str, Any]:
        """Return late ticks with their causes, and counts since ``begin``, for JSON."""
        grown = self._reader.read().less(self._begun)
        return {
            "limit_us": self.limits[0] / 1e3,
            "late_ticks": self._late,
            "causes": {cause.value: n for cause, n in self._causes.items() if n},
            "worst": [self._told(kept) for kept in reversed(self._worst)],
            "sleep_overshoot_us": self._overshoots.as_report(),
            "on_core_s": grown.on_core_ns / 1e9,
            "run_queue_delay_ms": (
                _milli(grown.run_delay_ns) if self._machine.knows_run_delay else None
            ),
            "minor_faults": grown.minor_faults,
            "major_faults": grown.major_faults,
            "voluntary_switches": grown.voluntary,
            "involuntary_switches": grown.involuntary,
            "steal_ms": _milli(_growth(self._begun_steal_ns, self._reader.steal_ns())),
            "garbage_collections": self._collections - self._begun_collections,
            "stops": self._stops - self._begun_stops,
        }

    def _told(self, kept: _Kept) -> dict[str, Any]:
        """Return one of the worst ticks, for JSON."""
        assert self._first_ns is not None
        return {
            "time_s": (kept.deadline_ns - self._first_ns) / 1e9,
            "lateness_us": kept.lateness_ns / 1e3,
            "work_us": kept.late.work_ns / 1e3,
            "bus_us": kept.late.bus_ns / 1e3,
            "missed": kept.missed,
            "cause": kept.cause.value,
            "evidence": evidence(kept.cause, kept.late, self._machine),
        }

    def _steal_since(self) -> int | None:
        before, self._steal_ns = self._steal_ns, self._reader.steal_ns()
        return _growth(before, self._steal_ns)

    def _on_collection(self, phase: Literal["start", "stop"], _info: dict[str, int]) -> None:
        now_ns = time.monotonic_ns()
        if phase == "start":
            self._collecting_ns = now_ns
        else:
            self._collected_ns += now_ns - self._collecting_ns
            self._collections += 1


def _growth(before_ns: int | None, after_ns: int | None) -> int | None:
    return None if before_ns is None or after_ns is None else after_ns - before_ns


def _milli(time_ns: int | None) -> float | None:
    return None if time_ns is None else time_ns / 1e6


def _cost_ns(read: Callable[[], object]) -> int:
    """Return the cost of a reading [ns]: the median of five."""
    times = []
    for _ in range(5):
        began = time.monotonic_ns()
        read()
        times.append(time.monotonic_ns() - began)
    return sorted(times)[2]
