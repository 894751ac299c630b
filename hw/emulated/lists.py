"""Decodes the lists in sync and bulk instructions: the part of each servo.

Source: ROBOTIS e-Manual, "DYNAMIXEL Protocol 2.0", sync and bulk read and write.
"""

from __future__ import annotations

from typing import NamedTuple

from haptic_wall.hw.dynamixel.codec import Frame, Instruction

READS = frozenset(
    {
        Instruction.SYNC_READ,
        Instruction.FAST_SYNC_READ,
        Instruction.BULK_READ,
        Instruction.FAST_BULK_READ,
    }
)
WRITES = frozenset({Instruction.SYNC_WRITE, Instruction.BULK_WRITE})
_BULK_ENTRY = 5
"""Bytes of id, address and size"""


class Entry(NamedTuple):
    """One servo's part: the parameters that a direct instruction would have."""

    id: int
    params: bytes

    @property
    def size(self) -> int:
        """Return the number of requested bytes, for a read."""
        return int.from_bytes(self.params[2:4], "little")


def entries(frame: Frame) -> list[Entry]:
    """Return the parts of a listing instruction, in order; none if its lengths are inconsistent.

    "The same ID cannot be used multiple times" in a bulk instruction: the first one counts.
    """
    params = frame.params
    if frame.instruction in (Instruction.SYNC_READ, Instruction.FAST_SYNC_READ):
        return [Entry(id_, params[:4]) for id_ in params[4:]]
    if frame.instruction == Instruction.SYNC_WRITE:
        return _sync_writes(params)
    if frame.instruction == Instruction.BULK_WRITE:
        return _first_of_each(_bulk_writes(params))
    if len(params) % _BULK_ENTRY:
        return []
    return _first_of_each(
        [Entry(params[at], params[at + 1 : at + 5]) for at in range(0, len(params), _BULK_ENTRY)]
    )


def _sync_writes(params: bytes) -> list[Entry]:
    block = int.from_bytes(params[2:4], "little") + 1
    data = params[4:]
    if block == 1 or len(data) % block:
        return []
    return [
        Entry(data[at], params[:2] + data[at + 1 : at + block]) for at in range(0, len(data), block)
    ]


def _bulk_writes(params: bytes) -> list[Entry]:
    found = []
    at = 0
    while at < len(params):
        head = params[at : at + _BULK_ENTRY]
        size = int.from_bytes(head[3:5], "little")
        data = params[at + _BULK_ENTRY : at + _BULK_ENTRY + size]
        if len(head) < _BULK_ENTRY or not size or len(data) < size:
            return []
        found.append(Entry(head[0], head[1:3] + data))
        at += _BULK_ENTRY + size
    return found


def _first_of_each(found: list[Entry]) -> list[Entry]:
    return list({entry.id: entry for entry in reversed(found)}.values())[::-1]
