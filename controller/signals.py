"""Ctrl-C, SIGTERM and the closed terminal: one handler for all of them, for a while."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Callable, Iterator, Sequence
from types import FrameType

STOPPING = (
    signal.SIGINT,
    signal.SIGTERM,
    *([] if signal.getsignal(signal.SIGHUP) == signal.SIG_IGN else [signal.SIGHUP]),
)
"""The signals that ask a run to stop; not the closed terminal's, where the program was begun by
nohup."""


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
    before = [signal.signal(number, handler) for number in numbers]
    try:
        yield
    finally:
        for number, earlier in zip(numbers, before, strict=True):
            signal.signal(number, earlier)
