"""When servos answer a ping for all: in the order of their ids, with a slot for each one missing.

The manual is silent about how long the slots are. The vendor's SDK waits 3 ms for each of 253 ids
beside the bytes' own time (``broadcastPing``), and users of its Arduino library report that a lone
servo with id 5 needs more than 10 ms to answer. Here a missing id costs 3 ms.
"""

from __future__ import annotations

from collections.abc import Sequence

from haptic_wall.hw.dynamixel.codec import BROADCAST, Frame, Instruction
from haptic_wall.hw.emulated.answers import Answer

SLOT_NS = 3_000_000
"""For an id that is not there [ns]"""


def in_slots(frame: Frame, answers: Sequence[Answer]) -> Sequence[Answer]:
    """The answers to ``frame``, later by the slots in front of them if it is a ping for all."""
    if frame.id != BROADCAST or frame.instruction != Instruction.PING:
        return answers
    slotted = []
    expected = 0
    for reply in answers:
        missing = max(0, reply.frame.id - expected)
        slotted.append(reply._replace(delay_ns=reply.delay_ns + missing * SLOT_NS))
        expected = reply.frame.id + 1
    return slotted
