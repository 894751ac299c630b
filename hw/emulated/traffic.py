"""Defines the units of traffic on the wire: pieces of instructions, and replies."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, NamedTuple

from haptic_wall.hw.dynamixel.codec import Frame
from haptic_wall.hw.dynamixel.codec.frames import HEADER

_INSTRUCTION_AT: Final = 7
"""Offset of the instruction in a frame"""


class Piece(NamedTuple):
    """Bytes on their way to the servos, split so that a piece contains at most one header."""

    arrival_ns: int
    """Time at which the bytes were put on the wire [ns]"""
    wire_ns: int
    """Their travel time [ns]"""
    baud: int
    data: bytes


class Reply(NamedTuple):
    """A reply that is scheduled or on the wire."""

    begin_ns: int
    end_ns: int
    baud: int
    frame: Frame
    """The frame that the servo sent"""
    wire: bytes
    """The received bytes"""
    late_ns: int
    """Added delay [ns]"""
    faults: tuple[str, ...]
    """The faults that hit it"""


def pieces(data: bytes) -> Iterator[bytes]:
    """Split the host's bytes into pieces, before every header."""
    start = 0
    while start < len(data):
        end = data.find(HEADER, start + 1)
        if end < 0:
            end = len(data)
        yield data[start:end]
        start = end


def instruction_of(piece: bytes) -> int | None:
    """Return the instruction code of a frame; None if the frame is truncated before it."""
    return piece[_INSTRUCTION_AT] if len(piece) > _INSTRUCTION_AT else None
