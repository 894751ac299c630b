"""The board at the other end of the line, with a motor that moves: for tests, without hardware.

python line_board.py        # the first line it says is the path of its port
"""

from __future__ import annotations

import os
import pty
import select
import sys
import time
import tty

from haptic_wall.hw.plant.mechanism import Mechanism
from haptic_wall.hw.truth import TrueServo

COUNTS_PER_REV = 16384
MOTOR = TrueServo(inertia=0.01, damping=0.01, coulomb=0.02, counts_per_rev=COUNTS_PER_REV)


class Board:
    """Answers lines of text; moves when it is asked something."""

    def __init__(self, now_ns: int) -> None:
        self._motor = Mechanism(MOTOR, now_ns)
        self._unread = b""
        self._on = False

    def take(self, data: bytes, now_ns: int) -> bytes:
        """Its answer to these bytes."""
        *lines, self._unread = (self._unread + data).split(b"\n")
        return b"".join(self._answer(*line.decode().split(), now_ns=now_ns) for line in lines)

    def _answer(self, command: str, value: str, *, now_ns: int) -> bytes:
        self._motor.advance(now_ns)
        match command:
            case "P":
                _, counts = self._motor.measured()
                return f"P {value} {counts}\n".encode()
            case "T" if self._on:
                self._motor.command(int(value) / 1000.0, now_ns)
            case "E":
                self._on = value == "1"
                self._motor.command(0.0, now_ns)
                return f"E {value}\n".encode()
        return b""


def main() -> None:
    ours, theirs = pty.openpty()
    tty.setraw(theirs)
    print(os.ttyname(theirs), flush=True)
    board = Board(time.monotonic_ns())
    while True:
        # Whoever has started this holds its standard input open.
        ready, _, _ = select.select([ours, sys.stdin], [], [])
        if sys.stdin in ready:
            return
        os.write(ours, board.take(os.read(ours, 4096), time.monotonic_ns()))


if __name__ == "__main__":
    main()
