"""Encodes the joint reply to a fast read: one frame with a part of every servo.

It is never stuffed, and each part ends with the CRC of everything before it.

Source: ROBOTIS e-Manual, "DYNAMIXEL Protocol 2.0", fast sync read and fast bulk read.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from haptic_wall.hw.dynamixel.codec.frames import (
    BROADCAST,
    HEADER,
    MAX_LENGTH,
    Instruction,
    crc16,
)


class FastReply(NamedTuple):
    """One servo's part of the joint reply."""

    id: int
    error: int
    data: bytes


def encode_fast_status(replies: Iterable[FastReply]) -> bytes:
    """Return the joint reply, as if every servo had appended its part.

    Raises:
        ValueError: The replies do not fit in a frame.
    """
    items = list(replies)
    length = 1 + sum(len(item.data) + 4 for item in items)
    if length > MAX_LENGTH:
        raise ValueError(f"a reply of {length} bytes does not fit in a frame of {MAX_LENGTH}")
    frame = bytearray(HEADER)
    frame += bytes((BROADCAST, length & 0xFF, length >> 8, Instruction.STATUS))
    crc = crc16(frame)
    for item in items:
        share = bytes((item.error, item.id)) + item.data
        crc = crc16(share, crc)
        share += crc.to_bytes(2, "little")
        frame += share
        crc = crc16(share[-2:], crc)
    return bytes(frame)
