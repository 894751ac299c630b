"""Measures the timing for ``doctor``, in a process of its own with the rights of a run.

It sends only reads on the bus.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any, Final

from haptic_wall.controller.doctor.replies import time_replies
from haptic_wall.controller.processes.children import Child, first_line
from haptic_wall.controller.runtime import realtime
from haptic_wall.controller.runtime.deadlines import Wait, waiter_for
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.system.orders import read_orders
from haptic_wall.hw.clock import MonotonicClock
from haptic_wall.hw.dynamixel.wire import Read
from haptic_wall.hw.errors import ServoError
from haptic_wall.hw.serialport.line import FdLine

REPLIES: Final = 200
"""Number of timed single reads"""
WAKES: Final = 300
"""Number of wake-ups without a bus"""
_MEASURE_S: Final = 120.0
_END_S: Final = 2.0


def measure(
    config: Config, port: int | None, ids: Sequence[int] = (), read: Read = "plain"
) -> dict[str, Any]:
    """Measure the timing, on the core and with the rights of a run.

    Args:
        config: The configuration of the run.
        port: Descriptor of the open serial port; None: only the machine is measured.
        ids: The servos on it.
        read: How they are read.

    Returns:
        ``realtime``, ``lateness_ns``, ``replies`` and ``failed``: the granted settings, the
        lateness of wake-ups, the replies if they were measured, and why they could not be.

    Raises:
        ServoError: The process gave no answer.
    """
    wishes = config.realtime
    orders = {
        "port": port,
        "ids": ids,
        "read": read,
        "period_ns": config.period_ns,
        "profile": wishes.profile,
        "core": realtime.pick_cores(wishes.core)[0],
        "parent": os.getpid(),
    }
    descriptors = [] if port is None else [port]
    child = Child("timing", ["haptic_wall.controller.doctor.measure"], orders, descriptors)
    try:
        line = first_line(child, _MEASURE_S)
        if line is None:
            raise ServoError(f"the measurement ended early: it {child.exit_text()}")
    finally:
        child.dismiss(_END_S)
    answer: dict[str, Any] = json.loads(line)
    return answer


def main() -> None:
    """Measure as ordered, and write the answer."""
    orders = read_orders()
    realtime.die_with_parent(orders["parent"], signal.SIGTERM)
    core, period_ns = {orders["core"]}, orders["period_ns"]
    os.sched_setaffinity(0, core)
    realtime.freeze_garbage()
    settings = realtime.apply(orders["profile"], realtime.LOOP_PRIORITY, core)
    clock = MonotonicClock()
    answer: dict[str, Any] = {
        "realtime": [asdict(setting) for setting in settings],
        "lateness_ns": _wakes(waiter_for(clock, period_ns), period_ns),
        "replies": None,
        "failed": None,
    }
    if orders["port"] is not None:
        line = FdLine(orders["port"], clock)
        try:
            replies = time_replies(line, orders["ids"], REPLIES, period_ns, orders["read"])
            answer["replies"] = asdict(replies)
        except ServoError as error:
            answer["failed"] = str(error)
    sys.stdout.write(json.dumps(answer) + "\n")


def _wakes(wait: Wait, period_ns: int) -> list[int]:
    """Return the lateness of wake-ups on the grid without a bus [ns], in order of size."""
    lateness = []
    deadline_ns = time.monotonic_ns()
    for _ in range(WAKES):
        deadline_ns = max(deadline_ns + period_ns, time.monotonic_ns())
        lateness.append(wait(deadline_ns) - deadline_ns)
    return sorted(lateness)


if __name__ == "__main__":
    main()
