"""Streams rows as JSON objects in UDP datagrams, which PlotJuggler reads live.

The sender never waits for the network: datagrams that the network does not take at once are
dropped.
"""

from __future__ import annotations

import ipaddress
import json
import math
import re
import socket
from dataclasses import dataclass

from haptic_wall.controller.errors import UserError
from haptic_wall.controller.logs.columns import finite_rows
from haptic_wall.controller.runtime.telemetry import Telemetry

RATE_HZ = 100.0
"""Default rate of the stream [rows/s]"""
_PLACE = re.compile(r"(?:\[(?P<six>[^\]]+)\]|(?P<host>[^:\[\]]+)):(?P<port>\d{1,5})")


@dataclass(frozen=True, slots=True)
class Stream:
    """Destination and rate of the stream."""

    host: str
    """An address, not a name: no name is looked up during a run"""
    port: int
    rate_hz: float
    """Rows per second [Hz]; every row where it is the loop's rate or more"""


def stream_to(place: str, rate_hz: float, anywhere: bool) -> Stream:
    """Return the stream to ``HOST:PORT``; looks the name up.

    Args:
        place: As a person writes it; an IPv6 address in brackets.
        rate_hz: Rows per second [Hz].
        anywhere: Other machines' addresses are allowed.

    Raises:
        UserError: It is no valid place, unknown, another machine's, or the rate is invalid.
    """
    if not 0.0 < rate_hz < math.inf:
        raise UserError(f"found {rate_hz:g}", field="--stream-rate", wanted="a rate above 0 Hz")
    host, port = parsed_place(place) or ("", 0)
    if not port:
        raise UserError(
            f"found {place!r}",
            field="--stream",
            wanted="HOST:PORT with a port of 1 to 65535, for example localhost:9870",
        )
    try:
        addresses = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)
    except (OSError, UnicodeError) as error:
        why = getattr(error, "strerror", None) or error
        raise UserError(
            f"the host {host} is not known ({why})",
            field="--stream",
            advice="give another name, or its address",
        ) from None
    # A name often has addresses of both protocols, and receivers often listen on IPv4 only.
    addresses.sort(key=lambda address: address[0] != socket.AF_INET)
    address, _, *more = addresses[0][4]
    scope = f"%{more[1]}" if more and more[1] else ""  # fe80::1 exists on each interface
    stream = Stream(f"{address}{scope}", port, rate_hz)
    if not anywhere and not _is_here(stream):
        raise UserError(
            f"{host} is not this machine ({stream.host}), so others in the network "
            "could read the rows",
            field="--stream",
            advice=f"add --stream-anywhere to allow this, or give for example localhost:{port}",
        )
    return stream


def parsed_place(place: str) -> tuple[str, int] | None:
    """Return host and port of ``HOST:PORT``, an IPv6 address in brackets; None: it is not that."""
    found = _PLACE.fullmatch(place)
    if found is None or int(found["port"]) > 65535:
        return None
    return found["six"] or found["host"], int(found["port"])


def _is_here(stream: Stream) -> bool:
    """Whether an address is this machine's own; sends nothing."""
    address = ipaddress.ip_address(stream.host.partition("%")[0])
    if address.is_loopback or address.is_unspecified:
        return True
    with _socket(stream) as probe:
        try:
            probe.connect((stream.host, stream.port))
        except OSError:  # no route, or a broadcast address
            return False
        # For its own address a machine uses the same address as source.
        own = probe.getsockname()[0].partition("%")[0]
    return ipaddress.ip_address(own) == address


def _socket(stream: Stream) -> socket.socket:
    family = socket.AF_INET6 if ":" in stream.host else socket.AF_INET
    return socket.socket(family, socket.SOCK_DGRAM)


class Sender:
    """Sends the rows of a run that fall on a coarser grid than the loop's.

    Args:
        telemetry: Source of the rows.
        stream: Destination and rate.
        loop_hz: The loop's rate [Hz].
    """

    def __init__(self, telemetry: Telemetry, stream: Stream, loop_hz: float) -> None:
        self._telemetry = telemetry
        self._stream = stream
        self._every = max(1, round(min(loop_hz / stream.rate_hz, 1e18)))
        self._tail = 0
        self._origin_ns: int | None = None
        self._said: set[str] = set()
        self._socket = _socket(stream)
        self._socket.setblocking(False)
        self._connected = False

    def send(self) -> list[str]:
        """Send the rows since the last call; never waits.

        Returns:
            Sentences on errors that occurred for the first time.
        """
        rows, self._tail = self._telemetry.read(self._tail)
        if rows.size == 0:
            return []
        if self._origin_ns is None:
            self._origin_ns = int(rows["deadline_ns"][0])
        chosen = rows[rows["seq"] % self._every == 0]
        troubles = []
        for row in finite_rows(chosen, self._origin_ns):
            message = {"timestamp": row.pop("time_s"), **row}
            try:
                self._deliver(json.dumps(message, allow_nan=False).encode())
            except BlockingIOError:
                continue  # more than the network takes
            except OSError as error:
                why = error.strerror or str(error)
                if why not in self._said:
                    self._said.add(why)
                    troubles.append(
                        f"--stream: {self._stream.host} port {self._stream.port} cannot be reached"
                        f" ({why}); the run is not disturbed, and sending goes on"
                    )
        return troubles

    def close(self) -> None:
        """Let go of the socket."""
        self._socket.close()

    def _deliver(self, datagram: bytes) -> None:
        # Connected, so that the receiver's refusal is reported; a route may appear later.
        if not self._connected:
            self._socket.connect((self._stream.host, self._stream.port))
            self._connected = True
        self._socket.send(datagram)
