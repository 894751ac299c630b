"""Ctrl-C, SIGTERM and SIGHUP: one handler for all three, for a while."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Callable, Iterator, Sequence
from types import FrameType

STOPPING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""The signals that ask a run to stop."""


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
