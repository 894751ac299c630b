"""Builds and recognises the frames that a running cycle repeats, in a few steps.

Any other frame is left to the ``Parser``; the frames built here equal those of ``encode``.
"""

from __future__ import annotations

from collections.abc import Sequence
from struct import Struct, pack
from typing import Final

from haptic_wall.hw.dynamixel.codec.frames import (
    BROADCAST,
    HEADER,
    MARK,
    Instruction,
    crc16,
    encode,
)

_FIXED: Final = 8
"""Bytes of a reply before its error byte: header, id, length, instruction"""


class ExpectedReply:
    """Recognises the one reply that a cyclic request expects, without a search."""

    __slots__ = ("_prefix", "_size")

    def __init__(self, id: int, size: int) -> None:  # noqa: A002
        self._prefix = _reply_prefix(id, size + 4)
        self._size = _FIXED + size + 3

    def match(self, data: bytes) -> bytes | None:
        """Return error byte and data of the reply if ``data`` is exactly that.

        Returns:
            ``size`` + 1 bytes; None: use a ``Parser``.
        """
        if len(data) != self._size or not data.startswith(self._prefix):
            return None
        body = data[_FIXED:-2]
        return body if _crc_is_right(data) and MARK not in body else None


class ExpectedFastReply:
    """Recognises the expected joint reply of all servos to a cyclic fast sync read.

    Args:
        ids: Ids of the requested servos, in the requested order.
        size: Requested bytes of each.
    """

    __slots__ = ("_ids", "_prefix", "_share", "_size")

    def __init__(self, ids: Sequence[int], size: int) -> None:
        self._ids = bytes(ids)
        self._share = size + 4
        length = 1 + len(ids) * self._share
        self._prefix = _reply_prefix(BROADCAST, length)
        self._size = _FIXED - 1 + length

    def match(self, data: bytes) -> bool:
        """Whether ``data`` is exactly that, with a part of each servo; else it needs a parser.

        The parts begin at the ninth byte: error, id, data, CRC. The last CRC covers all of them.
        """
        return (
            len(data) == self._size
            and data.startswith(self._prefix)
            and data[_FIXED + 1 :: self._share] == self._ids
            and _crc_is_right(data)
        )


class SyncWrite:
    """Builds the sync writes that send a 16-bit value to each of some servos."""

    __slots__ = ("_fields", "_head", "_shares")

    def __init__(self, address: int, ids: Sequence[int]) -> None:
        self._shares = Struct("<" + "Bh" * len(ids))
        self._fields = [field for id_ in ids for field in (id_, 0)]
        self._head = pack("<HH", address, 2)

    def encode(self, values: Sequence[int]) -> bytes:
        """Return the frame with a value for each servo, in the order of the ids.

        Raises:
            ValueError: The number of values differs from the number of ids. struct.error: A value
            does not fit in 16 bits with a sign.
        """
        fields = self._fields
        fields[1::2] = values
        return encode(BROADCAST, Instruction.SYNC_WRITE, self._head + self._shares.pack(*fields))


def _crc_is_right(frame: bytes) -> bool:
    return crc16(frame[:-2]) == frame[-2] | frame[-1] << 8


def _reply_prefix(id_: int, length: int) -> bytes:
    """Return the beginning of a reply, up to its instruction."""
    return HEADER + bytes((id_, length & 0xFF, length >> 8, Instruction.STATUS))
