"""Parse the joint reply to a fast sync read: all of it in one step, or the shares that came.

Every servo appends its share with a checksum over all before it. So shares in front of a missing or
broken one are whole, and one checksum proves a reply in which none is missing.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

from haptic_wall.hw.dynamixel.codec import (
    BROADCAST,
    ExpectedFastReply,
    FastReply,
    Frame,
    Instruction,
    crc16,
    decode_fast_status,
)
from haptic_wall.hw.dynamixel.samples import LENGTHS, SAMPLE

_HEAD: Final = b"\xff\xff\xfd\x00\xfe"
_HEAD_BYTES: Final = 8
_PREAMBLE: Final = 7
_SHARE: Final = "BxH4xh4xi"
"""What is used of a servo's: error, tick, current and position"""


class JointReply:
    """How the joint reply looks when all is well, and where in it what is.

    Args:
        ids: Of the servos asked, in the order asked.
        size: Bytes asked of each, from the sample on.
    """

    __slots__ = ("_expected", "_layout")

    def __init__(self, ids: Sequence[int], size: int) -> None:
        self._expected = ExpectedFastReply(ids, size)
        rest = size - SAMPLE.size + 2  # unused bytes, and the share's CRC
        self._layout = struct.Struct(f"<{_HEAD_BYTES}x" + f"{_SHARE}{rest}x" * len(ids))

    def values(self, data: bytes) -> Iterator[int] | None:
        """Error, tick, current and position of each, in order; None if it is anything else."""
        if not self._expected.match(data):
            return None
        return iter(self._layout.unpack(data))


class Shares(NamedTuple):
    """Shares of a joint reply that have come."""

    good: list[FastReply]
    """Those in front of the first one that is not"""
    begun: int
    """How many have come, if only in part"""
    whole: bool
    """Whether the last byte is there"""


def shares(raw: bytes | bytearray, count: int, size: int) -> Shares:
    """The good shares of a joint reply among whatever came.

    Args:
        raw: What came since the request.
        count: How many servos were asked.
        size: Bytes asked of each.
    """
    length = 1 + count * (size + 4)
    at = raw.find(_head(count, size))
    if at < 0:
        return Shares([], 0, False)
    reply = bytes(raw[at : at + _PREAMBLE + length])
    begun = -(-(len(reply) - _HEAD_BYTES) // (size + 4))
    whole = len(reply) == _PREAMBLE + length
    if whole and crc16(reply[:-2]) == reply[-2] | reply[-1] << 8:
        frame = Frame(BROADCAST, Instruction.STATUS, reply[8], reply[9:-2])
        return Shares(decode_fast_status(frame, size), begun, whole)
    return Shares(_in_front(reply, size), begun, whole)


def strays(raw: bytes | bytearray, count: int, size: int) -> Iterator[FastReply]:
    """The good shares among whatever came that nobody waits for: those of late replies, or copies.

    Args:
        raw: What came.
        count: How many servos are asked.
        size: Bytes asked of each, of which the first reply is awaited; 0: none is.
    """
    for other in LENGTHS:
        head = _head(count, other)
        at = raw.find(head)
        if other == size and at >= 0:
            at = raw.find(head, at + 1)
        while at >= 0:
            yield from shares(raw[at:], count, other).good
            at = raw.find(head, at + 1)


def joint_bytes(count: int, size: int) -> int:
    """How long the joint reply of so many servos is, with so many bytes of each."""
    return _HEAD_BYTES + count * (size + 4)


def spoilt(raw: bytes | bytearray, size: int) -> int:
    """Of how many servos the shares are in a joint reply whose head is not to be recognised."""
    return max(0, -(-(len(raw) - _HEAD_BYTES) // (size + 4)))


def _head(count: int, size: int) -> bytes:
    length = 1 + count * (size + 4)
    return _HEAD + struct.pack("<HB", length, Instruction.STATUS)


def _in_front(reply: bytes, size: int) -> list[FastReply]:
    """The shares whose own checksum holds, up to the first that is not whole."""
    found = []
    at = _HEAD_BYTES
    crc = crc16(reply[:at])
    while at + size + 4 <= len(reply):
        end = at + size + 4
        crc = crc16(reply[at : end - 2], crc)
        if crc != reply[end - 2] | reply[end - 1] << 8:
            break
        found.append(FastReply(reply[at + 1], reply[at], reply[at + 2 : end - 2]))
        crc = crc16(reply[end - 2 : end], crc)
        at = end
    return found
