"""Passes the changes of a running wall to the recorder, which writes them into the log.

A socket keeps each event whole, and holds it until it is in the log: a recorder that dies leaves it
to the next one.
"""

from __future__ import annotations

import json
import socket
from collections.abc import Callable, Mapping
from typing import Any, Final

MOST_BYTES: Final = 1 << 20
"""Longer than the socket takes"""


def event_sockets() -> tuple[socket.socket, socket.socket]:
    """Return the two ends: for the process that sends events, and for the recorder."""
    return socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)


def send_event(peer: socket.socket, change: dict[str, Any]) -> bool:
    """Send a change; return whether the log will have it. It never waits.

    A change that is too long for the socket, because of a table, is sent without its new values.
    """
    for sent in (change, change | {"changed": None}):
        try:
            peer.send(json.dumps(sent, allow_nan=False).encode(), socket.MSG_DONTWAIT)
        except BlockingIOError:
            return False  # many wait: the log cannot be written
        except (OSError, ValueError):
            continue
        return True
    return False


def change_text(change: Mapping[str, Any]) -> str:
    """Return a change in one line, for people; ``change`` is as in a report."""
    asked = " ".join(change["set"])
    if change["outcome"] != "applied":
        return f"{asked}: {change['outcome']}: {change['why']}"
    commanded = change.get("commanded") or {}
    units = {"stiffness": "N·m/rad", "damping": "N·m·s/rad"}
    known = {name: value for name, value in commanded.items() if value is not None}
    values = ", ".join(f"{value:.4g} {units[name]}" for name, value in known.items())
    return f"{asked}: applied; commanded: {values}"


def take_events(peer: socket.socket, write: Callable[[dict[str, Any]], None]) -> None:
    """Write the events that have come.

    Args:
        peer: The recorder's end.
        write: Writes one. If it raises, the event stays for the next call.
    """
    while True:
        try:
            found = peer.recv(MOST_BYTES, socket.MSG_PEEK | socket.MSG_DONTWAIT)
        except BlockingIOError:
            return
        if not found:
            return  # the other side has ended
        write(json.loads(found))
        peer.recv(1)  # drops all of it
