"""The fixed grid of deadlines: computes the next deadline, and waits for it."""

from __future__ import annotations

import time
from collections.abc import Callable

from haptic_wall.hw.clock import Clock, SimulatedClock
from haptic_wall.hw.elastic import ElasticClock

SPIN_MIN_NS = 50_000
SPIN_MAX_NS = 300_000
SPIN_SHARE = 0.6
"""Largest fraction of a period for spinning: Linux halts a real-time process that holds its core
for more than 0.95 of a second, and the tick's own work adds to it."""
_NAP_NS = 300_000
PLACE_SHARE = 0.6
"""Phase of the deadlines in a millisecond of the monotonic clock, or in a shorter period"""


def first_deadline(clock: Clock, period_ns: int) -> int:
    """Return the first deadline: at least a period from now, and away from the kernel's own ticks.

    Linux serves its timers at whole multiples of 1, 4 or 10 ms of the monotonic clock, on every
    core, and runs the waiting tasks just after. A loop of 1 kHz keeps its phase to them for its
    whole life: at the same phase every tick, or every fourth, would be interrupted.

    Args:
        clock: Simulated or monotonic clock; on the simulated clock there are no interruptions.
        period_ns: Between deadlines [ns].
    """
    earliest_ns = clock.now_ns() + period_ns
    if isinstance(clock, SimulatedClock):
        return earliest_ns
    place_ns = round(PLACE_SHARE * min(period_ns, 1_000_000))
    return earliest_ns + (place_ns - earliest_ns) % period_ns


def next_deadline(deadline_ns: int, now_ns: int, period_ns: int) -> tuple[int, int]:
    """Return the next point on the fixed grid, and the number of whole periods missed.

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


Wait = Callable[[int], int]
"""Waits for a deadline [ns] and returns the present time [ns], at once after it"""


def spinning(margin_ns: int, clock: Clock) -> Wait:
    """Return what sleeps until a margin before the deadline, then spins: latency is spent early.

    It never spins for a whole period: a thread that does so under SCHED_FIFO is throttled by
    the kernel for 50 ms of every second.

    Args:
        margin_ns: How long before the deadline to stop sleeping [ns].
        clock: An elastic clock; any other counts as monotonic.
    """
    elastic = clock if isinstance(clock, ElasticClock) else None
    read = time.monotonic_ns if elastic is None else elastic.now_ns
    sleep = time.sleep

    def wait(deadline_ns: int) -> int:
        if elastic is not None:
            elastic.promise(deadline_ns)
        now = read()
        remaining = deadline_ns - margin_ns - now
        if remaining > 0:
            sleep(remaining * 1e-9)  # absolute inside: CLOCK_MONOTONIC, TIMER_ABSTIME
            now = read()
        while now < deadline_ns:
            now = read()
        return now

    return wait


def measured_spin_margin_ns(naps: int = 200) -> int:
    """Measure the margin with which 95 % of sleeps end before the deadline [ns], within bounds.

    Args:
        naps: Number of sleeps to try.
    """
    overshoots = []
    for _ in range(naps):
        wanted = time.monotonic_ns() + _NAP_NS
        time.sleep(_NAP_NS * 1e-9)
        overshoots.append(time.monotonic_ns() - wanted)
    overshoots.sort()
    return min(max(overshoots[int(0.95 * naps)] + 10_000, SPIN_MIN_NS), SPIN_MAX_NS)


def waiter_for(clock: Clock, period_ns: int) -> Wait:
    """Return what waits on a clock, simulated or monotonic.

    Args:
        clock: The clock.
        period_ns: Between deadlines [ns]; the measured spin leaves a part of it for sleeping.
    """
    if isinstance(clock, SimulatedClock):

        def arrive(deadline_ns: int) -> int:
            clock.wait_until(deadline_ns)
            return clock.now_ns()

        return arrive
    return spinning(min(measured_spin_margin_ns(), int(SPIN_SHARE * period_ns)), clock)
