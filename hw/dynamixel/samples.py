"""Requests and decodes a servo's samples."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from enum import Enum
from typing import Final, NamedTuple

from haptic_wall.hw.dynamixel.codec import BROADCAST, ExpectedReplies, Instruction, encode
from haptic_wall.hw.servo import Outcome

SAMPLE: Final = struct.Struct("<HxxhhIi")
"""From 120: tick, moving, moving status, PWM, current, velocity, position"""
_FIELDS: Final = "H4xh4xi"
"""Of these only tick, current and position"""
SAMPLE_ADDRESS: Final = 120
SAMPLE_END: Final = SAMPLE_ADDRESS + SAMPLE.size
LENGTHS: Final = range(16, 49)
"""Of the blocks with a sample; the bytes beside it are unused"""
_FROM_SAMPLE: Final = 27
"""Longest block that begins with the sample and ends with Present Temperature (146) at most; a
longer one ends with the sample"""
QUARANTINE: Final = 31
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


class Way(Enum):
    """Ways to read servos, from the fastest."""

    FAST = Instruction.FAST_SYNC_READ
    """One request, one joint reply; firmware 45 or later, X330 46"""
    SYNC = Instruction.SYNC_READ
    """One request, a reply of each"""
    PLAIN = Instruction.READ
    """One request, one reply: the way of a single servo"""


class SampleRequest:
    """A request for the samples of some servos, perhaps in a wider block.

    Args:
        way: How they are read.
        ids: The servos, in the order of their replies.
        address: First register of the block, at 120 at most.
        length: Number of bytes; no other block has as many.
        prepared: Prepare the pattern of the replies, if the block begins with the sample.

    Attributes:
        length: Number of bytes.
        frame: The request on the wire.
        expected: Recognises the undisturbed replies; None: each is searched for.
        unpack: Takes tick, current and position from a reply's data.
    """

    def __init__(
        self, way: Way, ids: Sequence[int], address: int, length: int, *, prepared: bool = False
    ) -> None:
        self.length = length
        block = struct.pack("<HH", address, length)
        if way is Way.PLAIN:
            self.frame = encode(ids[0], Instruction.READ, block)
        else:
            self.frame = encode(BROADCAST, way.value, block + bytes(ids))
        self.expected: ExpectedReplies | None = None
        if prepared and address == SAMPLE_ADDRESS:
            self.expected = ExpectedReplies(ids, length, _FIELDS, joint=way is Way.FAST)
        self.unpack = struct.Struct(f"<{SAMPLE_ADDRESS - address}x{_FIELDS}").unpack_from
