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
    PREAMBLE,
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

    def __init__(self, ids: Sequence[int], size: int, fields: str, *, joint: bool = False) -> None:
        rest = size - calcsize("<" + fields) + 2
        part = size + 4  # of a joint reply: error, id, data, CRC
        self._ids = bytes(ids)
        self._count = len(ids)
        self._joint = joint
        lengths = {BROADCAST: 1 + len(ids) * part} if joint else dict.fromkeys(ids, part)
        self._prefixes = [
            HEADER + bytes((id_, length & 0xFF, length >> 8, Instruction.STATUS))
            for id_, length in lengths.items()
        ]
        self._size = part if joint else PREAMBLE + part
        self._total = PREAMBLE + lengths[BROADCAST] if joint else len(ids) * self._size
        self._ends = range(_FIXED + part - 2, self._total, part)
        """Places of the checksums of a joint reply"""
        self._layout = Struct(f"<{'Bx' if joint else f'{_FIXED}xB'}{fields}{rest}x")

    def match(self, data: bytes) -> Iterable[tuple[Any, ...]] | None:
        """Return error and fields of each if ``data`` is exactly these replies.

        Returns:
            None: Use a ``Parser``; stuffed replies need one too.
        """
        if len(data) != self._total or not data.startswith(self._prefixes[0]):
            return None
        if self._joint:
            if data[_FIXED + 1 :: self._size] != self._ids:
                return None
            # Each: the last one is right too if those after a damaged part heard it as damaged.
            at = crc = 0
            for end in self._ends:
                crc = crc16(data[at:end], crc)
                if crc != data[end] | data[end + 1] << 8:
                    return None
                at = end
            return self._layout.iter_unpack(data[_FIXED:])
        if data.count(MARK) != self._count:
            return None
        if self._count == 1:  # in one step: a loop takes a tenth of the cycle
            return (self._layout.unpack(data),) if _crc_is_right(data) else None
        size = self._size
        for at, prefix in zip(range(0, self._total, size), self._prefixes, strict=True):
            if not data.startswith(prefix, at) or not _crc_is_right(data[at : at + size]):
                return None
        return self._layout.iter_unpack(data)


class SyncWrite:
    """Builds the sync writes that send a 16-bit value to each of some servos."""

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
