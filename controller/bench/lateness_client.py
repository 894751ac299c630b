"""Runs one loop, in a process of its own, that only wakes up every millisecond.

It reads its orders on standard input and prints the lateness of each wake-up on one line. It
imports little, so that a round starts quickly.
"""

from __future__ import annotations

import importlib
import json
import os
import signal
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Final, NamedTuple

from haptic_wall.controller.runtime import realtime
from haptic_wall.controller.runtime.deadlines import Wait, next_deadline, sleeping, waiter_for
from haptic_wall.controller.system.orders import read_orders
from haptic_wall.hw.clock import MonotonicClock

PERIOD_NS: Final = 1_000_000


@dataclass(frozen=True, slots=True)
class Orders:
    """Orders to a client's process."""

    client: str
    """One of ``CLIENTS``"""
    core: int
    priority: int
    ticks: int
    parent: int
    """Process id of the caller: when it ends, so does this process"""


class Woken(NamedTuple):
    """Result of one loop."""

    lateness_ns: list[int]
    elapsed_ns: int
    """From the first wake-up to the last"""
    busy_ns: int
    """Total processor time"""


def on_grid(wait: Wait, ticks: int, now_ns: Callable[[], int] = time.monotonic_ns) -> Woken:
    """Wake up on a fixed grid, as the program's loop does.

    Args:
        wait: Waits for each deadline.
        ticks: Number of wake-ups, >= 1.
        now_ns: Its clock.
    """
    late = []
    began = time.thread_time_ns()
    deadline = now_ns() + PERIOD_NS
    first = woke = 0
    for _ in range(ticks):
        woke = wait(deadline)
        first = first or woke
        late.append(woke - deadline)
        deadline, _ = next_deadline(deadline, now_ns(), PERIOD_NS)
    return Woken(late, woke - first, time.thread_time_ns() - began)


def with_settings(orders: Orders) -> Woken:
    """Wait as the program does, with the granted real-time settings of its loop."""
    return on_grid(waiter_for(MonotonicClock(), PERIOD_NS), orders.ticks)


def to_the_deadline(orders: Orders) -> Woken:
    """Sleep until the next point of a fixed grid."""
    return on_grid(sleeping(MonotonicClock()), orders.ticks)


def relative(orders: Orders) -> Woken:
    """Sleep for a period from each wake-up."""
    now, sleep, period_s = time.monotonic_ns, time.sleep, PERIOD_NS * 1e-9
    late = []
    began = time.thread_time_ns()
    woke, first = now(), 0
    for _ in range(orders.ticks):
        due = woke + PERIOD_NS
        sleep(period_s)
        woke = now()
        first = first or woke
        late.append(woke - due)
    return Woken(late, woke - first, time.thread_time_ns() - began)


def rate_limited(orders: Orders) -> Woken:
    """Use ``loop_rate_limiters.RateLimiter``; lateness against its own announced tick."""
    limiter = importlib.import_module("loop_rate_limiters").RateLimiter(
        frequency=1e9 / PERIOD_NS, warn=False
    )
    now, late = time.perf_counter, []
    began = time.thread_time_ns()
    first = woke = 0.0
    for _ in range(orders.ticks):
        due = limiter.next_tick
        limiter.sleep()
        woke = now()
        first = first or woke
        late.append(round(1e9 * (woke - due)))
    return Woken(late, round(1e9 * (woke - first)), time.thread_time_ns() - began)


CLIENTS: Final[dict[str, tuple[realtime.Profile, Callable[[Orders], Woken]]]] = {
    "settings": ("best-effort", with_settings),
    "no settings": ("off", with_settings),
    "deadline": ("off", to_the_deadline),
    "relative": ("off", relative),
    "limiter": ("off", rate_limited),
}
"""Each loop, and the real-time settings it runs with."""


def main() -> None:
    """Run the ordered loop."""
    orders = Orders(**read_orders())
    realtime.die_with_parent(orders.parent, signal.SIGTERM)
    profile, loop = CLIENTS[orders.client]
    os.sched_setaffinity(0, {orders.core})
    realtime.freeze_garbage()
    settings = realtime.apply(profile, orders.priority, {orders.core})
    woken = loop(orders)
    told = {**woken._asdict(), "settings": [asdict(setting) for setting in settings]}
    sys.stdout.write(json.dumps(told) + "\n")


if __name__ == "__main__":
    main()
