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
_LEAVING = {signal.SIGINT: signal.default_int_handler, signal.SIGTERM: signal.SIG_DFL}
"""The signals, and what handles them in a new process"""
_answered: list[Callable[[], bool]] = []
_first: list[Callable[[], None]] = []


def leave_at_once() -> None:
    """End the process on Ctrl-C and SIGTERM from now on, unless they are ignored or handled.

    A Ctrl-C that the launcher has blocked acts now.
    """
    for number, default in _LEAVING.items():
        if signal.getsignal(number) is default:
            signal.signal(number, _leave)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


def leave_to_the_system() -> None:
    """Let the system end the process: while Python shuts down, a handler is not safe.

    It changes nothing where a signal is ignored, or has another handler.
    """
    for number in _LEAVING:
        if signal.getsignal(number) is _leave:
            signal.signal(number, signal.SIG_DFL)


def end_without_python(status: int) -> NoReturn:
    """Flush the output, run the exit functions and end the process without Python's shutdown.

    A library that a KeyboardInterrupt has passed through, such as matplotlib's fonts, may abort
    during that shutdown.
    """
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):  # no reader; closed
            stream.flush()
    atexit._run_exitfuncs()
    os._exit(status)


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
