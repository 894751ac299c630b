"""Decides which servos execute an instruction, and which of them reply, when and with what."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise

from haptic_wall.hw.dynamixel.codec import (
    BROADCAST,
    ErrorCode,
    FastReply,
    Frame,
    Instruction,
    encode_fast_status,
    encode_status,
)
from haptic_wall.hw.emulated.collision import collide, pull_low
from haptic_wall.hw.emulated.instructions import (
    READS,
    Entry,
    carry_out,
    entries,
)
from haptic_wall.hw.emulated.servo import EmulatedServo
from haptic_wall.hw.emulated.traffic import Answer, Part

SLOT_NS = 3_000_000
"""Time for a missing id in a ping for all [ns]"""
_AHEAD = 8
"""Bytes of a joint reply before its parts"""
_FAST = (Instruction.FAST_SYNC_READ, Instruction.FAST_BULK_READ)
_ById = Mapping[int, Sequence[EmulatedServo]]


def addressed(frame: Frame) -> list[int] | None:
    """Return the ids an instruction is for; None: all of them."""
    if frame.id != BROADCAST:
        return [frame.id]
    if frame.instruction in READS or frame.instruction == Instruction.SYNC_WRITE:
        return [entry.id for entry in entries(frame)]
    return None


def answer(frame: Frame, servos: Sequence[EmulatedServo], now_ns: int) -> list[Answer]:
    """Execute ``frame``, which has fully arrived at ``now_ns`` [ns].

    Returns:
        The replies, in their order on the wire.
    """
    if frame.instruction == Instruction.STATUS:
        return []
    up = [servo for servo in servos if now_ns >= servo.answers_from_ns]
    by_id: dict[int, list[EmulatedServo]] = {}
    for servo in up:
        by_id.setdefault(servo.id, []).append(servo)
    if frame.id == BROADCAST:
        return _broadcast(frame, up, by_id, now_ns)
    return _direct(frame, by_id.get(frame.id, ()), now_ns)


def _direct(frame: Frame, servos: Sequence[EmulatedServo], now_ns: int) -> list[Answer]:
    """Execute an instruction for one id; Status Return Level decides whether its servo replies.

    The reply uses the servo's settings before the instruction: a write may change its id, delay or
    level.
    """
    replies = []
    for servo in servos:
        if frame.error != ErrorCode.CRC:
            servo.heard(now_ns)
        level = servo.memory["status_return_level"]
        delay_ns, baud = servo.return_delay_ns, servo.baud
        error, params = carry_out(frame, servo, now_ns)
        ping, read = frame.instruction == Instruction.PING, frame.instruction == Instruction.READ
        if ping or level == 2 or (read and level == 1):
            replies.append(_status(servo, frame.id, error, params, delay_ns))
    return collide(replies, baud) if len(replies) > 1 else replies


def _broadcast(
    frame: Frame, servos: Sequence[EmulatedServo], by_id: _ById, now_ns: int
) -> list[Answer]:
    """Execute an instruction for all or for a list: only pings and lists of reads have replies.

    Servos reply to a ping in the order of their ids, to a list in its own order, each as soon as
    the one before has finished. A missing servo is skipped at once.
    """
    if frame.error == ErrorCode.CRC:
        return []
    if frame.instruction in READS or frame.instruction == Instruction.SYNC_WRITE:
        listed = entries(frame)
        for servo in (servo for entry in listed for servo in by_id.get(entry.id, ())):
            servo.heard(now_ns)
        if frame.instruction in _FAST:
            return _fast_read(listed, by_id, now_ns)
        return _listed(frame, listed, by_id, now_ns)
    for servo in servos:
        servo.heard(now_ns)
    if frame.instruction == Instruction.PING:
        answers, expected = [], 0
        for id_ in sorted(by_id):
            missing_ns, expected = (id_ - expected) * SLOT_NS, id_ + 1
            for reply in _direct(frame._replace(id=id_), by_id[id_], now_ns):
                answers.append(reply._replace(delay_ns=reply.delay_ns + missing_ns))
                missing_ns = 0
        return answers
    if frame.instruction != Instruction.READ:
        for servo in servos:
            carry_out(frame, servo, now_ns)
    return []


def _listed(frame: Frame, listed: Iterable[Entry], by_id: _ById, now_ns: int) -> list[Answer]:
    """Execute each listed servo's part; reads have replies except at Status Return Level 0."""
    reads = frame.instruction in READS
    single = Instruction.READ if reads else Instruction.WRITE
    answers = []
    for entry in listed:
        part = Frame(entry.id, single, 0, entry.params)
        replies = []
        for servo in by_id.get(entry.id, ()):
            error, params = carry_out(part, servo, now_ns)
            if reads and servo.memory["status_return_level"]:
                replies.append(_status(servo, entry.id, error, params, servo.return_delay_ns))
        answers += collide(replies, servo.baud) if len(replies) > 1 else replies
    return answers


def _fast_read(listed: Sequence[Entry], by_id: _ById, now_ns: int) -> list[Answer]:
    """Return one frame to which every servo appends its part.

    A servo that is missing, silenced, or whose firmware is too old truncates the frame before its
    part:
    no servo behind it can continue. The length in the frame's header counts all.
    """
    shares: list[FastReply] = []
    ends = [_AHEAD]
    first: EmulatedServo | None = None
    for entry in listed:
        size = entry.size
        servos = [
            servo
            for servo in by_id.get(entry.id, ())
            if servo.model.knows_fast_reads(servo.firmware) and servo.memory["status_return_level"]
        ]
        if servos and len(shares) == len(ends) - 1:
            first = first or servos[0]
            ends.append(ends[-1] + size + 4)
            shares.append(_share(entry, servos, now_ns))
        else:
            shares.append(FastReply(entry.id, 0, bytes(size)))
    if first is None:
        return []
    try:
        wire = encode_fast_status(shares)[: ends[-1]]
    except ValueError:
        return []
    frame = Frame(BROADCAST, Instruction.STATUS, wire[_AHEAD], wire[_AHEAD + 1 : -2])
    parts = [Part(BROADCAST, wire[:_AHEAD])]
    for share, (begin, end) in zip(shares, pairwise(ends), strict=False):
        parts.append(Part(share.id, wire[begin:end]))
    return [Answer(first.return_delay_ns, frame, parts)]


def _share(entry: Entry, servos: Sequence[EmulatedServo], now_ns: int) -> FastReply:
    """Return the part appended for one id; several servos with it pull each other's bits low."""
    address, size = int.from_bytes(entry.params[:2], "little"), entry.size
    shares = []
    for servo in servos:
        data = servo.read(address, size, now_ns) if size else None
        error = (ErrorCode.ACCESS if data is None else ErrorCode.NONE) | servo.alert
        shares.append(bytes([error]) + (bytes(size) if data is None else data))
    share = shares[0] if len(shares) == 1 else pull_low(shares)
    return FastReply(entry.id, share[0], share[1:])


def _status(servo: EmulatedServo, id_: int, error: int, params: bytes, delay_ns: int) -> Answer:
    error |= servo.alert
    frame = Frame(id_, Instruction.STATUS, error, params)
    return Answer(delay_ns, frame, [Part(id_, encode_status(id_, error, params))])
