"""Executes an instruction on one servo: returns its error code and the parameters of its reply.

Source: ROBOTIS e-Manual, "DYNAMIXEL Protocol 2.0", instruction details.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

from haptic_wall.hw.dynamixel.codec import BROADCAST, ErrorCode, Frame, Instruction
from haptic_wall.hw.emulated.servo import EmulatedServo

CLEAR_KEY = b"\x44\x58\x4c\x22"
BACKUP_KEY = b"\x43\x54\x52\x4c"
_CLEAR_POSITION, _STORE, _RESTORE = 1, 1, 2
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


def carry_out_as_secondary(frame: Frame, servo: EmulatedServo, now_ns: int) -> None:
    """Execute ``frame`` for the servo's Secondary ID, which reaches RAM alone.

    Only writes, reg writes and actions are executed. The manual does not describe the other
    instructions: they are useless without a reply, or affect more than a group should.
    """
    if frame.instruction == Instruction.ACTION:
        servo.act(now_ns)
    elif frame.instruction in (Instruction.WRITE, Instruction.REG_WRITE):
        _write(frame, servo, now_ns, ram_only=True)


def _ping(_frame: Frame, servo: EmulatedServo, _now_ns: int) -> _Done:
    return ErrorCode.NONE, servo.model.number.to_bytes(2, "little") + bytes([servo.firmware])


def _read(frame: Frame, servo: EmulatedServo, now_ns: int) -> _Done:
    address = int.from_bytes(frame.params[:2], "little")
    size = int.from_bytes(frame.params[2:4], "little")
    if len(frame.params) != 4 or not size:
        return ErrorCode.DATA_LENGTH, b""
    data = servo.read(address, size, now_ns)
    return (ErrorCode.ACCESS, b"") if data is None else (ErrorCode.NONE, data)


def _write(frame: Frame, servo: EmulatedServo, now_ns: int, *, ram_only: bool = False) -> _Done:
    params = frame.params
    if len(params) < 3:
        return ErrorCode.DATA_LENGTH, b""
    address, data = int.from_bytes(params[:2], "little"), params[2:]
    if frame.instruction == Instruction.REG_WRITE:
        return servo.register(address, data, ram_only=ram_only), b""
    return servo.write(address, data, now_ns, ram_only=ram_only), b""


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
    option, error = _keyed(frame.params, CLEAR_KEY, (_CLEAR_POSITION,))
    return (error, b"") if option is None else (servo.clear_turns(now_ns), b"")


def _backup(frame: Frame, servo: EmulatedServo, now_ns: int) -> _Done:
    if "backup_ready" not in servo.memory:
        return ErrorCode.INSTRUCTION, b""
    option, error = _keyed(frame.params, BACKUP_KEY, (_STORE, _RESTORE))
    if option is None:
        return error, b""
    if option == _STORE:
        return servo.table.backup.store(), b""
    return servo.restore_backup(now_ns), b""


def _keyed(params: bytes, key: bytes, options: tuple[int, ...]) -> tuple[int | None, ErrorCode]:
    """Return the option, if it is valid and the key behind it is correct.

    Open in the manual: the reply to a wrong option or key is "data range".
    """
    if len(params) != 1 + len(key):
        return None, ErrorCode.DATA_LENGTH
    if params[0] not in options or params[1:] != key:
        return None, ErrorCode.DATA_RANGE
    return params[0], ErrorCode.NONE


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
        Instruction.CONTROL_TABLE_BACKUP: _backup,
    }
)
