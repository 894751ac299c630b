"""Handles Ctrl-C, SIGTERM and a closed terminal, for the duration of a block.

Outside of runs Ctrl-C ends the process in its handler, with a line and status 130; code that must
clean up uses ``interrupting``. Of 1,180 Ctrl-C in the first two seconds of commands, an import of
SciPy turned two into a traceback, and Python's own start seven: so the command is a shell script
that starts Python with the signal blocked.
"""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from types import FrameType
from typing import Any

Handler = Callable[[int, FrameType | None], Any] | int | None

STOPPING = (
    signal.SIGINT,
    signal.SIGTERM,
    *([] if signal.getsignal(signal.SIGHUP) == signal.SIG_IGN else [signal.SIGHUP]),
)
"""The signals that ask a run to stop; without the closed terminal's if nohup started the program.
"""


def ended_by(number: signal.Signals) -> Callable[[], bool]:
    """Let a child process outlive the signals that stop a run, and note the one that ends it.

    Args:
        number: The signal.

    Returns:
        A function that returns whether it has come.
    """
    came: list[int] = []
    for each in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(each, signal.SIG_IGN)
    signal.signal(number, lambda given, _frame: came.append(given))
    return lambda: bool(came)


@contextlib.contextmanager
def on_signals(
    handler: signal.Handlers | Callable[[int, FrameType | None], None],
    numbers: Sequence[signal.Signals] = STOPPING,
) -> Iterator[None]:
    """Set the handler of signals for the duration of a block.

    Args:
        numbers: The signals, by default those that stop a run.
        handler: As ``signal.signal`` takes it; a function only sets flags.
    """
    before: list[tuple[signal.Signals, Handler]] = []
    try:
        for number in numbers:
            before.append((number, signal.getsignal(number)))
            signal.signal(number, handler)
        yield
    finally:
        for number, earlier in reversed(before):
            signal.signal(number, earlier)


@contextlib.contextmanager
def held_back(numbers: Sequence[signal.Signals]) -> Iterator[None]:
    """Block signals for the duration of a block; child processes inherit that and keep it.

    Args:
        numbers: The signals.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, numbers)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextlib.contextmanager
def interrupting(
    numbers: Sequence[signal.Signals] | None = None, *, at_once: bool = True
) -> Iterator[None]:
    """Turn signals into KeyboardInterrupt inside a block, for clean-up.

    It is raised wherever Python is executing: a library may swallow it, or convert it to an
    ImportError. In these cases it is raised again at the end.

    Args:
        numbers: The signals; None: those that stop a run, without ignored ones.
        at_once: Raise immediately; else at the end only.

    Raises:
        KeyboardInterrupt: One of them came.
    """
    if threading.current_thread() is not threading.main_thread():  # only that thread receives them
        yield
        return
    if numbers is None:
        numbers = [n for n in STOPPING if signal.getsignal(n) != signal.SIG_IGN]
    came = False

    def interrupt(_number: int, _frame: FrameType | None) -> None:
        nonlocal came
        came = True
        if at_once:
            raise KeyboardInterrupt

    try:
        with on_signals(interrupt, numbers):
            yield
    except Exception:
        if came:
            raise KeyboardInterrupt from None
        raise
    if came:
        raise KeyboardInterrupt
