"""The interface of a line: transfers uninterpreted bytes to and from a bus; a port or memory."""

from __future__ import annotations

from typing import Protocol

from haptic_wall.hw.clock import Clock


class Line(Protocol):
    """One end of a half-duplex bus."""

    @property
    def clock(self) -> Clock:
        """Return the clock of its deadlines."""
        ...

    def write(self, data: bytes) -> None:
        """Send all of ``data`` in one piece (a gap of 1.5 ms inside a frame breaks it)."""
        ...

    def read(self) -> bytes:
        """Return the received bytes, without waiting; empty when there are none."""
        ...

    def wait(self, deadline_ns: int) -> bool:
        """Wait for bytes until ``deadline_ns`` [ns]; return whether there are any."""
        ...

    def close(self) -> None:
        """Close the line."""
        ...
