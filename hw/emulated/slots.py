"""Delays the replies to a broadcast ping: in the order of ids, with a slot for each missing one.

The manual is silent about the length of the slots. The vendor's SDK waits 3 ms for each of 253 ids
in addition to the bytes' own time (``broadcastPing``), and users of its Arduino library report that
a lone servo with id 5 needs more than 10 ms to reply. Here a missing id costs 3 ms.
"""

from __future__ import annotations

from collections.abc import Sequence

from haptic_wall.hw.dynamixel.codec import BROADCAST, Frame, Instruction
from haptic_wall.hw.emulated.answers import Answer

SLOT_NS = 3_000_000
"""Time for a missing id [ns]"""


def in_slots(frame: Frame, answers: Sequence[Answer]) -> Sequence[Answer]:
    """Delay the replies to ``frame`` by the slots before them if it is a broadcast ping."""
    if frame.id != BROADCAST or frame.instruction != Instruction.PING:
        return answers
    slotted = []
    expected = 0
    for reply in answers:
        missing = max(0, reply.frame.id - expected)
        slotted.append(reply._replace(delay_ns=reply.delay_ns + missing * SLOT_NS))
        expected = reply.frame.id + 1
    return slotted
