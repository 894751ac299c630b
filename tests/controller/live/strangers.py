"""Requests and messages of strangers to the page's server."""

import contextlib
import logging
import socket
from traceback import walk_tb
from typing import Final

TARGETS: Final = (
    "/", "/rows", "//[", "//[::1", "//x/rows", "/rows?token=", "/rows?token=%ff%00%", "/rows?%5b=[",
    "/rows?token=a&token=b&servo=\xff", "/%2e%2e/server.py", "/" + "%" * 500, "/" + "a" * 9000, "*",
    "http://[/", "http://127.0.0.1/rows", "http://evil.example/rows", "[", "?", "#", "/rows#[", "",
    "/\x00", "/\xff", "/ü€", "/rows?token=" + "1" * 4000, "http://127.0.0.1:99999999/",
)  # fmt: skip
HEADERS: Final = (
    "Host: {0}", "Host: [", "Host: [:::", "Host: \xff", "Host: ]:1", "Host: {0}:{0}", "Host:",
    "Host: a@{0}", "Host: \u2100".encode().decode("latin-1"), "Origin: http://{0}", "Origin: [",
    "Origin: null", "Upgrade: websocket", "Upgrade: ,", 'Upgrade: "', "Connection: Upgrade",
    "Connection: ,;=", "Sec-WebSocket-Version: 13", "Sec-WebSocket-Version: x", "Origin: \x00",
    "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==", "Sec-WebSocket-Key: ü", "Sec-WebSocket-Key: A",
    "Sec-WebSocket-Extensions: ;;=,", "Sec-WebSocket-Extensions: permessage-deflate; a=\"",
    "Sec-WebSocket-Protocol: ,", "Content-Length: 5", "Content-Length: " + "9" * 5000, ": x", "x",
    "Transfer-Encoding: chunked", "Cookie: " + "c" * 9000, " folded", "A: b\r\n" * 200, "Expect: 1",
)  # fmt: skip
UPGRADE: Final = (0, 12, 15, 17, 20)
"""Those that open a websocket"""
FRAMES: Final = (
    b"\x81\x84\0\0\0\0\xff\xfe\xed\xa0",  # a text that is not UTF-8
    b"\x81\x83\0\0\0\0\xed\xa0\x80",  # a lone surrogate
    b"\x81\x02{}",  # without a mask
    b"\xf1\x82\0\0\0\0{}",  # reserved bits
    b"\x8b\x80\0\0\0\0",  # no known kind
    b"\x01\x81\0\0\0\0{\x81\x81\0\0\0\0}",  # a text within a text
    b"\x80\x80\0\0\0\0",  # the rest of none
    b"\x89\xfe\0\x7e\0\0\0\0" + bytes(126),  # a long ping
    b"\x88\x81\0\0\0\0a",  # half a code
    b"\x88\x82\0\0\0\0\xff\xff",  # no code
    b"\x82\xff\xff\xff\xff\xff\xff\xff\xff\xff\0\0\0\0",  # of 2^64 bytes
    b"\x82\xff" + (5000).to_bytes(8, "big") + bytes(5004),
)
NUMBERS: Final = (
    "0", "-1", "1", "1.5", "1e999", "-1e999", "1e-320", "NaN", "-Infinity", "9" * 400, "9" * 3900,
    "-" + "1" * 3900, "1." + "1" * 3900, "1e" + "9" * 3900, "18446744073709551616", "1e300",
)  # fmt: skip
TEXTS: Final = (
    '""', '"wall"', '"profile"', '"x"', '"\\ud800"', '"\\u0000"', '"\\udfff\\ud800"', '"ü€"', '"4"',
    '"' + "a" * 3900 + '"', '"__class__"', '"NaN"', '"../../etc/passwd"',
)  # fmt: skip
VALUES: Final = (
    *NUMBERS, *TEXTS, "null", "true", "false", "[]", "{}", "[[]]", '[{"a": []}]', '{"": null}',
    "[" * 900 + "]" * 900, "[" * 1900 + "]" * 1900, '{"a":' * 450 + "1" + "}" * 450,
    '{"position": 0.1}', "[1, 2]",
)  # fmt: skip
NAMES: Final = (
    "set", "hand", "hold", "own", "scene", "drop", "id", "kind", "wall.law", "wall.stiffness",
    "delay.steps", "wall.profile", "position", "stiffness", "inertia", "damping", "period", "delay",
    "virtual_damping", "\\ud800", "",
)  # fmt: skip


def opened_and(frame: bytes, place: str, query: str = "") -> bytes:
    """Return a request that opens a websocket, and what is sent on it."""
    lines = (HEADERS[number].replace("{0}", place) for number in UPGRADE)
    return "\r\n".join((f"GET /rows{query} HTTP/1.1", *lines, "", "")).encode() + frame


def send(place: str, content: bytes) -> bytes:
    """Send bytes to a server; return the beginning of the answer to a request that is whole."""
    host, _, port = place.rpartition(":")
    with (
        socket.create_connection((host, int(port)), timeout=10.0) as stranger,
        contextlib.suppress(OSError),
    ):
        stranger.sendall(content)
        if b"\r\n\r\n" in content:
            return stranger.recv(4096)
    return b""


def is_ours(record: logging.LogRecord) -> bool:
    """Whether the program raised what is logged; websockets raises where frames come too soon."""
    places = walk_tb(record.exc_info[2] if record.exc_info else None)
    return any("haptic_wall" in frame.f_code.co_filename for frame, _ in places)
