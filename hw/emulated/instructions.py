"""Executes an instruction on one servo: returns its error code and the parameters of its reply.

Source: ROBOTIS e-Manual, "DYNAMIXEL Protocol 2.0", instruction details.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import NamedTuple

from haptic_wall.hw.dynamixel.codec import BROADCAST, ErrorCode, Frame, Instruction
from haptic_wall.hw.emulated.servo import EmulatedServo

CLEAR_KEY = b"\x44\x58\x4c\x22"
_CLEAR_POSITION = 1
_RESET_ALL = 0xFF
_CLEAR_FIRMWARE = 42
"""First firmware with clear, and with protection of the ids in a broadcast reset; every X330 has
both"""

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
    address, data = int.from_bytes(params[:2], "little"), params[2:]
    if frame.instruction == Instruction.REG_WRITE:
        return servo.register(address, data), b""
    return servo.write(address, data, now_ns), b""


def _action(_frame: Frame, servo: EmulatedServo, now_ns: int) -> _Done:
    return servo.act(now_ns), b""


def _factory_reset(frame: Frame, servo: EmulatedServo, now_ns: int) -> _Done:
    if len(frame.params) != 1:
        return ErrorCode.DATA_LENGTH, b""
    option = frame.params[0]
    if frame.id == BROADCAST and option == _RESET_ALL and _knows_clear(servo):
        return ErrorCode.RESULT_FAIL, b""  # all servos would have the same id afterwards
    return servo.reset(option, now_ns), b""


def _reboot(_frame: Frame, servo: EmulatedServo, now_ns: int) -> _Done:
    servo.reboot(now_ns)
    return ErrorCode.NONE, b""


def _clear(frame: Frame, servo: EmulatedServo, now_ns: int) -> _Done:
    if not _knows_clear(servo):
        return ErrorCode.INSTRUCTION, b""
    # Open in the manual: the reply to a wrong option or key is "data range".
    if len(frame.params) != 1 + len(CLEAR_KEY):
        return ErrorCode.DATA_LENGTH, b""
    if frame.params != bytes([_CLEAR_POSITION]) + CLEAR_KEY:
        return ErrorCode.DATA_RANGE, b""
    return servo.clear_turns(now_ns), b""


def _knows_clear(servo: EmulatedServo) -> bool:
    return servo.firmware >= _CLEAR_FIRMWARE or servo.model.family == "X330"


_INSTRUCTIONS: Mapping[int, Callable[[Frame, EmulatedServo, int], _Done]] = MappingProxyType(
    {
        Instruction.PING: _ping,
        Instruction.READ: _read,
        Instruction.WRITE: _write,
        Instruction.REG_WRITE: _write,
        Instruction.ACTION: _action,
        Instruction.FACTORY_RESET: _factory_reset,
        Instruction.REBOOT: _reboot,
        Instruction.CLEAR: _clear,
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
