"""Parses the joint reply to a fast sync read: a complete one in one step, else its valid parts.

Every servo appends its part and a checksum over everything before it. So the last checksum
validates a complete reply, and parts before a missing or broken one are valid.
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
from haptic_wall.hw.dynamixel.samples import LENGTHS, SAMPLE, SAMPLE_FIELDS

_HEAD: Final = b"\xff\xff\xfd\x00\xfe"
_HEAD_BYTES: Final = 8
_PREAMBLE: Final = 7
_SHARE: Final = f"Bx{SAMPLE_FIELDS}"
"""Used fields of a servo's part: error, tick, current and position"""


class JointReply:
    """Recognises a complete joint reply, and extracts its fields.

    Args:
        ids: Ids of the requested servos, in the requested order.
        size: Requested bytes of each, from the sample on.
    """

    __slots__ = ("_expected", "_layout")

    def __init__(self, ids: Sequence[int], size: int) -> None:
        self._expected = ExpectedFastReply(ids, size)
        rest = size - SAMPLE.size + 2  # unused bytes, and the part's CRC
        self._layout = struct.Struct(f"<{_HEAD_BYTES}x" + f"{_SHARE}{rest}x" * len(ids))

    def values(self, data: bytes) -> Iterator[int] | None:
        """Return error, tick, current and position of each servo; None for any other data."""
        if not self._expected.match(data):
            return None
        return iter(self._layout.unpack(data))


class Shares(NamedTuple):
    """The received parts of a joint reply."""

    good: list[FastReply]
    """The parts before the first invalid one"""
    begun: int
    """Number of received parts, partial ones included"""
    whole: bool
    """Whether the last byte was received"""


def shares(raw: bytes | bytearray, count: int, size: int) -> Shares:
    """Return the valid parts of a joint reply in the received bytes."""
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
    """Yield valid parts of late or duplicate replies, which no request waits for.

    Args:
        raw: The bytes.
        count: Number of requested servos.
        size: Requested bytes of each servo in the reply that is awaited first; 0: no reply is
            awaited.
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
    """Return the length of a joint reply of ``count`` servos, ``size`` bytes each [bytes]."""
    return _HEAD_BYTES + count * (size + 4)


def spoilt(raw: bytes | bytearray, size: int) -> int:
    """Return the number of received parts if the joint reply's header is damaged."""
    return max(0, -(-(len(raw) - _HEAD_BYTES) // (size + 4)))


def _head(count: int, size: int) -> bytes:
    length = 1 + count * (size + 4)
    return _HEAD + struct.pack("<HB", length, Instruction.STATUS)


def _in_front(reply: bytes, size: int) -> list[FastReply]:
    """Return the parts with a valid checksum, up to the first invalid one."""
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
