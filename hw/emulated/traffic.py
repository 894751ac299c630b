"""Traffic on the wire: pieces of instructions one way, replies the other."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, NamedTuple

from haptic_wall.hw.dynamixel.codec import Frame

HEADER: Final = b"\xff\xff\xfd\x00"
_INSTRUCTION_AT: Final = 7
"""Where in a frame the instruction stands"""


class Piece(NamedTuple):
    """Bytes on their way to the servos: at most one frame, which ends where they end."""

    arrival_ns: int
    """When they were given to the wire [ns]"""
    wire_ns: int
    """How long they travel [ns]"""
    baud: int
    data: bytes


class Reply(NamedTuple):
    """A reply that is owed or on the wire."""

    begin_ns: int
    end_ns: int
    baud: int
    frame: Frame
    """What the servo said"""
    wire: bytes
    """What is heard of it"""
    late_ns: int
    """How long it is held up [ns]"""
    faults: tuple[str, ...]
    """What has struck it"""


def pieces(data: bytes) -> Iterator[bytes]:
    """Cut the bytes of the host in front of every header."""
    start = 0
    while start < len(data):
        end = data.find(HEADER, start + 1)
        if end < 0:
            end = len(data)
        yield data[start:end]
        start = end


def instruction_of(piece: bytes) -> int | None:
    """The instruction of a frame; None where it is cut short in front of it."""
    return piece[_INSTRUCTION_AT] if len(piece) > _INSTRUCTION_AT else None
