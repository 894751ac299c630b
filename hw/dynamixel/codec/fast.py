"""Encodes and decodes the joint reply to a fast read: one frame with a part of every servo.

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
    Frame,
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


def decode_fast_status(frame: Frame, size: int) -> list[FastReply]:
    """Return each servo's part of a fast sync read reply.

    The frame's last CRC, which the parser has checked, covers all of them.

    Args:
        frame: A reply from the broadcast id.
        size: Requested bytes of each servo.

    Returns:
        The parts in the requested order; empty when this is not such a reply.
    """
    block = size + 4
    count, rest = divmod(len(frame.params) + 3, block)
    if frame.id != BROADCAST or frame.instruction != Instruction.STATUS or rest or not count:
        return []
    shares = bytes((frame.error,)) + frame.params
    return [
        FastReply(shares[at + 1], shares[at], shares[at + 2 : at + 2 + size])
        for at in range(0, count * block, block)
    ]
