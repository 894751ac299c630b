"""Executes an instruction on one servo: returns its error code and the parameters of its reply.

Source: ROBOTIS e-Manual, "DYNAMIXEL Protocol 2.0", instruction details.
"""

from __future__ import annotations

from typing import NamedTuple

from haptic_wall.hw.dynamixel.codec import ErrorCode, Frame, Instruction
from haptic_wall.hw.emulated.servo import EmulatedServo


def carry_out(frame: Frame, servo: EmulatedServo, now_ns: int) -> tuple[int, bytes]:
    """Execute ``frame`` at ``now_ns`` [ns]; the caller decides whether a reply is sent.

    Returns:
        The error code and the reply's parameters.
    """
    params = frame.params
    if frame.error == ErrorCode.CRC:
        return ErrorCode.CRC, b""
    address = int.from_bytes(params[:2], "little")
    match frame.instruction:
        case Instruction.PING:
            number = servo.model.number.to_bytes(2, "little")
            return ErrorCode.NONE, number + bytes([servo.firmware])
        case Instruction.READ:
            size = int.from_bytes(params[2:4], "little")
            if len(params) != 4 or not size:
                return ErrorCode.DATA_LENGTH, b""
            data = servo.read(address, size, now_ns)
            return (ErrorCode.ACCESS, b"") if data is None else (ErrorCode.NONE, data)
        case Instruction.WRITE:
            if len(params) < 3:
                return ErrorCode.DATA_LENGTH, b""
            return servo.write(address, params[2:], now_ns), b""
        case Instruction.REBOOT:
            servo.reboot(now_ns)
            return ErrorCode.NONE, b""
    return ErrorCode.INSTRUCTION, b""


READS = frozenset(
    {
        Instruction.SYNC_READ,
        Instruction.FAST_SYNC_READ,
        Instruction.BULK_READ,
        Instruction.FAST_BULK_READ,
    }
)
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
    if len(params) % _BULK_ENTRY:
        return []
    found = [
        Entry(params[at], params[at + 1 : at + 5]) for at in range(0, len(params), _BULK_ENTRY)
    ]
    return list({entry.id: entry for entry in reversed(found)}.values())[::-1]


def _sync_writes(params: bytes) -> list[Entry]:
    block = int.from_bytes(params[2:4], "little") + 1
    data = params[4:]
    if block == 1 or len(data) % block:
        return []
    return [
        Entry(data[at], params[:2] + data[at + 1 : at + block]) for at in range(0, len(data), block)
    ]
