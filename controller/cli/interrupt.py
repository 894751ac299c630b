"""Handles Ctrl-C and SIGTERM where no clean-up is needed: ends the process at once.

Most code needs no clean-up. Python's KeyboardInterrupt is not reliable there: a library that is
being imported may turn it into another error, or print it and continue. Code with clean-up sets a
handler of its own for that time, with ``haptic_wall.controller.system.signals``.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType

from haptic_wall.controller.system.signals import on_signals

INTERRUPTED = 130
"""Exit status"""
CLEAR = b"\r\x1b[K"
"""Removes the line of ``working`` from a terminal"""
_ANSWER = b'{"error": "interrupted", "field": null, "advice": "", "exit_status": 130}\n'
json = False
"""Whether the command has ``--json``"""
due = False
"""Whether it has, and still owes its only answer"""


def leave_at_once() -> None:
    """End the process on Ctrl-C and SIGTERM from now on, unless they are ignored.

    A Ctrl-C that the launcher has blocked acts now.
    """
    global due  # noqa: PLW0603 - a signal handler has no other memory
    due = "--json" in sys.argv[1:]
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) in (signal.default_int_handler, signal.SIG_DFL):
            signal.signal(number, leave)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


def leave(_signal: int, _frame: FrameType | None) -> None:
    """End the process, with a line that says so."""
    with suppress(OSError):  # no reader
        os.write(2, CLEAR * os.isatty(2) + b"haptic-wall: interrupted\n")
        if due:
            os.write(1, _ANSWER)
    os._exit(INTERRUPTED)


@contextmanager
def until_signal() -> Iterator[list[int]]:
    """Collect the signals that ask for the end, for the duration of a block."""
    came: list[int] = []
    with on_signals(lambda number, _frame: came.append(number)):
        yield came


def status_after(came: list[int]) -> int:
    """Return the exit status of a command that such signals have ended."""
    return INTERRUPTED if signal.SIGINT in came[:1] else 0
