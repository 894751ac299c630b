"""The streamer: sends rows to a live viewer, in a process of its own.

It may be slow, die, or have no network without an effect on the loop or the log.
"""

from __future__ import annotations

import signal

from haptic_wall.controller.processes.idle_window import pause_until_idle_window
from haptic_wall.controller.processes.orders import read_orders, say
from haptic_wall.controller.processes.stream import Sender, Stream
from haptic_wall.controller.runtime.realtime import die_with_parent, stand_back
from haptic_wall.controller.runtime.telemetry import Telemetry, Word

PAUSE_S = 0.02
"""Time that rows gather [s]; too short for a person to notice, and it saves work."""


def main() -> None:
    """Send until the supervisor reports that no more rows will come."""
    orders = read_orders()
    for number in (signal.SIGINT, signal.SIGHUP, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)  # it ends with the run
    stand_back()
    die_with_parent(orders["parent"], signal.SIGKILL)
    telemetry = Telemetry(orders["telemetry"])
    period_ns = orders["period_ns"]
    sender = Sender(telemetry, Stream(**orders["stream"]), 1e9 / period_ns)
    finished = False
    while not finished:
        pause_until_idle_window(telemetry.words, period_ns, PAUSE_S)
        finished = bool(telemetry.words[Word.FINISHED])  # read first: no row comes after it
        for trouble in sender.send():
            say({"trouble": trouble})
    sender.close()


if __name__ == "__main__":
    main()
