"""Defines the units of traffic on the wire: pieces of instructions, and replies."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from typing import Final, NamedTuple

from haptic_wall.hw.dynamixel.codec import Frame
from haptic_wall.hw.dynamixel.codec.frames import HEADER

ID_AT: Final = 4
"""Offset of the id in a frame"""
_INSTRUCTION_AT: Final = 7
"""Offset of the instruction in a frame"""


class Part(NamedTuple):
    """Bytes of one sender: a whole frame, or what a servo appends to a joint reply."""

    id: int | None
    """None: they begin with no header"""
    wire: bytes


class Piece(NamedTuple):
    """Bytes on their way to the servos, split so that a piece contains at most one header."""

    arrival_ns: int
    """Time at which the bytes were put on the wire [ns]"""
    wire_ns: int
    """Their travel time [ns]"""
    baud: int
    data: bytes


class Answer(NamedTuple):
    """A reply to be sent."""

    delay_ns: int
    """Time from the end of the bytes before it on the wire to its first byte [ns]"""
    frame: Frame
    """The first one where several servos with one id reply at once"""
    parts: Sequence[Part]
    """The frame's bytes, or the result of a collision; a joint reply has a part for each servo
    behind its beginning, perhaps not for all"""


class Reply(NamedTuple):
    """A reply that is scheduled or on the wire."""

    begin_ns: int
    end_ns: int
    baud: int
    frame: Frame
    """The frame that the servo sent"""
    parts: Sequence[Part]
    """The sent bytes, by sender"""
    wire: bytes
    """The received bytes"""
    gaps: Sequence[tuple[int, int]]
    """Offsets of these before which faults make a pause, and its length [ns]"""
    faults: Sequence[tuple[int | None, str]]
    """The faults that hit it, each with the id of the frame or part"""

    def begin_of(self, ids: Collection[int]) -> int | None:
        """Return the offset of the first byte that one of these servos sent; None: none did."""
        begin = 0
        for part in self.parts:
            if part.id in ids:
                return begin
            begin += len(part.wire)
        return None


def pieces(data: bytes) -> Iterator[bytes]:
    """Split the host's bytes into pieces, before every header."""
    start = 0
    while start < len(data):
        end = data.find(HEADER, start + 1)
        if end < 0:
            end = len(data)
        yield data[start:end]
        start = end


def id_of(wire: bytes) -> int | None:
    """Return the id in a frame's bytes; None where they do not begin with a header."""
    return wire[ID_AT] if wire.startswith(HEADER) and len(wire) > ID_AT else None


def instruction_of(piece: bytes) -> int | None:
    """Return the instruction code of a frame; None if the frame is truncated before it."""
    return piece[_INSTRUCTION_AT] if len(piece) > _INSTRUCTION_AT else None
