"""Clients of the live page that read what they get and draw nothing, or never read.

    python -m scripts.live_clients ADDRESS COUNT SECONDS

They speak the protocol by hand, and stand back as the page does: they are for clients on another
machine, which take no time from the threads that carry the loop's bytes on this one.
"""

from __future__ import annotations

import selectors
import socket
import sys
import time
from urllib.parse import urlsplit

from haptic_wall.controller.live.gate import ROWS_PATH
from haptic_wall.controller.runtime.realtime import stand_back

CONNECT_S = 30.0
"""Longest wait for the server's first answer [s]"""


def client(address: str) -> socket.socket:
    """Return a websocket to the rows of a page, after its handshake.

    Args:
        address: As ``run --live`` prints it.

    Raises:
        ConnectionError: The server refuses.
    """
    place = urlsplit(address)
    assert place.hostname is not None and place.port is not None
    link = socket.create_connection((place.hostname, place.port), CONNECT_S)
    lines = [
        f"GET {ROWS_PATH}?{place.query} HTTP/1.1",
        f"Host: {place.netloc}",
        "Upgrade: websocket",
        "Connection: Upgrade",
        "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==",
        "Sec-WebSocket-Version: 13",
        "\r\n",
    ]
    link.sendall("\r\n".join(lines).encode())
    head = b""
    while not head.endswith(b"\r\n\r\n"):
        byte = link.recv(1)
        head += byte
        if not byte:
            break
    if not head.startswith(b"HTTP/1.1 101 "):
        link.close()
        raise ConnectionError(f"the page at {address} refuses a client: {head[:200]!r}")
    return link


def read_all(address: str, count: int, seconds: float) -> int:
    """Let clients read for a time, or until the server ends; return the bytes of all of them."""
    with selectors.DefaultSelector() as ready:
        for _ in range(count):
            ready.register(client(address), selectors.EVENT_READ)
        room, total, end_s = memoryview(bytearray(1 << 20)), 0, time.monotonic() + seconds
        while ready.get_map() and time.monotonic() < end_s:
            for key, _ in ready.select(0.1):
                link = key.fileobj
                assert isinstance(link, socket.socket)
                try:
                    found = link.recv_into(room)
                except ConnectionError:
                    found = 0
                total += found
                if not found:
                    ready.unregister(link)
                    link.close()
        for key in [*ready.get_map().values()]:
            assert isinstance(key.fileobj, socket.socket)
            key.fileobj.close()
    return total


if __name__ == "__main__":
    stand_back()
    print(read_all(sys.argv[1], int(sys.argv[2]), float(sys.argv[3])))
