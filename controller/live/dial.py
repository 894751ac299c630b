"""The dial: takes changes of the running wall from other terminals.

It listens on the run's socket. A request and each answer is one line of JSON. Clients are read
side by side and served one after the other, each within limits of size, time and number; whatever
they send, only the door is concerned.
"""

from __future__ import annotations

import contextlib
import json
import os
import selectors
import socket
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final, Protocol

from haptic_wall.controller.live.run_socket import (
    MOST_BYTES,
    NOT_MADE,
    OVER,
    Peer,
    peer_of,
)

READ_S: Final = 2.0
"""Time for a client to send its request [s]"""
MOST_CLIENTS: Final = 64
"""Number of clients at a time"""
TOLD_S: Final = 0.3
"""The client of a change that waits for longer than this is told so [s]"""
MOST_WAIT_S: Final = 3600.0
"""Longest wait that can be asked for [s]"""
MOST_SETS: Final = 100
IDLE_S: Final = 0.5
"""Longest wait for a request [s]"""
_LOOK_S: Final = 0.01


class Desk(Protocol):
    """Makes one change at a time."""

    def begin(self, sets: list[str], wait_s: float, peer: Peer) -> dict[str, Any] | None:
        """Begin with a change; return its answer if there already is one."""
        ...

    def look(self) -> dict[str, Any] | None:
        """Return the answer to the change that was begun; None: it waits."""
        ...

    def obstacle(self) -> str:
        """Return why it waits, as words; empty: it does not."""
        ...

    def withdraw(self) -> None:
        """Give it up: ``look`` then returns its answer soon."""
        ...

    def give_up(self, why: str) -> dict[str, Any]:
        """Give it up without waiting for its answer; return one."""
        ...


@dataclass(slots=True)
class _Client:
    connection: socket.socket
    peer: Peer
    until_s: float
    """When its request must be complete"""
    sent: bytearray = field(default_factory=bytearray)
    sets: list[str] | None = None
    """Its request; None: not complete"""
    wait_s: float = 0.0
    told: str = ""


class Dial:
    """Serves clients.

    Args:
        listener: Listens, and does not block.
        desk: Returns the desk that makes the changes; called at the first request.
        credentials: Credentials of a connection.
        owner: The user who may change the wall.
    """

    def __init__(
        self,
        listener: socket.socket,
        desk: Callable[[], Desk],
        credentials: Callable[[socket.socket], Peer] = peer_of,
        owner: int | None = None,
    ) -> None:
        self._listener = listener
        self._open_desk = desk
        self._desk: Desk | None = None
        self._credentials = credentials
        self._owner = os.getuid() if owner is None else owner
        self._selector = selectors.DefaultSelector()
        self._selector.register(listener, selectors.EVENT_READ)
        self._clients: dict[socket.socket, _Client] = {}
        self._waiting: deque[_Client] = deque()
        self._served: _Client | None = None
        self._began_s = 0.0

    def serve(self, most_s: float = IDLE_S) -> None:
        """Read requests that have come, and continue the present change; returns soon.

        Args:
            most_s: Longest wait for a request [s].
        """
        busy = self._served is not None or self._waiting
        for key, _ in self._selector.select(min(_LOOK_S, most_s) if busy else most_s):
            if key.fileobj is self._listener:
                self._accept()
            else:
                self._read(self._clients[key.fileobj])  # type: ignore[index]
        now_s = time.monotonic()
        for client in [each for each in self._clients.values() if each.sets is None]:
            if now_s > client.until_s:
                self._refuse(client, f"no whole request came within {READ_S:g} s")
        self._go_on(now_s)

    def prepare(self) -> None:
        """Load the desk that makes the changes, before the first request."""
        if self._desk is None:
            self._desk = self._open_desk()

    def close(self) -> None:
        """Tell waiting clients that the run is over, and leave all clients."""
        if self._served is not None and self._desk is not None:
            self._end(self._desk.give_up(OVER))
        for client in list(self._waiting):
            self._say(client, {"error": f"not applied: {OVER}", "exit_status": NOT_MADE})
        for client in list(self._clients.values()):
            self._leave(client)
        self._selector.close()
        self._listener.close()

    def _accept(self) -> None:
        try:
            connection, _ = self._listener.accept()
        except OSError:
            return  # it has gone again
        connection.setblocking(False)
        client = _Client(connection, self._credentials(connection), time.monotonic() + READ_S)
        self._clients[connection] = client
        self._selector.register(connection, selectors.EVENT_READ)
        if client.peer.uid != self._owner:
            self._refuse(client, "only the owner of this wall may change it")
        elif len(self._clients) > MOST_CLIENTS:
            self._refuse(client, f"{MOST_CLIENTS} other clients wait; try again")

    def _read(self, client: _Client) -> None:
        try:
            found = client.connection.recv(MOST_BYTES)
        except BlockingIOError:
            return
        except OSError:
            found = b""
        if not found:
            self._leave(client)
            return
        if client.sets is not None:
            return  # it has asked already
        client.sent += found
        line, end, _ = client.sent.partition(b"\n")
        if len(line) >= MOST_BYTES:
            self._refuse(client, f"found a request of more than {MOST_BYTES} bytes")
        elif end:
            self._take(client, bytes(line))

    def _take(self, client: _Client, line: bytes) -> None:
        try:
            request = json.loads(line)
            sets, wait_s = request["set"], float(request.get("wait_s", 0.0))
            whole = isinstance(sets, list) and all(isinstance(each, str) for each in sets)
        except (ValueError, OverflowError, TypeError, KeyError, AttributeError, RecursionError):
            whole = False
        if not whole or not 0.0 <= wait_s <= MOST_WAIT_S or len(sets) > MOST_SETS:
            self._refuse(
                client,
                'wanted one line {"set": ["PATH=VALUE", ...], "wait_s": S}, with S from 0 to '
                f"{MOST_WAIT_S:g}",
            )
            return
        client.sets, client.wait_s, client.sent = sets, wait_s, bytearray()
        self._waiting.append(client)

    def _go_on(self, now_s: float) -> None:
        if self._served is None and self._waiting:
            self._served = client = self._waiting.popleft()
            self.prepare()
            assert self._desk is not None and client.sets is not None
            told = self._desk.begin(client.sets, client.wait_s, client.peer)
            self._began_s = time.monotonic()
            if told is not None:
                self._end(told)
        elif self._served is not None and self._desk is not None:
            told = self._desk.look()
            if told is not None:
                self._end(told)
            elif now_s > self._began_s + TOLD_S:
                self._tell_obstacle(self._served, self._desk.obstacle())

    def _tell_obstacle(self, client: _Client, obstacle: str) -> None:
        kind = obstacle.partition(":")[0]
        if kind != client.told:
            client.told = kind
            self._say(client, {"waits": obstacle})

    def _end(self, told: dict[str, Any]) -> None:
        client, self._served = self._served, None
        if client is not None and client.connection in self._clients:
            self._say(client, told)
            self._leave(client)

    def _refuse(self, client: _Client, why: str) -> None:
        self._say(client, {"error": why, "exit_status": 2})
        self._leave(client)

    def _say(self, client: _Client, what: dict[str, Any]) -> None:
        with contextlib.suppress(OSError):  # it has gone, or does not read
            client.connection.send((json.dumps(what) + "\n").encode())

    def _leave(self, client: _Client) -> None:
        """Close the connection to a client; its change is given up if it still waits."""
        self._selector.unregister(client.connection)
        del self._clients[client.connection]
        client.connection.close()
        if client in self._waiting:
            self._waiting.remove(client)
        if client is self._served and self._desk is not None:
            self._desk.withdraw()
