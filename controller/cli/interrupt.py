"""Handles Ctrl-C and SIGTERM where no clean-up is needed: ends the process at once.

Most code needs no clean-up. Python's KeyboardInterrupt is not reliable there: a library that is
being imported may turn it into another error, or print it and continue. Code with clean-up sets a
handler of its own for that time, with ``haptic_wall.controller.system.signals``.
"""

from __future__ import annotations

import atexit
import os
import signal
import sys
from collections.abc import Callable
from contextlib import suppress
from types import FrameType
from typing import NoReturn

INTERRUPTED = 130
"""Exit status"""
_OBJECT = b'{"error": "interrupted", "field": null, "advice": null, "exit_status": 130}\n'
"""The answer for ``--json``, as from ``failure.tell``, without imports"""
_answered: list[Callable[[], bool]] = []
_first: list[Callable[[], None]] = []


def leave_at_once() -> None:
    """End the process on Ctrl-C and SIGTERM from now on, unless they are ignored or handled.

    A Ctrl-C that the launcher has blocked acts now.
    """
    new = {signal.SIGINT: signal.default_int_handler, signal.SIGTERM: signal.SIG_DFL}
    for number, default in new.items():
        if signal.getsignal(number) is default:
            signal.signal(number, _leave)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


def end(status: object) -> NoReturn:
    """Flush the output, run the exit functions and end the process without Python's shutdown.

    During that shutdown a signal's handler is not safe, and a library that a KeyboardInterrupt has
    passed through, such as matplotlib's fonts, may abort.

    Args:
        status: As ``sys.exit`` takes it.
    """
    if not isinstance(status, int | None):
        print(status, file=sys.stderr)
        status = 1
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):  # no reader; closed
            stream.flush()
    atexit._run_exitfuncs()
    os._exit(status or 0)


def say_nothing_after(answered: Callable[[], bool]) -> None:
    """On these signals print no ``--json`` error object if the command has printed its answer.

    Args:
        answered: Returns whether the command has printed its answer.
    """
    _answered[:] = [answered]


def do_first(action: Callable[[], None]) -> None:
    """Call ``action`` before one of these signals ends the process; it must not block."""
    _first.append(action)


def _leave(_signal: int, _frame: FrameType | None) -> None:
    for action in _first:
        action()
    if "--json" in sys.argv and not any(answered() for answered in _answered):
        with suppress(OSError):  # no reader
            os.write(1, _OBJECT)
    os._exit(INTERRUPTED)
