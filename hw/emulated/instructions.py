"""Executes an instruction on one servo: returns its error code and the parameters of its reply.

Source: ROBOTIS e-Manual, "DYNAMIXEL Protocol 2.0", instruction details.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import NamedTuple

from haptic_wall.hw.dynamixel.codec import ErrorCode, Frame, Instruction
from haptic_wall.hw.emulated.servo import EmulatedServo

_Done = tuple[int, bytes]


def carry_out(frame: Frame, servo: EmulatedServo, now_ns: int) -> _Done:
    """Execute ``frame`` at ``now_ns`` [ns]; the caller decides whether a reply is sent.

    Returns:
        The error code and the reply's parameters.
    """
    if frame.error == ErrorCode.CRC:
        return ErrorCode.CRC, b""
    act = _INSTRUCTIONS.get(frame.instruction)
    return (ErrorCode.INSTRUCTION, b"") if act is None else act(frame, servo, now_ns)


def _ping(_frame: Frame, servo: EmulatedServo, _now_ns: int) -> _Done:
    return ErrorCode.NONE, servo.model.number.to_bytes(2, "little") + bytes([servo.firmware])


def _read(frame: Frame, servo: EmulatedServo, now_ns: int) -> _Done:
    address = int.from_bytes(frame.params[:2], "little")
    size = int.from_bytes(frame.params[2:4], "little")
    if len(frame.params) != 4 or not size:
        return ErrorCode.DATA_LENGTH, b""
    data = servo.read(address, size, now_ns)
    return (ErrorCode.ACCESS, b"") if data is None else (ErrorCode.NONE, data)


def _write(frame: Frame, servo: EmulatedServo, now_ns: int) -> _Done:
    params = frame.params
    if len(params) < 3:
        return ErrorCode.DATA_LENGTH, b""
    return servo.write(int.from_bytes(params[:2], "little"), params[2:], now_ns), b""


def _reboot(_frame: Frame, servo: EmulatedServo, now_ns: int) -> _Done:
    servo.reboot(now_ns)
    return ErrorCode.NONE, b""


_INSTRUCTIONS: Mapping[int, Callable[[Frame, EmulatedServo, int], _Done]] = MappingProxyType(
    {
        Instruction.PING: _ping,
        Instruction.READ: _read,
        Instruction.WRITE: _write,
        Instruction.REBOOT: _reboot,
    }
)


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
