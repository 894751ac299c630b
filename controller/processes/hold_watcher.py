"""The dead man's watcher: writes to shared memory the time until which the wall is held on.

It is not part of the loop's process, where a thread would cost the loop milliseconds.
"""

from __future__ import annotations

import contextlib
import os
import signal
import time

from haptic_wall.controller.processes.hold import Hold, Source, source_of
from haptic_wall.controller.processes.orders import read_orders, say
from haptic_wall.controller.runtime.realtime import die_with_parent
from haptic_wall.controller.runtime.telemetry import Telemetry, Word
from haptic_wall.hw.clock import ready

LOOK_S = 0.01
"""Longest time between two polls of the source [s]"""
PRIORITY = 1
"""Real-time priority, where it is granted: on a busy machine the wall must not go off"""


def watch(source: Source, words: memoryview[int]) -> OSError:
    """Write until when the dead man counts as held, again and again.

    Returns:
        Why the source is gone; the dead man then stays released.
    """
    descriptors = [] if source.descriptor is None else [source.descriptor]
    while True:
        try:
            words[Word.HELD_NS] = source.until(time.monotonic_ns(), time.time_ns())
        except OSError as error:
            words[Word.HELD_NS] = 0
            return error
        ready(descriptors, LOOK_S)


def main() -> None:
    """Watch until told to end."""
    orders = read_orders()
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)  # it must outlive the loop
    die_with_parent(orders["parent"], signal.SIGKILL)
    if orders["real_time"]:
        with contextlib.suppress(OSError):  # not granted: a stall then acts as a release
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    telemetry = Telemetry(orders["telemetry"])
    hold = Hold(**orders["hold"])
    source = source_of(hold, orders["descriptor"], time.monotonic_ns())
    error = watch(source, telemetry.words)
    say({"trouble": f"{hold.path} is gone ({error.strerror or error})"})


if __name__ == "__main__":
    main()
