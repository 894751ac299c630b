"""Builds the requests for samples, of lengths by which late replies are known, and decodes them."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Final, NamedTuple

from haptic_wall.hw.dynamixel.codec import BROADCAST, ExpectedReplies, Instruction, encode
from haptic_wall.hw.dynamixel.wire import JOINT_PART_BYTES, Read
from haptic_wall.hw.servo import Outcome

SAMPLE: Final = struct.Struct("<HxxhhIi")
"""From 120: tick, moving, moving status, PWM, current, velocity, position"""
_FIELDS: Final = "H4xh4xi"
"""Of these only tick, current and position"""
_UNPACK: Final = struct.Struct("<" + _FIELDS).unpack_from
SAMPLE_ADDRESS: Final = 120
SAMPLE_END: Final = SAMPLE_ADDRESS + SAMPLE.size
LENGTHS: Final = range(16, 49)
"""Of the blocks with a sample; the bytes beside it are unused"""
_FROM_SAMPLE: Final = 27
"""Longest block that begins with the sample and ends with Present Temperature (146) at most; a
longer one ends with the sample"""
_QUARANTINE: Final = 31
"""Requests before the length of an unanswered one is used again, 15 ms at 2 kHz; fewer than there
are lengths, so that one is always free"""


class Sample(NamedTuple):
    """The answer to one request, in the servo's own units; zeros unless the outcome is OK."""

    outcome: Outcome
    counts: int
    """Multi-turn position"""
    current: int
    """Signed, in the model's current unit"""
    alert: bool
    """A hardware error is latched."""
    sampled_ns: int
    """When the request was sent [ns]"""


def block_address(length: int) -> int:
    """Return the first register of the block with a sample that has this length."""
    return SAMPLE_ADDRESS if length <= _FROM_SAMPLE else SAMPLE_END - length


class Lengths:
    """Chooses the lengths of the blocks of a request: none to which a late reply may still come.

    Attributes:
        blocks: First register of each block with a sample, by its length.
    """

    def __init__(self) -> None:
        self.blocks = {length: block_address(length) for length in LENGTHS}
        self._number = 0
        """Of the next request"""
        self._free_at = dict.fromkeys(LENGTHS, 0)
        """First request that may have a length again"""

    def begin(self, wide: int = 0) -> int:
        """Begin a request; return the shortest length that is free.

        Args:
            wide: Length of a wider block, if there is one: see ``keep``.
        """
        number, free_at, length = self._number, self._free_at, LENGTHS.start
        while free_at[length] > number:
            length += 1
        if not wide:
            free_at[length] = number + 2  # not for the next one: a copy of the reply may follow
        self._number = number + 1
        return length

    def keep(self, asked: SampleRequest, requests: int = _QUARANTINE) -> None:
        """Keep the lengths of the last request for late replies.

        Args:
            asked: The request.
            requests: Number of the following ones that may not have them.
        """
        for length in asked.used:
            self._free_at[length] = self._number + requests

    def widen(self, address: int, end: int) -> None:
        """Register a wider block around the sample; no other block has its length.

        Args:
            address: Its begin, at 120 at most.
            end: After its last register, at 136 at least.
        """
        self.blocks[end - address] = address
        self._free_at.setdefault(end - address, 0)

    def is_free(self, length: int) -> bool:
        """Whether no reply of this length to an earlier request may still come."""
        return self._free_at[length] <= self._number


_TOGETHER: Final[dict[Read, tuple[Instruction, Instruction]]] = {
    "fast": (Instruction.FAST_SYNC_READ, Instruction.FAST_BULK_READ),
    "sync": (Instruction.SYNC_READ, Instruction.BULK_READ),
}
"""Instructions that read several servos: equal blocks, and different ones"""


class SampleRequest:
    """A request for the samples of some servos, of one of them perhaps in a wider block.

    Args:
        way: How they are read.
        ids: The servos, in the order of their replies.
        length: Number of bytes of a block; no other request has as many.
        wide: The one servo, and address and length of its block, which begins at 120 at most.

    Attributes:
        blocks: Address and length of each servo's block, by id.
        used: All lengths.
        frames: The request on the wire; of servos that are read one by one, one for each.
        expected: Recognises the undisturbed replies; None: each is searched for.
        parts: Bytes of each part of a joint reply, where they differ.
    """

    def __init__(
        self,
        way: Read,
        ids: Sequence[int],
        length: int,
        wide: tuple[int, int, int] | None = None,
    ) -> None:
        address = block_address(length)
        self.blocks = dict.fromkeys(ids, (address, length))
        if wide is not None:
            self.blocks[wide[0]] = wide[1:]
        self.used = {size for _, size in self.blocks.values()}
        self.expected: ExpectedReplies | None = None
        self.parts: Sequence[int] = ()
        shares = {id_: struct.pack("<HH", *block) for id_, block in self.blocks.items()}
        if way == "plain":
            self.frames = [encode(id_, Instruction.READ, share) for id_, share in shares.items()]
        elif wide is None:
            self.frames = [encode(BROADCAST, _TOGETHER[way][0], shares[ids[0]] + bytes(ids))]
        else:
            listed = b"".join(bytes([id_]) + share for id_, share in shares.items())
            self.frames = [encode(BROADCAST, _TOGETHER[way][1], listed)]
            self.parts = [size + JOINT_PART_BYTES for _, size in self.blocks.values()]
        if wide is None and address == SAMPLE_ADDRESS and len(self.frames) == 1:
            self.expected = ExpectedReplies(ids, length, _FIELDS, joint=way == "fast")

    def unpack(self, id_: int, data: bytes) -> tuple[int, int, int] | None:
        """Return tick, current and position from a servo's data; None: it answers another one."""
        address, length = self.blocks[id_]
        if len(data) != length:
            return None
        tick, current, position = _UNPACK(data, SAMPLE_ADDRESS - address)
        return tick, current, position
