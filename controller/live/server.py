"""Serves the page and sends rows to it, 30 times a second, to each client as fast as it reads.

Rows that a client has not read yet stay in the memory of rows: the server sends nothing to a client
before its buffer is empty. So a slow client gets fewer and larger messages, and finally a gap.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
import socket
import time
from collections import deque
from collections.abc import Awaitable, Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from websockets.asyncio.server import Server, ServerConnection, broadcast, serve
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from haptic_wall.controller.errors import HapticWallError
from haptic_wall.controller.live.dead_man import DeadMan
from haptic_wall.controller.live.frames import CHANNELS, frame
from haptic_wall.controller.live.gate import is_token, judged, token_of
from haptic_wall.controller.live.guard_map import guard_map
from haptic_wall.controller.live.marks import Mark, MarkFinder, change_mark
from haptic_wall.controller.live.relay import ask, sets_of
from haptic_wall.controller.live.scene import law_over_position
from haptic_wall.controller.live.source import Source
from haptic_wall.controller.settings.config import Config
from haptic_wall.hw.hand import SharedHand

FRAME_S: Final = 1.0 / 30.0
"""Time between two messages [s]"""
END_S: Final = 0.3
"""Longest wait for the clients at the end [s]"""
MOST_CLIENTS: Final = 64
MOST_REQUEST: Final = 4096
"""Largest message of a client [bytes]"""
MOST_NUMBER: Final = 1e6
"""Largest number for a hand [rad or N·m/rad]"""
MOST_ROWS: Final = 16384
"""Rows in one message"""
MOST_MARKS: Final = 1000
"""Events that are kept"""
_LAW_EVERY: Final = 15
"""Messages between two looks at the law's range, and the guard's delay"""
_SAME_DELAY: Final = 0.03
"""Relative change of the delay that is not drawn [1]"""
_WAITING_TEXTS: Final = 100
"""Texts that wait for a slow client; the oldest are dropped"""


class Client:
    """A page.

    Args:
        connection: Connection to the page.
        tail: Number of the first row that it gets.
        turns: Whether it may turn knobs.
    """

    def __init__(self, connection: ServerConnection, tail: int, *, turns: bool) -> None:
        self._connection = connection
        self.tail = tail
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

    def serve(self, source: Source, beat: int | None = None) -> None:
        """Send the new rows and texts, if the client has read everything sent before.

        Args:
            source: Of the rows.
            beat: Of the dead man, for a client that may hold it; None: no page holds it.
        """
        if self.buffered:
            return
        if beat is not None and self.turns:
            broadcast((self._connection,), json.dumps({"kind": "beat", "beat": beat}))
        while self._texts:
            broadcast((self._connection,), self._texts.popleft())
        origin_ns = source.origin_ns()
        rows, tail = source.read(self.tail, MOST_ROWS)
        if origin_ns and len(rows):
            self.tail = tail
            broadcast((self._connection,), frame(rows, origin_ns))


class View:
    """The state of a run that all clients see.

    Args:
        config: Configuration at the start of the run.
        name: Of the run, for people.
        source: Of its rows.
        recorded: Whether the run is a log.
        hand: A person's hand on the simulated servo; None: the run has none.
        dead_man: The dead man; None: no page holds it.
        judged_as: Returns configuration and delay whose limits the map shows, from those in force.

    Attributes:
        dead_man: See above.
        judged_as: See above.
    """

    def __init__(
        self,
        config: Config,
        name: str,
        source: Source,
        *,
        recorded: bool,
        hand: SharedHand | None = None,
        dead_man: DeadMan | None = None,
        judged_as: Callable[[Config, float], tuple[Config, float]] = lambda *given: given,
    ) -> None:
        self.judged_as = judged_as
        self._hand = hand
        self.dead_man = dead_man
        self._holds: object = None
        self.shaft = math.nan
        """Position of the shaft [rad]; not a number: not known yet"""
        self.config = config
        self.source = source
        self.clients: set[Client] = set()
        self._hello = {
            "kind": "hello",
            "name": name,
            "channels": CHANNELS,
            "rate_hz": config.loop.rate_hz,
            "capacity": source.capacity,
            "recorded": recorded,
            "hand": hand is not None,
            "dead_man": dead_man is not None,
        }
        self._marks: deque[Mark] = deque(maxlen=MOST_MARKS)
        self._finder = MarkFinder()
        self._tail = 0
        self._started_at = math.nan
        self._span = (math.inf, -math.inf)
        self.stiffness = math.nan
        """Commanded now [N·m/rad]; not a number: not known yet"""
        self.delay = math.nan
        """That the guard uses [s]; not a number: not known yet"""
        self._map: dict[str, Any] = {}
        self._map_of: tuple[Config, float] | None = None
        self._law: dict[str, Any] = {}
        self._law_of: tuple[Any, ...] = ()
        self._ended = ""

    def welcome(self, client: Client, *, controls: bool) -> None:
        """Send a new client everything that the other clients already have."""
        client.tell(self._hello | {"controls": controls})
        client.tell({"kind": "wall", **self._wall()})
        client.tell({"kind": "marks", "marks": [mark.plain() for mark in self._marks]})
        for drawn in filter(None, (self._law, self._map)):
            client.tell(drawn)
        if self._ended:
            client.tell({"kind": "ended", "words": self._ended})
        self.clients.add(client)

    def recall(self, ended: Mapping[str, Any], changes: Sequence[Mapping[str, Any]]) -> None:
        """Show what a log tells: the changes, and how the run ended."""
        known = [each for each in changes if each.get("at_s") is not None]
        self.add([change_mark(each) for each in known])
        if ended.get("stop_reason"):
            self.end(f"the run ended: {ended['stop_reason']}")

    def grasp(self, client: object, wish: Mapping[str, Any] | None) -> bool:
        """Let a client's hand hold the shaft, or let go; one client holds it at a time.

        Args:
            client: Whose hand.
            wish: ``position`` [rad] and ``stiffness`` [N·m/rad]; None: it lets go.

        Returns:
            False: that is no wish.
        """
        hand, now_ns = self._hand, time.monotonic_ns()
        if hand is None:
            return False
        if wish is None:
            if client is self._holds:
                self._holds = None
                hand.release()
            return True
        numbers = [wish.get("position"), wish.get("stiffness")]
        if not all(isinstance(each, int | float) and abs(each) < MOST_NUMBER for each in numbers):
            return False
        free = self._holds in (None, client) or hand.look(now_ns) is None
        if free and math.isfinite(self.shaft):
            self._holds = client
            hand.hold(float(wish["position"]), float(wish["stiffness"]), self.shaft, now_ns)
        return True

    def hold(self, client: Client, beat: object) -> bool:
        """Let a client hold the dead man, or let go.

        Args:
            client: Who holds.
            beat: The newest one that the client has; None: it lets go.

        Returns:
            False: that is no beat, or no page holds the dead man.
        """
        if self.dead_man is None:
            return False
        if beat is None:
            self.dead_man.release(client)
        elif isinstance(beat, int):
            self.dead_man.answer(client, beat, time.monotonic_ns())
        else:
            return False
        return True

    def add(self, marks: list[Mark]) -> None:
        """Send events to all clients."""
        if marks:
            self._marks += marks
            self.tell({"kind": "marks", "marks": [mark.plain() for mark in marks]})

    def change(self, config: Config) -> None:
        """Show another configuration, after a change of the running wall."""
        self.config = config
        self.tell({"kind": "wall", **self._wall()})

    def end(self, words: str) -> None:
        """Tell all clients that the run has ended."""
        self._ended = words
        self.tell({"kind": "ended", "words": words})

    def tell(self, what: dict[str, Any]) -> None:
        """Tell all clients."""
        for client in self.clients:
            client.tell(what)

    def look(self, most: int) -> None:
        """Process the new rows, at most ``most`` of them."""
        origin_ns = self.source.origin_ns()
        rows, tail = self.source.read(self._tail, most)
        if not origin_ns or not len(rows):
            return
        self._tail = tail
        self.add(self._finder.look(rows, origin_ns))
        position = rows["position"][np.isfinite(rows["position"])]
        if len(position):
            self.shaft = float(position[-1])
            if math.isnan(self._started_at):
                self._started_at = float(position[0])
            low, high = self._span
            self._span = min(low, float(position.min())), max(high, float(position.max()))
        self.stiffness = float(rows["stiffness"][-1])
        self.delay = float(rows["delay_s"][-1])

    def draw_law(self) -> None:
        """Send the curve of the law if the law or the range of motion has changed."""
        low, high = self._span
        if math.isnan(self._started_at) or not math.isfinite(self.stiffness):
            return
        wanted = (self.config, float(f"{self.stiffness:.3g}"))
        drawn = self._law
        inside = bool(drawn) and drawn["low"] <= low and high <= drawn["high"]
        if not inside or wanted != self._law_of:
            self._law_of = wanted
            law = law_over_position(self.config, self._started_at, self.stiffness, low, high)
            self._law = {"kind": "law", **law}
            self.tell(self._law)

    async def draw_map(self) -> None:
        """Tell the guard's limits, where the wall, or the delay, is another one."""
        config, delay = self.config, self.delay
        if not math.isfinite(delay):
            return
        if self._map_of is not None:
            drawn, at = self._map_of
            if drawn is config and abs(delay - at) <= _SAME_DELAY * at:
                return
        self._map_of = config, delay
        try:
            found = await asyncio.to_thread(guard_map, *self.judged_as(config, delay))
        except (ValueError, HapticWallError) as error:  # a wall whose limits are not known
            found = {"trouble": str(error)}
        self._map = {"kind": "map", **found}
        self.tell(self._map)

    def _wall(self) -> dict[str, Any]:
        data = self.config.model_dump(mode="json")
        return {"wall": data["wall"], "delay_steps": data["delay"]["steps"]}


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


class LiveServer:
    """Serves one view.

    Args:
        view: The run.
        host: Name in the printed address.
        token: Token of clients that may turn knobs; empty: no client may.
        run_socket: Socket of the run that takes changes; None: the run takes none.
        pause: Returns for how long to wait until the next messages [s].
        further: Called with requests that are not those of the live page, of clients that may turn
            knobs; returns whether it took the request.
    """

    def __init__(
        self,
        view: View,
        host: str,
        token: str = "",
        run_socket: Path | None = None,
        pause: Callable[[float], float] = lambda wanted_s: wanted_s,
        further: Callable[[Client, dict[str, Any]], bool] = lambda _client, _request: False,
    ) -> None:
        self._further = further
        self._view = view
        self._host = host
        self._token = token
        self.run_socket = run_socket
        self._pause = pause

    async def run(self, listener: socket.socket, until: Callable[[], bool]) -> None:
        """Serve until ``until`` says so.

        Args:
            listener: Bound and listening.
            until: Called with every message; true: end.
        """
        server = await opened(listener, self.attend, lambda request: judged(request, self._host))
        await self.pump(until)
        await closed(server)
        self.abort()

    def abort(self) -> None:
        """Close all connections at once."""
        for client in tuple(self._view.clients):
            client.abort()

    async def pump(self, until: Callable[[], bool]) -> None:
        """Send rows and texts to the clients, until ``until`` says so."""
        view, count = self._view, 0
        draws: asyncio.Task[None] | None = None
        while True:
            over = until()  # asked first: what it knows of is still sent
            view.look(MOST_ROWS)
            if count % _LAW_EVERY == 0:
                view.draw_law()
                if draws is None or draws.done():
                    draws = asyncio.create_task(view.draw_map())
            man = view.dead_man
            beat = None if man is None else man.beat(time.monotonic_ns())
            for client in tuple(view.clients):
                client.serve(view.source, beat)
            if over:
                return
            count += 1
            await asyncio.sleep(self._pause(FRAME_S))

    async def attend(self, connection: ServerConnection) -> None:
        """Serve a client until it is gone."""
        view, request = self._view, connection.request
        given = token_of(request) if request is not None else ""
        if given and not is_token(given, self._token):
            await connection.close(1008, "the token in the address is not that of this run")
            return
        if len(view.clients) >= MOST_CLIENTS:
            await connection.close(1013, f"{MOST_CLIENTS} others look on already")
            return
        client = Client(connection, view.source.first(), turns=bool(given))
        view.welcome(client, controls=client.turns)
        try:
            async for message in connection:
                self._take(client, message)
        except ConnectionClosed:
            pass
        finally:
            view.clients.discard(client)
            view.grasp(client, None)
            view.hold(client, None)
            if client.asks is not None:
                client.asks.cancel()

    def _take(self, client: Client, message: str | bytes) -> None:
        """Take a request of a client.

        It is ``{"set": {PATH: VALUE}, "id": N}``, ``{"hand": {"position": X, "stiffness": K}}``
        every 50 ms, ``{"hold": BEAT}`` after each beat, or one of the last two with null.
        """
        try:
            request = json.loads(message)
        except (ValueError, RecursionError):
            request = None
        if not isinstance(request, dict):
            request = {}
        if client.turns and self._further(client, request):
            return
        sets, hand = sets_of(request.get("set")), request.get("hand")
        grasps = "hand" in request and (hand is None or isinstance(hand, dict))
        if sets is None and not grasps and "hold" not in request:
            client.tell({"kind": "refused", "words": f"not understood: {message[:80]!r}"})
        elif not client.turns:
            client.tell({"kind": "refused", "words": "this page may look, but not change the wall"})
        elif sets is None:
            view = self._view
            known = view.grasp(client, hand) if grasps else view.hold(client, request["hold"])
            if not known:
                client.tell({"kind": "refused", "words": f"not understood: {message[:80]!r}"})
        elif self.run_socket is not None:
            self._ask(client, self.run_socket, sets, request.get("id"))

    @staticmethod
    def _ask(client: Client, run: Path, sets: list[str], number: object) -> None:
        """Pass a wish on, in place of the client's last one if that still waits."""
        if client.asks is not None:
            client.asks.cancel()

        def answer(told: dict[str, Any]) -> None:
            client.tell({"kind": "answer", "id": number, **told})

        client.asks = asyncio.create_task(ask(run, sets, answer))
