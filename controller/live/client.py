"""Sends rows and texts to one page, as fast as it reads.

Rows that a client has not read yet stay in the memory of rows: it gets nothing before its buffer is
empty. So a slow client gets fewer and larger messages, and finally a gap.
"""

from __future__ import annotations

import asyncio
import json
from collections import deque
from typing import Any, Final

from websockets.asyncio.server import ServerConnection, broadcast

from haptic_wall.controller.live.frames import frame
from haptic_wall.controller.live.source import Source

MOST_ROWS: Final = 16384
"""Rows in one message"""
_WAITING_TEXTS: Final = 100
"""Texts that wait for a slow client; the oldest are dropped"""


class Client:
    """A page.

    Args:
        connection: Connection to the page.
        turns: Whether it may turn knobs.

    Attributes:
        axis: Name of the axis that it shows.
        tail: Number of the next row that it gets.
    """

    def __init__(self, connection: ServerConnection, *, turns: bool) -> None:
        self._connection = connection
        self.axis = ""
        self.tail = 0
        self.turns = turns
        self.asks: asyncio.Task[None] | None = None
        """Its change that is under way"""
        self._texts: deque[str] = deque(maxlen=_WAITING_TEXTS)

    @property
    def buffered(self) -> int:
        """Return the number of sent bytes that the system has not accepted yet."""
        return int(self._connection.transport.get_write_buffer_size())

    def abort(self) -> None:
        """Close the connection at once."""
        self._connection.transport.abort()

    def tell(self, what: dict[str, Any]) -> None:
        """Send an object as soon as the client reads."""
        self._texts.append(json.dumps(what, allow_nan=False))

    def serve(self, source: Source, beat: int | None = None, *, last: bool = False) -> None:
        """Send the new rows and texts, if the client has read everything sent before.

        Args:
            source: Of the rows.
            beat: Of the dead man, for a client that may hold it; None: no page holds it.
            last: Send them all the same: nothing comes later.
        """
        if self.buffered and not last:
            return
        if beat is not None and self.turns:
            broadcast((self._connection,), json.dumps({"kind": "beat", "beat": beat}))
        while self._texts:
            broadcast((self._connection,), self._texts.popleft())
        if message := self.rows(source):
            broadcast((self._connection,), message)

    def rows(self, source: Source) -> bytes:
        """Return the message of the new rows, which the client then has; empty: none yet."""
        origin_ns = source.origin_ns()
        rows, after = source.read(self.tail, MOST_ROWS)
        if not origin_ns or not len(rows):
            return b""
        self.tail = after
        return frame(rows, origin_ns)
