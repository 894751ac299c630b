"""Serves the views of a run to its clients: sends them what is new, and takes their requests."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import socket
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

from websockets.asyncio.server import ServerConnection, serve
from websockets.exceptions import ConnectionClosed

from haptic_wall.controller.live.client import MOST_ROWS, Client
from haptic_wall.controller.live.gate import is_token, judged, token_of
from haptic_wall.controller.live.relay import ask, is_number, sets_of
from haptic_wall.controller.live.view import View

FRAME_S: Final = 0.02
"""Time between two messages [s]"""
LEAST_PAUSE_S: Final = 0.25 * FRAME_S
"""Shortest time for the clients' requests between two messages [s]"""
MOST_CLIENTS: Final = 64
END_S: Final = 1.0
"""Longest wait for the clients at the end [s]"""
MOST_REQUEST: Final = 4096
"""Largest message of a client [bytes]"""
_LAW_EVERY: Final = 25
"""Messages between two looks at the law's range, and the guard's delay"""
_STRIP_EVERY: Final = 5
"""Messages between two states of all axes"""


class LiveServer:
    """Serves the views of a run, one for each axis; each client looks at one of them.

    Args:
        views: Of each axis by name, not empty.
        host: Name in the printed address.
        token: Token of clients that may turn knobs; empty: no client may.
        run_socket: Socket of the run that takes changes; None: the run takes none.
        pause: Returns for how long to wait until the next messages [s].
    """

    def __init__(
        self,
        views: Mapping[str, View],
        host: str,
        token: str = "",
        run_socket: Path | None = None,
        pause: Callable[[float], float] = lambda wanted_s: wanted_s,
    ) -> None:
        self.views = dict(views)
        self._first = next(iter(self.views.values()))
        self._host = host
        self._token = token
        self.run_socket = run_socket
        self._pause = pause

    async def run(self, listener: socket.socket, until: Callable[[], bool]) -> None:
        """Serve until ``until`` says so; print nothing of what clients cause.

        Args:
            listener: Bound and listening.
            until: Called with every message; true: end.
        """
        for name in ("asyncio", "websockets"):
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)
        server = await serve(
            self._attend,
            sock=listener,
            process_request=lambda _, request: judged(request, self._host),
            compression=None,
            max_size=MOST_REQUEST,
            max_queue=4,
            open_timeout=5.0,
            close_timeout=1.0,
            server_header=None,
        )
        await self.pump(until)
        server.close(code=1001)
        with contextlib.suppress(TimeoutError):  # a client that has been stopped never answers
            await asyncio.wait_for(asyncio.shield(server.wait_closed()), END_S)
        for view in self.views.values():
            for client in tuple(view.clients):
                client.abort()

    async def pump(self, until: Callable[[], bool]) -> None:
        """Send rows and texts to the clients, until ``until`` says so."""
        first, views, count, next_s = self._first, self.views.values(), 0, time.monotonic()
        draws: asyncio.Task[None] | None = None
        while True:
            over = until()  # asked first: what it knows of is still sent
            for view in views:
                view.look(MOST_ROWS)
            if count % _LAW_EVERY == 0:
                for view in views:
                    view.draw_law()
                    view.tell_health()
                if draws is None or draws.done():
                    draws = asyncio.create_task(self._draw_maps())
            if len(views) > 1 and (over or count % _STRIP_EVERY == 0):
                strip = [{"name": name, **view.state()} for name, view in self.views.items()]
                for view in views:
                    view.tell({"kind": "strip", "axes": strip})
            man = first.dead_man
            beat = None if man is None else man.beat(first.now_ns())
            for view in views:
                for client in tuple(view.clients):
                    client.serve(view.source, beat, last=over)
            if over:
                return
            count += 1
            now_s = time.monotonic()
            next_s = max(next_s + FRAME_S, now_s + LEAST_PAUSE_S)
            await asyncio.sleep(self._pause(next_s - now_s))

    async def _draw_maps(self) -> None:
        """Tell the guard's limits of the axes that somebody looks at."""
        for view in self.views.values():
            if view.clients:
                await view.draw_map()

    async def _attend(self, connection: ServerConnection) -> None:
        """Serve a client until it is gone."""
        request = connection.request
        given = token_of(request) if request is not None else ""
        if given and not is_token(given, self._token):
            await connection.close(1008, "the token in the address is not that of this run")
            return
        if sum(len(view.clients) for view in self.views.values()) >= MOST_CLIENTS:
            await connection.close(1013, f"{MOST_CLIENTS} other pages are connected already")
            return
        client = Client(connection, turns=bool(given))
        self._show(client, next(iter(self.views)))
        try:
            async for message in connection:
                self._take(client, message)
        except ConnectionClosed:
            pass
        finally:
            self._leave(client)
            self._first.hold(client, None)
            if client.asks is not None:
                client.asks.cancel()

    def _show(self, client: Client, name: str) -> None:
        """Let a client look at an axis, from now on."""
        self._leave(client)
        view = self.views[name]
        client.axis, client.tail = name, view.source.first()
        view.welcome(client, {"controls": client.turns, "axis": name, "axes": [*self.views]})

    def _leave(self, client: Client) -> None:
        view = self.views.get(client.axis, self._first)
        view.clients.discard(client)
        view.grasp(client, None)

    def _take(self, client: Client, message: str | bytes) -> None:
        """Take a request of a client, or refuse it; without the token it may choose an axis."""
        try:
            request = json.loads(message)
        except (ValueError, RecursionError):
            request = None
        if isinstance(request, dict):
            axis = request.get("axis")
            if isinstance(axis, str) and axis in self.views:
                self._show(client, axis)
                return
            if client.turns and self._granted(client, request):
                return
        trouble = "this page may not change the wall"
        if client.turns:
            trouble = f"not understood: {message[:80]!r}"
        client.tell({"kind": "refused", "words": trouble})

    def _granted(self, client: Client, request: dict[str, Any]) -> bool:
        """Fulfil a request of a client that may turn knobs; return False where it is none.

        It is ``{"set": {PATH: VALUE}, "id": N}``, ``{"hand": {"position": X, "stiffness": K}}``
        every 50 ms, ``{"hold": BEAT}`` after each beat, or one of the last two with null.
        """
        sets, hand, number = (
            sets_of(request.get("set"), client.axis),
            request.get("hand"),
            request.get("id"),
        )
        view = self.views[client.axis]
        if sets is not None:
            known = number is None or is_number(number)
            if known and self.run_socket is not None:
                self._ask(client, self.run_socket, sets, number)
            return known
        if "hand" in request and (hand is None or isinstance(hand, dict)):
            return view.grasp(client, hand)
        return "hold" in request and view.hold(client, request["hold"])

    @staticmethod
    def _ask(client: Client, run: Path, sets: list[str], number: object) -> None:
        """Pass a wish on, in place of the client's last one if that still waits."""
        if client.asks is not None:
            client.asks.cancel()

        def answer(told: dict[str, Any]) -> None:
            client.tell({"kind": "answer", "id": number, **told})

        client.asks = asyncio.create_task(ask(run, sets, answer))
