"""What the servos on a bus do with an instruction, and what each of them answers.

Bulk reads and writes, clear, factory reset and the control table backup are not emulated: they
are answered "instruction error".
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from hw.dynamixel.codec import (
    BROADCAST,
    ErrorCode,
    FastReply,
    Frame,
    Instruction,
    encode_fast_status,
    encode_status,
)
from hw.dynamixel.emulated.servo import EmulatedServo


class Answer(NamedTuple):
    """A reply that is owed."""

    delay_ns: int
    """From the end of what came before on the wire to its first byte [ns]"""
    frame: Frame
    wire: bytes
    """The frame's bytes, or as many of them as are sent"""


def addressed(frame: Frame) -> list[int] | None:
    """The ids an instruction is for; None: all of them."""
    if frame.id != BROADCAST:
        return [frame.id]
    if frame.instruction in (Instruction.SYNC_READ, Instruction.FAST_SYNC_READ):
        return list(frame.params[4:])
    if frame.instruction == Instruction.SYNC_WRITE:
        return [id_ for id_, _ in _sync_writes(frame.params)]
    return None


def answer(frame: Frame, servos: Sequence[EmulatedServo], now_ns: int) -> list[Answer]:
    """Carry out ``frame``, which has fully arrived at ``now_ns`` [ns].

    Returns:
        The replies, in the order they take on the wire.
    """
    if frame.instruction == Instruction.STATUS:
        return []
    up = [servo for servo in servos if now_ns >= servo.answers_from_ns]
    ids = addressed(frame)
    by_id = {servo.id: servo for servo in reversed(up)}
    if frame.error != ErrorCode.CRC:
        for servo in up if ids is None else (by_id[i] for i in ids if i in by_id):
            servo.heard(now_ns)
    if frame.id == BROADCAST:
        return _broadcast(frame, up, by_id, now_ns)
    return _direct(frame, by_id[frame.id], now_ns) if frame.id in by_id else []


def _direct(frame: Frame, servo: EmulatedServo, now_ns: int) -> list[Answer]:
    """An instruction for one servo; Status Return Level decides whether it answers.

    The reply is the servo's as it was before: a write may change its id, its delay or the level.
    """
    level = servo.memory["status_return_level"]
    delay_ns, id_ = servo.return_delay_ns, servo.id
    error, params = _carry_out(frame, servo, now_ns)
    ping, read = frame.instruction == Instruction.PING, frame.instruction == Instruction.READ
    if ping or level == 2 or (read and level == 1):
        return [_status(servo, id_, error, params, delay_ns)]
    return []


def _broadcast(
    frame: Frame, servos: list[EmulatedServo], by_id: dict[int, EmulatedServo], now_ns: int
) -> list[Answer]:
    """An instruction for all: answered for ping, sync read and fast sync read alone.

    Servos answer a ping in the order of their ids, a sync read in the order asked for, each as
    soon as the one before it is through. One that is missing is passed over at once.
    """
    instruction = frame.instruction
    if frame.error == ErrorCode.CRC:
        return []
    if instruction == Instruction.PING:
        return [
            _status(servo, servo.id, *_carry_out(frame, servo, now_ns), servo.return_delay_ns)
            for servo in sorted(servos, key=lambda servo: servo.id)
        ]
    if instruction == Instruction.SYNC_READ:
        read = frame._replace(instruction=Instruction.READ, params=frame.params[:4])
        return [
            _status(by_id[i], i, *_carry_out(read, by_id[i], now_ns), by_id[i].return_delay_ns)
            for i in frame.params[4:]
            if i in by_id and by_id[i].memory["status_return_level"]
        ]
    if instruction == Instruction.FAST_SYNC_READ:
        return _fast_sync_read(frame.params, by_id, now_ns)
    if instruction == Instruction.SYNC_WRITE:
        for id_, write in _sync_writes(frame.params):
            if id_ in by_id:
                single = frame._replace(instruction=Instruction.WRITE, params=write)
                _carry_out(single, by_id[id_], now_ns)
    elif instruction != Instruction.READ:
        for servo in servos:
            _carry_out(frame, servo, now_ns)
    return []


def _fast_sync_read(params: bytes, by_id: dict[int, EmulatedServo], now_ns: int) -> list[Answer]:
    """One frame to which every servo appends its share.

    A servo that is missing, silenced, or whose firmware is too old leaves the frame cut short in
    front of its share: nobody behind it can go on.
    """
    address, size = _address_and_size(params)
    shares: list[FastReply] = []
    sent = 0
    first: EmulatedServo | None = None
    for id_ in params[4:]:
        servo = by_id.get(id_)
        if (
            servo is None
            or not servo.knows_fast_sync_read
            or not servo.memory["status_return_level"]
        ):
            shares.append(FastReply(id_, 0, bytes(size)))
            continue
        if len(shares) == sent:
            sent += 1
        first = first or servo
        data = servo.read(address, size, now_ns) if size else None
        error = ErrorCode.ACCESS if data is None else ErrorCode.NONE
        shares.append(FastReply(id_, error | servo.alert, bytes(size) if data is None else data))
    if first is None or not sent:
        return []
    try:
        wire = encode_fast_status(shares)
    except ValueError:
        return []
    wire = wire[: 8 + sent * (size + 4)]
    frame = Frame(BROADCAST, Instruction.STATUS, wire[8], wire[9:-2])
    return [Answer(first.return_delay_ns, frame, wire)]


def _carry_out(frame: Frame, servo: EmulatedServo, now_ns: int) -> tuple[int, bytes]:
    """What one servo does: its error code, and what it has to say."""
    instruction, params = frame.instruction, frame.params
    if frame.error == ErrorCode.CRC:
        return ErrorCode.CRC, b""
    if instruction == Instruction.PING:
        return ErrorCode.NONE, servo.model.number.to_bytes(2, "little") + bytes([servo.firmware])
    if instruction == Instruction.READ:
        address, size = _address_and_size(params)
        if len(params) != 4 or not size:
            return ErrorCode.DATA_LENGTH, b""
        data = servo.read(address, size, now_ns)
        return (ErrorCode.ACCESS, b"") if data is None else (ErrorCode.NONE, data)
    if instruction in (Instruction.WRITE, Instruction.REG_WRITE):
        if len(params) < 3:
            return ErrorCode.DATA_LENGTH, b""
        address, data = int.from_bytes(params[:2], "little"), params[2:]
        if instruction == Instruction.REG_WRITE:
            return servo.register(address, data), b""
        return servo.write(address, data, now_ns), b""
    if instruction == Instruction.ACTION:
        return servo.act(now_ns), b""
    if instruction == Instruction.REBOOT:
        servo.reboot(now_ns)
        return ErrorCode.NONE, b""
    return ErrorCode.INSTRUCTION, b""


def _status(
    servo: EmulatedServo,
    id: int,  # noqa: A002
    error: int,
    params: bytes,
    delay_ns: int,
) -> Answer:
    error |= servo.alert
    frame = Frame(id, Instruction.STATUS, error, params)
    return Answer(delay_ns, frame, encode_status(id, error, params))


def _address_and_size(params: bytes) -> tuple[int, int]:
    return int.from_bytes(params[:2], "little"), int.from_bytes(params[2:4], "little")


def _sync_writes(params: bytes) -> list[tuple[int, bytes]]:
    """Id and write parameters for each servo of a sync write; none where they do not add up."""
    block = int.from_bytes(params[2:4], "little") + 1
    data = params[4:]
    if block == 1 or len(data) % block:
        return []
    return [(data[at], params[:2] + data[at + 1 : at + block]) for at in range(0, len(data), block)]
