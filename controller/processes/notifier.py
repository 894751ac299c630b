"""Passes messages to a person from a thread of its own: a blocked terminal blocks no caller.

A terminal that was stopped with Ctrl-S, or a reader that does not read, blocks the writer. The
process that watches over a torque must not block.
"""

from __future__ import annotations

import contextlib
import threading
from queue import SimpleQueue

from haptic_wall.controller.processes.plan import Tell


class Notifier:
    """Takes messages without waiting, and passes them on in order.

    Args:
        tell: Passes a message on, and may block; an OSError (no reader) is ignored.
    """

    def __init__(self, tell: Tell) -> None:
        self._tell = tell
        self._texts: SimpleQueue[str | None] = SimpleQueue()
        # Started with the first message: by then the caller has left the loop's core, and the
        # thread inherits that.
        self._thread: threading.Thread | None = None

    def __call__(self, text: str) -> None:
        """Queue ``text``; never waits."""
        self._texts.put(text)
        if self._thread is None:
            self._thread = threading.Thread(target=self._say, daemon=True)
            self._thread.start()

    def __enter__(self) -> Notifier:
        return self

    def __exit__(self, *_: object) -> None:
        """Wait until all messages are passed on."""
        self._texts.put(None)
        if self._thread is not None:
            self._thread.join()

    def _say(self) -> None:
        while (text := self._texts.get()) is not None:
            with contextlib.suppress(OSError):
                self._tell(text)
