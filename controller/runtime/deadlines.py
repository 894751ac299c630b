"""The fixed grid of deadlines: when the next tick is, and how to be there in time."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Protocol

from haptic_wall.controller.settings.shares import SPIN_SHARE
from haptic_wall.hw.clock import Clock, SimulatedClock

if TYPE_CHECKING:
    from haptic_wall.controller.runtime.rehearsal import Rehearsal

SPIN_MIN_NS = 50_000
SPIN_MAX_NS = 300_000


PLACE_SHARE = 0.6
"""Where deadlines lie in a millisecond of the monotonic clock, or in a period that is shorter"""


def first_deadline(clock: Clock, period_ns: int) -> int:
    """Where the grid begins: a period from now at least, and away from the kernel's own ticks.

    Linux serves its timers at whole multiples of 1, 4 or 10 ms of the monotonic clock, on every
    core, and what has waited for them runs just behind. A loop of 1 kHz keeps its place among them
    for as long as it runs: where it is theirs, every tick or each fourth is interrupted.

    Args:
        clock: Simulated or monotonic; nothing interrupts the former.
        period_ns: Between deadlines [ns].
    """
    earliest_ns = clock.now_ns() + period_ns
    if isinstance(clock, SimulatedClock):
        return earliest_ns
    place_ns = round(PLACE_SHARE * min(period_ns, 1_000_000))
    return earliest_ns + (place_ns - earliest_ns) % period_ns


def next_deadline(deadline_ns: int, now_ns: int, period_ns: int) -> tuple[int, int]:
    """Next point on the fixed grid, and how many whole periods were missed.

    A tick that is less than one period late runs at once and keeps its place on the grid;
    a longer stall skips whole periods. The grid never shifts, so the rate cannot drift and a
    stall is never followed by a burst.

    Args:
        deadline_ns: The deadline just served [ns].
        now_ns: The present time on the same monotonic clock [ns].
        period_ns: The sampling period [ns].
    """
    missed = max(0, (now_ns - deadline_ns) // period_ns - 1)
    return deadline_ns + (missed + 1) * period_ns, missed


class Waiter(Protocol):
    """Waits for a deadline and tells when it really woke.

    Attributes:
        margin_ns: How long before the deadline it means to stop sleeping [ns].
        slept_ns: When the last sleep was over [ns]; 0: the deadline was too near to sleep.
    """

    margin_ns: int
    slept_ns: int

    def wait(self, deadline_ns: int) -> int:
        """Return at ``deadline_ns`` [ns] or as soon after as possible; the present time [ns]."""
        ...


class ClockWaiter:
    """Waits on the given clock: on a simulated one it arrives exactly.

    Args:
        clock: The clock that passes while waiting.
    """

    __slots__ = ("_clock", "margin_ns", "slept_ns")

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self.margin_ns = self.slept_ns = 0

    def wait(self, deadline_ns: int) -> int:
        """See ``Waiter``."""
        self._clock.wait_until(deadline_ns)
        return self._clock.now_ns()


class SpinWaiter:
    """Sleeps until a margin before the deadline, then spins: wake-up latency is spent early.

    It never spins for a whole period: a thread that does so under SCHED_FIFO is throttled by
    the kernel for 50 ms of every second.

    Args:
        spin_ns: How long before the deadline to stop sleeping [ns].
        rehearsal: Of the tick, after each sleep; it ends earlier by what that needs.
    """

    __slots__ = ("_rehearsal", "_spin_ns", "margin_ns", "slept_ns")

    def __init__(self, spin_ns: int, rehearsal: Rehearsal | None = None) -> None:
        self._spin_ns = self.margin_ns = spin_ns
        self._rehearsal = rehearsal
        self.slept_ns = 0

    def wait(self, deadline_ns: int) -> int:
        """See ``Waiter``."""
        now = time.monotonic_ns()
        rehearsal = self._rehearsal
        if rehearsal is not None:
            self.margin_ns = self._spin_ns + rehearsal.need_ns
        remaining = deadline_ns - self.margin_ns - now
        if remaining > 0:
            time.sleep(remaining * 1e-9)  # absolute inside: CLOCK_MONOTONIC, TIMER_ABSTIME
            self.slept_ns = now = time.monotonic_ns()
            if rehearsal is not None:
                rehearsal(deadline_ns - now)
                now = time.monotonic_ns()
        else:
            self.slept_ns = 0
        while now < deadline_ns:
            now = time.monotonic_ns()
        return now


def measured_spin_margin_ns(naps: int = 200, nap_ns: int = 300_000) -> int:
    """How early to wake so that 95 % of sleeps end before the deadline [ns], within bounds.

    Args:
        naps: How many sleeps to try.
        nap_ns: How long each is [ns].
    """
    overshoots = []
    for _ in range(naps):
        wanted = time.monotonic_ns() + nap_ns
        time.sleep(nap_ns * 1e-9)
        overshoots.append(time.monotonic_ns() - wanted)
    overshoots.sort()
    return min(max(overshoots[int(0.95 * naps)] + 10_000, SPIN_MIN_NS), SPIN_MAX_NS)


def waiter_for(
    clock: Clock, spin_ns: int | None, period_ns: int, rehearsal: Rehearsal | None = None
) -> Waiter:
    """The waiter that suits a clock.

    Args:
        clock: Simulated or monotonic.
        spin_ns: Spin margin [ns]; None: measured now.
        period_ns: Between deadlines [ns]; of it a measured margin leaves time to sleep.
        rehearsal: Of the tick, before each deadline, where the period leaves time for that too.
    """
    if isinstance(clock, SimulatedClock):
        return ClockWaiter(clock)
    if spin_ns is None:
        spin_ns = min(measured_spin_margin_ns(), int(SPIN_SHARE * period_ns))
    most_ns = int(SPIN_SHARE * period_ns) - spin_ns
    if rehearsal is None or not spin_ns or not rehearsal.practise(most_ns):
        return SpinWaiter(spin_ns)
    return SpinWaiter(spin_ns, rehearsal)
