"""Ctrl-C, SIGTERM and the closed terminal: one handler for all of them, for a while."""

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
"""The signals that ask a run to stop; not the closed terminal's, where the program was begun by
nohup."""
_raised: list[signal.Signals] = []  # no Event: a handler must not wait for a lock


def was_interrupted() -> bool:
    """Whether ``interrupting`` has raised in this process, through whatever library just ran."""
    return bool(_raised)


@contextlib.contextmanager
def on_signals(
    handler: signal.Handlers | Callable[[int, FrameType | None], None],
    numbers: Sequence[signal.Signals] = STOPPING,
) -> Iterator[None]:
    """What signals do meanwhile.

    Args:
        numbers: The signals in question, those that stop a run unless told otherwise.
        handler: As ``signal.signal`` takes it; a function of ours only sets flags.
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
    """Signals wait meanwhile; processes that are started inherit that, and keep it.

    Args:
        numbers: The signals in question.
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
    """Signals raise KeyboardInterrupt inside, where something is to be put in order first.

    It is raised wherever Python just is: a library may swallow it, or make an ImportError of it.
    Such a one is raised again at the end.

    Args:
        numbers: The signals in question; None: those that stop a run, but for ignored ones.
        at_once: Else at the end only.

    Raises:
        KeyboardInterrupt: One of them came.
    """
    if threading.current_thread() is not threading.main_thread():  # only that one hears them
        yield
        return
    if numbers is None:
        numbers = [n for n in STOPPING if signal.getsignal(n) != signal.SIG_IGN]
    came = False

    def interrupt(number: int, _frame: FrameType | None) -> None:
        nonlocal came
        came = True
        if at_once:
            _raised.append(signal.Signals(number))
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
