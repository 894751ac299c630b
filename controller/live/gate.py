"""Decides which clients may see the page and turn its knobs, by host name, origin and token."""

from __future__ import annotations

import hmac
import ipaddress
from functools import cache
from importlib.resources import files
from typing import Final
from urllib.parse import parse_qs, urlsplit

from websockets.datastructures import Headers
from websockets.http11 import Request, Response

ROWS_PATH: Final = "/rows"
"""Path of the websocket"""
_TYPES: Final = {
    "html": "text/html; charset=utf-8",
    "css": "text/css; charset=utf-8",
    "js": "text/javascript; charset=utf-8",
    "LICENSE": "text/plain; charset=utf-8",
}
_POLICY: Final = "default-src 'self'; img-src 'self' data: blob:"


def judged(request: Request, own_host: str) -> Response | None:
    """Return the answer to a request: a file or a refusal; None: the websocket may open.

    A page of another origin must not read the rows. So the host name in the request must be this
    server's own name, or an address: otherwise another page could let its own name point here. The
    origin that a browser sends must be the same. The path is compared as it came, and never taken
    apart as an address.

    Args:
        request: Request of a client.
        own_host: Host name in the address that was given out.
    """
    hosts, origins = request.headers.get_all("Host"), request.headers.get_all("Origin")
    if len(hosts) > 1 or len(origins) > 1 or not request.path.isascii():
        return _answer(400, "Bad Request", "wanted one Host, one Origin, and a path in ASCII\n")
    host = hosts[0] if hosts else ""
    if not _is_ours(host, own_host):
        return _answer(403, "Forbidden", f"this server does not have the name {host!r:.200}\n")
    path = request.path.partition("?")[0]
    if path == ROWS_PATH:
        if origins and origins[0] != f"http://{host}":
            return _answer(403, "Forbidden", f"a page of {origins[0]!r:.200} may not read this\n")
        return None
    found = _page().get(path)
    if found is None:
        return _answer(404, "Not Found", "there is no such file\n")
    # Only pages of this machine may show this one in a frame, as that of the demo does.
    return _answer(200, "OK", *found, framed=f"http://{urlsplit(f'http://{host}').hostname}:*")


def token_of(request: Request) -> str:
    """Return the token in a request's address; empty: none."""
    return parse_qs(request.path.partition("?")[2]).get("token", [""])[0]


def is_token(given: str, token: str) -> bool:
    """Whether a token is right; no token is right if the knobs are disabled."""
    return bool(token) and hmac.compare_digest(given.encode(), token.encode())


def _is_ours(host: str, own_host: str) -> bool:
    try:
        name = urlsplit(f"http://{host}").hostname or ""
    except ValueError:
        return False
    if name in ("localhost", own_host.lower()):
        return True
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


@cache
def _page() -> dict[str, tuple[bytes, str]]:
    """Return every file of the page by its path, with its type."""
    found = {}
    for file in (files("haptic_wall.controller.live") / "page").iterdir():
        kind = _TYPES.get(file.name.rpartition(".")[2])
        if kind is not None:
            found[f"/{file.name}"] = file.read_bytes(), kind
    found["/"] = found["/index.html"]
    return found


def _answer(
    status: int,
    reason: str,
    body: str | bytes,
    kind: str = "text/plain; charset=utf-8",
    *,
    framed: str = "'none'",
) -> Response:
    content = body.encode() if isinstance(body, str) else body
    headers = Headers(
        {
            "Content-Type": kind,
            "Content-Length": str(len(content)),
            "Content-Security-Policy": f"{_POLICY}; frame-src {framed}; frame-ancestors {framed}",
            "Cache-Control": "no-store",
            "Referrer-Policy": "no-referrer",
            "X-Content-Type-Options": "nosniff",
        }
    )
    return Response(status, reason, headers, content)
