"""The live page's listening socket, its address, and the token of its knobs."""

from __future__ import annotations

import importlib.util
import re
import secrets
import socket
from dataclasses import dataclass
from typing import Final

from haptic_wall.controller.errors import PlatformError, UserError

_PLACE: Final = re.compile(r"(?:\[(?P<six>[^\]]+)\]|(?P<host>[^:\[\]]+)):(?P<port>\d{1,5})")


@dataclass(frozen=True, slots=True)
class Live:
    """A page that is about to be served."""

    descriptor: int
    """Of the socket that listens"""
    host: str
    """Name in the address"""
    address: str
    """Address for a browser; with the token, if there is one"""
    token: str
    """Token of clients that may turn the knobs; empty: no client may"""


def live_at(place: str, *, control: bool = False, field: str = "--live") -> Live:
    """Listen at ``HOST:PORT``.

    Args:
        place: ``HOST:PORT`` as given; port 0: a free one.
        control: Whether a client with this address may change the wall.
        field: The option that named it.

    Raises:
        PlatformError: The package ``websockets`` is not installed.
        UserError: The place is not valid, or cannot be listened at.
    """
    if importlib.util.find_spec("websockets") is None:
        raise PlatformError(
            "the live page needs the package websockets, which is not installed",
            advice="run pip install -e '.[live]' in the clone",
        )
    found = _parsed(place)
    if found is None:
        raise UserError(
            f"found {place!r}",
            field=field,
            wanted="HOST:PORT, for example localhost:8080",
        )
    host, port = found
    try:
        family, _, _, _, where = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        listener = socket.create_server(where[:2], family=family, backlog=64)
    except (OSError, UnicodeError, OverflowError) as error:
        why = getattr(error, "strerror", None) or error
        raise UserError(
            f"cannot listen at {place} ({why})",
            field=field,
            advice="give another port, or localhost:0 for a free one",
        ) from None
    port = listener.getsockname()[1]
    token = secrets.token_urlsafe(16) if control else ""
    name = f"[{host}]" if ":" in host else host
    address = f"http://{name}:{port}/" + (f"?token={token}" if token else "")
    return Live(listener.detach(), host, address, token)


def _parsed(place: str) -> tuple[str, int] | None:
    """Return host and port of ``HOST:PORT``, an IPv6 address in brackets; None: it is not that."""
    found = _PLACE.fullmatch(place)
    if found is None or int(found["port"]) > 65535:
        return None
    return found["six"] or found["host"], int(found["port"])
