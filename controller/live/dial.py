"""The dial: takes changes of the running wall from other terminals.

It listens on the run's socket. A request and each answer is one line of JSON. Clients are served
one after the other, each within limits of size and time; whatever they send, only the door is
concerned.
"""

from __future__ import annotations

import contextlib
import json
import re
import socket
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

from haptic_wall.controller.live.run_socket import MOST_BYTES, NOT_MADE, OVER
from haptic_wall.hw.clock import ready

if TYPE_CHECKING:
    from haptic_wall.controller.live.change_desk import ChangeDesk

READ_S: Final = 2.0
"""Time for a client to send its request [s]"""
TOLD_S: Final = 0.3
"""The client of a change that waits for longer than this is told so [s]"""
MOST_WAIT_S: Final = 3600.0
"""Longest wait that can be asked for [s]"""
MOST_SETS: Final = 100
IDLE_S: Final = 0.5
"""Longest wait for a request [s]"""
_LOOK_S: Final = 0.01
_NUMBERS: Final = re.compile(r"\d[-+.\de]*")


class Dial:
    """Serves clients.

    Args:
        listener: Listens, and does not block.
        desk: Returns the desk that makes the changes; called at the first request.
    """

    def __init__(self, listener: socket.socket, desk: Callable[[], ChangeDesk]) -> None:
        self._listener = listener
        self._open_desk = desk
        self._desk: ChangeDesk | None = None
        self._client: socket.socket | None = None
        self._began_s = 0.0
        """When the client came, or its change was begun"""
        self._sent = b""
        self._asks = False
        """Whether the client's change is at the desk"""
        self._told = ""

    def serve(self, most_s: float = IDLE_S) -> None:
        """Read a request that has come, and continue the present change; returns soon.

        Args:
            most_s: Longest wait for a request [s].
        """
        heard = self._client or (None if self._asks else self._listener)
        wait_s = min(_LOOK_S, most_s) if self._asks else most_s
        if heard is None:
            time.sleep(wait_s)  # the desk gives the change up whose client has gone
        elif ready([heard.fileno()], wait_s):
            if self._client is None:
                self._accept()
            else:
                self._read(self._client)
        if self._asks:
            self._go_on(self.prepare())
        elif self._client is not None and time.monotonic() > self._began_s + READ_S:
            self._refuse(f"no whole request came within {READ_S:g} s")

    def prepare(self) -> ChangeDesk:
        """Load the desk that makes the changes, before the first request; return it."""
        if self._desk is None:
            self._desk = self._open_desk()
        return self._desk

    def close(self) -> None:
        """Tell a waiting client that the run is over, and leave."""
        if self._asks:
            self._end(self.prepare().give_up())
        elif self._client is not None:
            self._end({"error": f"not applied: {OVER}", "exit_status": NOT_MADE})
        self._listener.close()

    def _accept(self) -> None:
        try:
            self._client, _ = self._listener.accept()
        except OSError:
            return  # it has gone again
        self._client.setblocking(False)
        self._began_s, self._sent, self._told = time.monotonic(), b"", ""

    def _read(self, client: socket.socket) -> None:
        try:
            found = client.recv(MOST_BYTES)
        except BlockingIOError:
            return
        except OSError:
            found = b""
        if self._asks:
            if not found:  # it has gone: its change is given up
                self.prepare().withdraw()
                client.close()
                self._client = None
            return
        if not found:
            self._leave()
            return
        self._sent += found
        line, end, _ = self._sent.partition(b"\n")
        if len(line) >= MOST_BYTES:
            self._refuse(f"found a request of more than {MOST_BYTES} bytes")
        elif end:
            self._take(line)

    def _take(self, line: bytes) -> None:
        try:
            request = json.loads(line)
            sets, wait_s = request["set"], float(request.get("wait_s", 0.0))
            whole = isinstance(sets, list) and all(isinstance(each, str) for each in sets)
        except (ValueError, OverflowError, TypeError, KeyError, AttributeError, RecursionError):
            whole = False
        if not whole or not 0.0 <= wait_s <= MOST_WAIT_S or len(sets) > MOST_SETS:
            self._refuse(
                'wanted one line {"set": ["PATH=VALUE", ...], "wait_s": S}, with S from 0 to '
                f"{MOST_WAIT_S:g}",
            )
            return
        told = self.prepare().begin(sets, wait_s)
        self._began_s, self._asks = time.monotonic(), True
        if told is not None:
            self._end(told)

    def _go_on(self, desk: ChangeDesk) -> None:
        told = desk.look()
        if told is not None:
            self._end(told)
        elif time.monotonic() > self._began_s + TOLD_S:
            obstacle = desk.obstacle()
            kind = _NUMBERS.sub("", obstacle)  # the same obstacle, of another size
            if obstacle and kind != self._told:
                self._told = kind
                self._say({"waits": obstacle})

    def _end(self, told: dict[str, Any]) -> None:
        self._asks = False
        self._say(told)
        self._leave()

    def _refuse(self, why: str) -> None:
        self._say({"error": why, "exit_status": 2})
        self._leave()

    def _say(self, what: dict[str, Any]) -> None:
        if self._client is not None:
            with contextlib.suppress(OSError):  # it has gone, or does not read
                self._client.send((json.dumps(what) + "\n").encode())

    def _leave(self) -> None:
        if self._client is not None:
            self._client.close()
            self._client = None
