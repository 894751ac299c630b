"""Counts the bytes of a cycle on a Dynamixel bus, and computes their time on the wire.

Source: ROBOTIS e-Manual, "DYNAMIXEL Protocol 2.0" (frame layout).
"""

from __future__ import annotations

from typing import Final, Literal

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
_GOAL_PART_BYTES: Final = 1 + 2
"""Id and current"""
CYCLE_BYTES: Final = ASKING_BYTES + SAMPLE_BYTES + GOAL_BYTES
"""Of one period of the running cycle with one servo: request, reply, goal"""

Read = Literal["fast", "sync", "plain"]
"""How servos are read: by a fast sync read (one joint reply; firmware 45 or later, X330 46), by a
sync read (a reply of each), or by a read of each, one after the other"""


def wire_ns(count: int, baud: int) -> int:
    """Return the time of ``count`` bytes on the wire [ns].

    Args:
        count: Number of bytes.
        baud: Bits per second, > 0.
    """
    return count * BYTE_AT_ONE_BAUD_NS // baud


def cycle_s(baud: float, count: int = 1, read: Read = "plain") -> float:
    """Return the time of one cycle's frames on the wire [s].

    Args:
        baud: Bits per second, > 0.
        count: Number of servos.
        read: How they are read.
    """
    goals = GOAL_BYTES + _GOAL_PART_BYTES * (count - 1)
    return asking_s(baud, count, read) + wire_s(goals, baud)


def asking_s(baud: float, count: int = 1, read: Read = "plain") -> float:
    """Return the time of a request for all samples, and of the replies [s]; as ``cycle_s``."""
    request = READ_REQUEST_BYTES * count if read == "plain" else READ_REQUEST_BYTES + count
    total = request + _replies(count, read) + SAMPLE_BYTES * count
    return wire_s(total, baud)


def wire_s(count: int, baud: float) -> float:
    """Return the time of ``count`` bytes on the wire [s]; 0 at a rate of 0, which is not known."""
    return count * BYTE_AT_ONE_BAUD_NS * 1e-9 / baud if baud else 0.0


def poll_bytes(count: int, read: Read) -> int:
    """Return the bytes of a request of one servo's wider block, and of the replies, without it."""
    request = READ_REQUEST_BYTES * count if read == "plain" else _FRAME + 5 * count
    return request + _replies(count, read) + SAMPLE_BYTES * (count - 1)


def _replies(count: int, read: Read) -> int:
    """Return the bytes of all replies without their data."""
    if read == "fast":
        return JOINT_HEAD_BYTES + JOINT_PART_BYTES * count
    return EMPTY_REPLY_BYTES * count
