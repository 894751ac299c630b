"""Measures the timing for ``doctor``, in a process of its own with the rights of a run.

It reads one JSON object of orders on standard input and writes one answer on standard output. It
sends only reads on the bus.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from dataclasses import asdict, dataclass
from typing import Any

from haptic_wall.controller.doctor.cycles import SCHEDULES, run_series
from haptic_wall.controller.doctor.replies import time_replies
from haptic_wall.controller.runtime import realtime
from haptic_wall.controller.runtime.deadlines import Waiter, waiter_for
from haptic_wall.controller.system.orders import read_orders
from haptic_wall.hw.clock import MonotonicClock
from haptic_wall.hw.errors import ServoError
from haptic_wall.hw.serialport.line import FdLine

PHASES = 10
LEAST_CYCLES, MOST_CYCLES = 20, 200
"""Least and largest number of cycles at one phase"""


@dataclass(frozen=True, slots=True)
class Orders:
    """Orders to the measuring process, and its rights."""

    port: int | None
    """Descriptor of the open serial port; None: only the machine is measured"""
    id: int
    period_ns: int
    collect_ns: int
    """Time from a tick's wake-up after which it gives a reply up"""
    longer_ns: int
    """The same time after a pipelined reply was lost, until another one is lost"""
    series_s: float
    """Duration of the cycles at one phase"""
    replies: int
    """Single reads to time"""
    wakes: int
    """Wake-ups to time without a bus"""
    profile: realtime.Profile
    priority: int
    spin_ns: int | None
    core: int
    parent: int


def main() -> None:
    """Measure as ordered, and write the answer."""
    orders = Orders(**read_orders())
    realtime.die_with_parent(orders.parent, signal.SIGTERM)
    os.sched_setaffinity(0, {orders.core})
    realtime.freeze_garbage()
    settings = realtime.apply(orders.profile, orders.priority, {orders.core})
    clock = MonotonicClock()
    waiter = waiter_for(clock, orders.spin_ns, orders.period_ns)
    answer: dict[str, Any] = {
        "realtime": [asdict(setting) for setting in settings],
        "lateness_ns": _wakes(waiter, orders),
        "replies": None,
        "series": [],
        "failed": None,
    }
    if orders.port is not None:
        try:
            answer |= _bus(FdLine(orders.port, clock), orders, waiter)
        except ServoError as error:
            answer["failed"] = str(error)
    sys.stdout.write(json.dumps(answer) + "\n")


def _wakes(waiter: Waiter, orders: Orders) -> list[int]:
    """Return the lateness of wake-ups on the grid without a bus [ns], in order of size."""
    lateness = []
    deadline_ns = time.monotonic_ns()
    for _ in range(orders.wakes):
        deadline_ns = max(deadline_ns + orders.period_ns, time.monotonic_ns())
        lateness.append(waiter.wait(deadline_ns) - deadline_ns)
    return sorted(lateness)


def _bus(line: FdLine, orders: Orders, waiter: Waiter) -> dict[str, Any]:
    period_ns = orders.period_ns
    cycles = round(orders.series_s * 1e9 / period_ns)
    replies = time_replies(line, orders.id, orders.replies, period_ns)
    series = [
        run_series(
            line,
            orders.id,
            schedule,
            wait=waiter.wait,
            period_ns=period_ns,
            collect_ns=orders.collect_ns,
            longer_ns=orders.longer_ns,
            phases=PHASES,
            cycles=min(max(cycles, LEAST_CYCLES), MOST_CYCLES),
        )
        for schedule in SCHEDULES
    ]
    return {"replies": asdict(replies), "series": [asdict(one) for one in series]}


if __name__ == "__main__":
    main()
