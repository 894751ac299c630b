"""Opens and closes the web server, and logs what it refuses.

It imports little, so that it answers before a run is there.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
import time
from collections.abc import Awaitable, Callable, Iterator
from pathlib import Path
from typing import Final

from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.frames import CloseCode
from websockets.http11 import Request, Response

END_S: Final = 1.0
"""Longest wait for the clients at the end [s]"""
MOST_REQUEST: Final = 4096
"""Largest message of a client [bytes]"""
MOST_LINES: Final = 300
"""Lines in the log of one server"""
MOST_CHARACTERS: Final = 300
"""In a line of it"""
_ENDS: Final = (CloseCode.NORMAL_CLOSURE, CloseCode.GOING_AWAY)
_LOG: Final = logging.getLogger(__name__)


class ServerLog(logging.Handler):
    """Writes each record in one line to a file, which the first one makes.

    Clients cause the lines. So they are limited, and nothing happens where they cannot be written.

    Args:
        path: Of the file.
    """

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._path = path
        self._left = MOST_LINES

    def emit(self, record: logging.LogRecord) -> None:
        """Write a record, with the kind and the place of its exception."""
        if not self._left:
            return
        self._left -= 1
        words = record.getMessage()
        if record.exc_info and (error := record.exc_info[1]) is not None:
            place = error.__traceback__
            while place is not None and place.tb_next is not None:
                place = place.tb_next
            where = place and f"{place.tb_frame.f_code.co_filename}:{place.tb_lineno}"
            words += f": {type(error).__name__}: {error} ({where})"
        line = f"{time.strftime('%FT%T')} {ascii(words)[1:-1]:.{MOST_CHARACTERS}}\n"
        with contextlib.suppress(OSError), self._path.open("a") as file:
            file.write(line)


def log_to(path: Path) -> None:
    """Write all messages and warnings of this process to a log of the server.

    Args:
        path: Of the file.
    """
    logging.basicConfig(handlers=[ServerLog(path)], force=True)
    logging.captureWarnings(capture=True)


@contextlib.contextmanager
def logged_to(path: Path) -> Iterator[None]:
    """Write as ``log_to``, and as before afterwards."""
    before = logging.root.handlers[:]
    log_to(path)
    try:
        yield
    finally:
        logging.captureWarnings(capture=False)
        logging.root.handlers[:] = before


class _Connection(ServerConnection):
    """A connection that logs why it was refused or broken off."""

    def connection_lost(self, exc: Exception | None) -> None:
        super().connection_lost(exc)
        request, answer, ours = self.request, self.response, self.protocol.close_sent
        error = self.protocol.handshake_exc
        if error is not None and not isinstance(error.__cause__, EOFError):
            _LOG.warning("refused: %s", _shown(error.__cause__ or error))
        elif request is not None and answer is not None and answer.status_code >= 400:
            _LOG.warning("refused with %s: %s", answer.status_code, _shown(request.path))
        elif ours is not None and not self.protocol.close_rcvd_then_sent and ours.code not in _ENDS:
            _LOG.warning("broken off: %s", ours)


def _shown(text: object) -> str:
    """Return a client's text in ASCII, up to a question mark: behind it there may be the token."""
    return ascii(str(text).partition("?")[0])[1:-1]


async def opened(
    listener: socket.socket,
    attend: Callable[[ServerConnection], Awaitable[None]],
    judge: Callable[[Request], Response | None],
) -> Server:
    """Return a server that listens.

    Args:
        listener: Bound and listening.
        attend: Serves a client until it is gone.
        judge: Answers a request; None: the websocket may open.
    """
    return await serve(
        attend,
        sock=listener,
        process_request=lambda _connection, request: judge(request),
        create_connection=_Connection,
        compression=None,
        max_size=MOST_REQUEST,
        max_queue=4,
        open_timeout=5.0,
        close_timeout=1.0,
        server_header=None,
    )


async def closed(server: Server) -> None:
    """Close a server; a client that has been stopped would never answer, and is not waited for."""
    server.close(code=1001)
    with contextlib.suppress(TimeoutError):
        await asyncio.wait_for(asyncio.shield(server.wait_closed()), END_S)
