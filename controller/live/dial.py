"""The dial: takes changes of the running wall from other terminals.

It listens on the run's socket. A request and each answer is one line of JSON. Clients are served
one after the other, each within limits of size and time; whatever they send, only the door is
concerned.
"""

from __future__ import annotations

import contextlib
import json
import math
import re
import socket
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

from haptic_wall.controller.errors import HapticWallError, UserError
from haptic_wall.controller.live.ask import NotAppliedError
from haptic_wall.controller.live.run_socket import MOST_BYTES, NOT_MADE, OVER
from haptic_wall.hw.clock import ready
from haptic_wall.hw.errors import Problem

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
_NUMBERS: Final = re.compile(r"\d[-+.\de]*")


def serve(
    listener: socket.socket, desk: Callable[[], ChangeDesk], ends: Callable[[], bool]
) -> None:
    """Serve one client until it has its answer; return if none comes within ``IDLE_S``.

    Args:
        listener: Listens, and does not block.
        desk: Returns the desk that makes the changes.
        ends: Returns whether the run is over.
    """
    if not ready([listener.fileno()], IDLE_S):
        return
    try:
        connection, _ = listener.accept()
    except OSError:
        return  # it has gone again
    with connection:
        connection.setblocking(False)
        client = _Client(connection)
        try:
            sets, wait_s = _request(client.line(ends))
        except HapticWallError as error:
            client.say({"error": str(error), "exit_status": error.exit_status})
        else:
            client.say(desk().change(sets, wait_s, client.tell_wait, client.gone))


def _request(line: bytes) -> tuple[list[str], float]:
    """Return the changes of a request, and the longest wait for their moment [s].

    Raises:
        UserError: It is none.
    """
    try:
        request = json.loads(line)
        sets, wait_s = request["set"], float(request.get("wait_s", 0.0))
        whole = isinstance(sets, list) and all(isinstance(each, str) for each in sets)
    except (ValueError, OverflowError, TypeError, KeyError, AttributeError, RecursionError):
        whole = False
    if not whole or not 0.0 <= wait_s <= MOST_WAIT_S or len(sets) > MOST_SETS:
        raise UserError(
            'wanted one line {"set": ["PATH=VALUE", ...], "wait_s": S}, with S from 0 to '
            f"{MOST_WAIT_S:g}",
        )
    return sets, wait_s


class _Client:
    """A client with a change.

    Args:
        connection: To the client; it does not block.
    """

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection
        self._waits_s = math.inf
        """Since when its change waits"""
        self._told = ""

    def line(self, ends: Callable[[], bool]) -> bytes:
        """Return the line that it sends.

        Raises:
            UserError: It sends none in time, closes, or sends too much.
            NotAppliedError: The run is over.
        """
        sent, until_s = b"", time.monotonic() + READ_S
        while b"\n" not in sent and len(sent) < MOST_BYTES:
            if ends():
                raise NotAppliedError(Problem(f"not applied: {OVER}"), NOT_MADE)
            if time.monotonic() > until_s:
                raise UserError(f"no whole request came within {READ_S:g} s")
            if ready([self._connection.fileno()], IDLE_S):
                found = self._received()
                if found == b"":
                    raise UserError("the connection was closed before a whole request")
                sent += found or b""
        line, _, _ = sent.partition(b"\n")
        if len(line) >= MOST_BYTES:
            raise UserError(f"found a request of more than {MOST_BYTES} bytes")
        return line

    def gone(self) -> bool:
        """Whether it has closed the connection."""
        return self._received() == b""

    def _received(self) -> bytes | None:
        """Return the bytes that have come; None: none have; empty: it has gone."""
        try:
            return self._connection.recv(MOST_BYTES)
        except BlockingIOError:
            return None
        except OSError:
            return b""

    def tell_wait(self, obstacle: str) -> None:
        """Tell it why its change waits, each reason once; empty: that is not known."""
        now_s = time.monotonic()
        self._waits_s = min(self._waits_s, now_s)
        kind = _NUMBERS.sub("", obstacle)  # the same obstacle, of another size
        if obstacle and kind != self._told and now_s > self._waits_s + TOLD_S:
            self._told = kind
            self.say({"waits": obstacle})

    def say(self, what: dict[str, Any]) -> None:
        """Send it a line."""
        with contextlib.suppress(OSError):  # it has gone, or does not read
            self._connection.send((json.dumps(what) + "\n").encode())
