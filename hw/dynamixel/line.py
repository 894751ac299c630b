"""A line: bytes to and from a bus, never interpreted. A serial port, or memory."""

from __future__ import annotations

from typing import Protocol

from haptic_wall.hw.clock import Clock


class Line(Protocol):
    """One end of a half-duplex bus."""

    @property
    def clock(self) -> Clock:
        """Clock that its deadlines are told by."""
        ...

    def write(self, data: bytes) -> None:
        """Send all of ``data`` in one piece (a gap of 1.5 ms inside a frame breaks it)."""
        ...

    def read(self) -> bytes:
        """All that has arrived, without waiting; empty when nothing has."""
        ...

    def wait(self, deadline_ns: int) -> bool:
        """Wait for bytes until ``deadline_ns`` [ns]; whether there are any."""
        ...

    def close(self) -> None:
        """Let go of the line."""
        ...
