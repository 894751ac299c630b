"""Says things to a person from a thread of its own: a terminal that stands still holds nobody up.

A terminal that was stopped with Ctrl-S, or a reader that does not read, blocks whoever writes to
it; whoever watches over a torque must not be.
"""

from __future__ import annotations

import contextlib
import threading
from queue import SimpleQueue
from types import TracebackType

from haptic_wall.controller.processes.plan import Tell


class Teller:
    """Takes what is to be said at once; says it in order when it can.

    Args:
        tell: Says it, and may take its time; where nobody listens (OSError) that is all right.
    """

    def __init__(self, tell: Tell) -> None:
        self._tell = tell
        self._texts: SimpleQueue[str | None] = SimpleQueue()
        # Begun with the first word, when whoever speaks has left the loop's core: so has it then.
        self._thread: threading.Thread | None = None

    def __call__(self, text: str) -> None:
        """Say ``text``, soon; never waits."""
        self._texts.put(text)
        if self._thread is None:
            self._thread = threading.Thread(target=self._say, daemon=True)
            self._thread.start()

    def __enter__(self) -> Teller:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Wait until all is said."""
        self._texts.put(None)
        if self._thread is not None:
            self._thread.join()

    def _say(self) -> None:
        while (text := self._texts.get()) is not None:
            with contextlib.suppress(OSError):
                self._tell(text)
