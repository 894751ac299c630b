"""Opens and closes the web server.

It imports little, so that it answers before a run is there.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
from collections.abc import Awaitable, Callable
from typing import Final

from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.http11 import Request, Response

END_S: Final = 1.0
"""Longest wait for the clients at the end [s]"""
MOST_REQUEST: Final = 4096
"""Largest message of a client [bytes]"""


def silenced() -> None:
    """Print nothing of what the server's libraries tell: clients cause the lines."""
    for name in ("asyncio", "websockets"):
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)


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
