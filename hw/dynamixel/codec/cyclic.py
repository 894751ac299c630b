"""Builds and recognises the frames that a running cycle repeats, in a few steps.

Any other frame is left to the ``Parser``; the frames built here equal those of ``encode``.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from struct import Struct, calcsize, pack
from typing import Any, Final

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


class ExpectedReplies:
    """Recognises the replies of some servos in their order, or their joint reply, without a search.

    Args:
        ids: Ids of the requested servos, in the requested order.
        size: Requested bytes of each.
        fields: The layout of the first bytes, as ``struct`` has it.
        joint: They reply to a fast sync read.
    """

    __slots__ = ("_begin", "_ids", "_layout", "_marks", "_prefixes", "_size", "_total", "_unpack")

    def __init__(self, ids: Sequence[int], size: int, fields: str, *, joint: bool = False) -> None:
        rest = size - calcsize("<" + fields) + 2
        if joint:  # each part: error, id, data, CRC
            self._begin = _FIXED
            self._size = size + 4
            self._prefixes = [_reply_prefix(BROADCAST, 1 + len(ids) * self._size)]
            self._layout = Struct(f"<Bx{fields}{rest}x")
        else:
            self._begin = 0
            self._size = _FIXED + size + 3
            self._prefixes = [_reply_prefix(id_, size + 4) for id_ in ids]
            self._layout = Struct(f"<{_FIXED}xB{fields}{rest}x")
        self._unpack = self._layout.unpack
        self._ids = bytes(ids) if joint else None
        self._marks = len(ids)
        self._total = self._begin + len(ids) * self._size

    def match(self, data: bytes) -> Iterable[tuple[Any, ...]] | None:
        """Return error and fields of each if ``data`` is exactly these replies.

        Returns:
            None: Use a ``Parser``; stuffed replies need one too.
        """
        if len(data) != self._total or not data.startswith(self._prefixes[0]):
            return None
        if self._ids is not None:  # the last CRC covers all parts
            right = data[_FIXED + 1 :: self._size] == self._ids and _crc_is_right(data)
            return self._layout.iter_unpack(data[_FIXED:]) if right else None
        if data.count(MARK) != self._marks:
            return None
        if self._marks == 1:
            right = crc16(data[:-2]) == data[-2] | data[-1] << 8
            return (self._unpack(data),) if right else None
        size = self._size
        for at, prefix in zip(range(0, self._total, size), self._prefixes, strict=True):
            if not data.startswith(prefix, at) or not _crc_is_right(data[at : at + size]):
                return None
        return self._layout.iter_unpack(data)


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
