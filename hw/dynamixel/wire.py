"""Counts the bytes of a cycle on a Dynamixel bus, and computes their time on the wire.

Source: ROBOTIS e-Manual, "DYNAMIXEL Protocol 2.0" (frame layout).
"""

from __future__ import annotations

from typing import Final

BYTE_AT_ONE_BAUD_NS: Final = 10_000_000_000
"""A byte takes ten bit times, its start and stop bit included [ns]"""

_FRAME: Final = 4 + 1 + 2 + 1 + 2
"""Header, id, length, instruction, CRC"""
READ_REQUEST_BYTES: Final = _FRAME + 2 + 2
"""Address and length"""
EMPTY_REPLY_BYTES: Final = _FRAME + 1
"""With an error byte; data adds to it"""
JOINT_HEAD_BYTES: Final = 8
"""Of a fast sync read's reply, before the first servo's part"""
JOINT_PART_BYTES: Final = 1 + 1 + 2
"""Error, id, CRC; data adds to it"""
ASKING_BYTES: Final = READ_REQUEST_BYTES + EMPTY_REPLY_BYTES
"""A read and its reply, without the data; a byte's write and its reply are shorter"""
SAMPLE_BYTES: Final = 16
"""From the servo's clock to its position"""
GOAL_BYTES: Final = _FRAME + 2 + 2 + 1 + 2
"""A sync write of one goal current: address, length, id, current"""
CYCLE_BYTES: Final = ASKING_BYTES + SAMPLE_BYTES + GOAL_BYTES
"""Of one period of the running cycle with one servo: request, reply, goal"""


def wire_ns(count: int, baud: int) -> int:
    """Return the time of ``count`` bytes on the wire [ns].

    Args:
        count: Number of bytes.
        baud: Bits per second, > 0.
    """
    return count * BYTE_AT_ONE_BAUD_NS // baud


def cycle_s(baud: float) -> float:
    """Return the time of one cycle's frames on the wire [s].

    Args:
        baud: Bits per second, > 0.
    """
    return CYCLE_BYTES * BYTE_AT_ONE_BAUD_NS * 1e-9 / baud
