"""What a Ctrl-C does where nothing has to be put in order: the process ends.

That is nearly everywhere. Raised as KeyboardInterrupt in whatever is just being done, it would be
swallowed now and then: libraries that are being loaded turn it into other errors, or print it and
go on. Who has something to put in order hears it by ``haptic_wall.controller.system.signals``, for
that while.
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
"""What ``--json`` is answered with, as ``failure.tell`` says it; nothing is loaded for it"""
_answered: list[Callable[[], bool]] = []
_first: list[Callable[[], None]] = []


def leave_at_once() -> None:
    """From now on a Ctrl-C ends the process; not where it is ignored, or was handled before.

    One that the launcher has held back does so now.
    """
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _leave)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


def leave_to_the_system() -> None:
    """From now on the system ends the process: Python is about to end, and calls no handler safely.

    Not where Ctrl-C is ignored, or was handled before.
    """
    if signal.getsignal(signal.SIGINT) is _leave:
        signal.signal(signal.SIGINT, signal.SIG_DFL)


def end_without_python(status: int) -> NoReturn:
    """End this process, but not as Python does, which takes its libraries apart.

    A library that a KeyboardInterrupt came through, matplotlib's fonts for instance, may be in a
    state in which that aborts the process.

    Args:
        status: Of the exit.
    """
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):  # nobody listens; it is closed
            stream.flush()
    atexit._run_exitfuncs()
    os._exit(status)


def say_nothing_after(answered: Callable[[], bool]) -> None:
    """To programs (``--json``) one object is said, and no second one.

    Args:
        answered: Whether the command has printed its answer.
    """
    _answered[:] = [answered]


def do_first(action: Callable[[], None]) -> None:
    """Before a Ctrl-C ends the process ``action`` is done; it waits for nothing."""
    _first[:] = [action]


def _leave(_signal: int, _frame: FrameType | None) -> None:
    for action in _first:
        action()
    if "--json" in sys.argv and not any(answered() for answered in _answered):
        with suppress(OSError):  # nobody listens
            os.write(1, _OBJECT)
    os._exit(INTERRUPTED)
