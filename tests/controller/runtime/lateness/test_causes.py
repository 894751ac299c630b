"""Where the time of a late tick went says why it was late; figures as they were once counted."""

import pytest

from haptic_wall.controller.runtime.lateness.causes import (
    Cause,
    Late,
    Machine,
    evidence,
    likely_cause,
)
from haptic_wall.controller.runtime.lateness.thread_counters import Counters

MS = 1_000_000
LOOP = Machine(virtual=True, real_time=True, shared=False, knows_run_delay=True)
BARE = Machine(virtual=False, real_time=True, shared=False, knows_run_delay=True)


def counted(
    on_core: int = 0,
    delay: int = 0,
    minor: int = 0,
    major: int = 0,
    voluntary: int = 0,
    involuntary: int = 0,
) -> Counters:
    """What grew in 20 ms beyond what is usual, times in microseconds."""
    us = 1000
    return Counters(20 * MS, on_core * us, delay * us, minor, major, voluntary, involuntary)


def late(
    asleep: int = 0,
    held: int = 0,
    work: int = 30,
    bus: int = 0,
    steal_ms: int | None = None,
    beyond: Counters | None = None,
    *,
    lost: bool = False,
    stopped: bool = False,
    collections_ns: int = 0,
) -> Late:
    """A late tick, times in microseconds."""
    return Late(
        asleep * 1000,
        held * 1000,
        work * 1000,
        bus * 1000,
        bus > 700,
        beyond=beyond or counted(),
        steal_ns=None if steal_ms is None else steal_ms * MS,
        lost=lost,
        stopped=stopped,
        collections_ns=collections_ns,
    )


@pytest.mark.parametrize(
    ("tick", "cause", "words"),
    [
        # A process of a higher priority ran for 5 ms while the loop slept, and while it spun.
        (late(asleep=4941, beyond=counted(delay=4968)), Cause.OTHER, "waited 4.97 ms for the core"),
        # SIGSTOP for 20 ms: neither on the core nor waiting for it.
        (
            late(asleep=19809, beyond=counted(delay=26, voluntary=1), stopped=True),
            Cause.STOPPED,
            "SIGCONT",
        ),
        # The timer of a virtual machine whose host had other things to do.
        (late(asleep=7902, beyond=counted(delay=480)), Cause.WOKEN_LATE, "7.9 ms late"),
        # The host took the core while the loop computed for 3 ms.
        (
            late(work=3006, beyond=counted(on_core=539)),
            Cause.HOST,
            "on the core for 0.539 ms of 3.01 ms; no other process had it",
        ),
        (late(work=5861, beyond=counted(on_core=5386, minor=2048)), Cause.FAULTS, "2048 minor"),
        (
            late(work=5062, beyond=counted(on_core=2316, minor=906), collections_ns=4900_000),
            Cause.COLLECTION,
            "took 4.9 ms",
        ),
        (late(work=3005, beyond=counted(on_core=2980)), Cause.WORK, "2.98 ms of 3 ms"),
        (late(work=3005, beyond=counted(on_core=100, voluntary=1)), Cause.BLOCKED, "a file"),
        (late(bus=1551, work=139), Cause.BUS, "waited 1.55 ms for the reply"),
        (late(bus=810, work=139, lost=True), Cause.LOST, "waited 0.81 ms"),
        # The reply was there, but another process had the core.
        (late(bus=5000, beyond=counted(delay=4900)), Cause.OTHER, "4.9 ms"),
        # A bit of everything.
        (
            late(asleep=250, work=350, bus=300, beyond=counted(on_core=170, delay=90)),
            Cause.UNKNOWN,
            "asleep 0.25 ms",
        ),
    ],
)
def test_the_largest_share_is_the_cause(tick: Late, cause: Cause, words: str) -> None:
    assert likely_cause(tick, LOOP) == cause
    assert words in evidence(cause, tick, LOOP) + ";"


def test_without_a_host_it_is_the_kernel_or_the_firmware() -> None:
    tick = late(held=2000, beyond=counted(on_core=20))
    assert likely_cause(tick, BARE) == Cause.KERNEL
    assert "firmware" in evidence(Cause.KERNEL, tick, BARE)
    tick = late(asleep=2000)
    assert likely_cause(tick, BARE) == Cause.WOKEN_LATE
    assert "host" not in evidence(Cause.WOKEN_LATE, tick, BARE)


def test_a_kernel_that_does_not_count_the_wait_still_counts_switches() -> None:
    blind = Machine(virtual=True, real_time=False, shared=False, knows_run_delay=False)
    tick = late(held=5000, beyond=counted(involuntary=2))
    assert likely_cause(tick, blind) == Cause.OTHER
    assert "2 involuntary switches" in evidence(Cause.OTHER, tick, blind)
