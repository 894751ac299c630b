"""Invariants under any bytes: of the parser, and of the bus from the first byte on.

``run`` takes any bytes as a programme, so that a fuzzer that knows nothing of frames finds its way
past their checksums: good frames, damaged ones, noise and pauses, cut anywhere.
"""

from __future__ import annotations

import math
import struct

from haptic_wall.hw.dynamixel.codec import (
    BROADCAST,
    MAX_LENGTH,
    Frame,
    Instruction,
    Parser,
    crc16,
    encode,
)
from haptic_wall.hw.dynamixel.tables import MODELS
from haptic_wall.hw.emulated.adapter import Adapter
from haptic_wall.hw.emulated.bus import GAP_NS, EmulatedBus
from haptic_wall.hw.emulated.servo import EmulatedServo
from haptic_wall.hw.truth import TrueServo

MS = 1_000_000
BAUD = 4_000_000
MODELS_ON_THE_BUS = ("XM430-W350", "XL330-M288", "XL430-W250")
INSTRUCTIONS = tuple(Instruction)
PING = encode(1, Instruction.PING)
JOINT_REPLY = struct.pack("<4sB", b"\xff\xff\xfd\x00", BROADCAST)
TRUE = TrueServo(inertia=0.012, damping=0.012, coulomb=0.02, torque_limit=4.0)
MAX_STEPS = 64
REBOOTED_NS = 1_000 * MS
SETTLED_NS = 100 * MS
HUGE = 1_000_000


_CONVERSATION = (
    "fe 01",
    "01 02 8400 0400",
    "01 03 4000 00",
    "01 03 0b00 03",
    "01 03 4000 01",
    "01 03 7400 00080000",
    "01 04 4100 01",
    "fe 05",
    "fe 82 8400 0400 010203",
    "fe 8a 7e00 0a00 010203",
    "fe 83 6600 0200 010a00 020b00",
    "fe 92 01 8400 0400 02 9000 0200",
    "fe 9a 02 8400 0400 01 9000 0200",
    "fe 93 01 4100 0100 01 02 6600 0200 0500",
    "01 03 a800 8400 8500",
    "01 02 e000 0200",
    "01 03 6200 01",
    "01 10 01 44584c22",
    "01 20 01 43545234",
    "01 06 02",
    "01 08",
    "02 03 0800 03",
    "02 03 0700 09",
    "02 03 4400 00",
    "02 03 0c00 01",
    "02 03 4400 02",
    "03 03 6800 ffff fdff ffff",
)
"""Id, instruction and parameters: set-up, motion, lists, indirect addresses, keys, resets"""


class Reader:
    """Takes numbers and bytes off the front of the input; zeros when there are none left."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = 0

    def __bool__(self) -> bool:
        return self._at < len(self._data)

    def take(self, count: int) -> bytes:
        taken = self._data[self._at : self._at + count]
        self._at += count
        return taken

    def byte(self) -> int:
        return (self.take(1) or b"\0")[0]


def run(data: bytes) -> None:
    """One input, for the parser or for the bus.

    Raises:
        AssertionError: What must hold does not.
    """
    reader = Reader(data)
    (check_parser if reader.byte() & 1 else check_bus)(reader)


def seeds() -> list[bytes]:
    """Inputs to begin with: a conversation with the servos, whole and by frames, for both."""
    frames = [_spelled(bytes.fromhex(text)) for text in _CONVERSATION]
    return [
        bytes((which, kind)) + conversation
        for which in (0, 1)
        for kind in (0x10, 0x13)
        for conversation in [*frames, b"".join(frames)]
    ]


def _spelled(frame: bytes) -> bytes:
    """The step that sends a frame, 40 ms after what came before, as ``steps`` reads it."""
    id_, instruction, *params = frame
    place = 3 if id_ == BROADCAST else id_ - 1
    code = INSTRUCTIONS.index(Instruction(instruction))
    return bytes((0xC1, 0, place, code, len(params), *params))


def steps(reader: Reader) -> list[tuple[bytes, int]]:
    """Bytes to send, each with the pause before them [ns]."""
    found: list[tuple[bytes, int]] = []
    while reader and len(found) < MAX_STEPS:
        kind = reader.byte()
        pause_ns = (0, 20_000, GAP_NS + 1, 40 * MS)[kind >> 6]
        piece = (_noise, _frame, _damaged, _unstuffed)[kind & 3](reader)
        cut = reader.byte() if kind & 4 else len(piece)
        found += [(piece[:cut], pause_ns), (piece[cut:], 0)]
    return [(piece, pause_ns) for piece, pause_ns in found if piece]


def _noise(reader: Reader) -> bytes:
    return reader.take(reader.byte())


def _frame(reader: Reader) -> bytes:
    """A good one; most are for servos that are there, and of an instruction that exists."""
    other, place = reader.byte(), reader.byte()
    id_ = (1, 2, 3, BROADCAST, other % 253)[place % 5]
    code = reader.byte()
    instruction = INSTRUCTIONS[code % len(INSTRUCTIONS)] if code < 0xF0 else reader.byte()
    return encode(id_, instruction, reader.take(reader.byte() % 64))


def _damaged(reader: Reader) -> bytes:
    frame = bytearray(_frame(reader))
    frame[reader.byte() % len(frame)] ^= reader.byte() or 1
    return bytes(frame[: reader.byte() or len(frame)])


def _unstuffed(reader: Reader) -> bytes:
    """As a host sends it that does not stuff: the length and the checksum are right."""
    id_, instruction, params = reader.byte(), reader.byte(), reader.take(reader.byte())
    frame = b"\xff\xff\xfd\x00" + struct.pack("<BHB", id_, len(params) + 3, instruction) + params
    return frame + crc16(frame).to_bytes(2, "little")


def check_parser(reader: Reader) -> None:
    """Nothing is raised, nothing piles up, and it is back in step at the next good frame."""
    kind = reader.byte()
    parser = Parser(report_crc=bool(kind & 1), unstuffed=bool(kind & 2))
    heard = b""
    for piece, pause_ns in steps(reader):
        if pause_ns > GAP_NS:
            parser.reset()
            heard = b""
        heard += piece
        for frame in parser.feed(piece):
            assert 0 <= frame.id <= BROADCAST
            assert 0 <= frame.instruction <= 0xFF
            assert 0 <= frame.error <= 0xFF
            assert len(frame.params) <= MAX_LENGTH
    good = Frame(1, Instruction.PING, 0, b"")
    # A frame made of noise may by chance have the right checksum with a part of the good one in it,
    # which costs that. What looks like a joint reply may hold headers, and is waited for.
    copies = 2 if kind & 2 or JOINT_REPLY not in heard else 2 + MAX_LENGTH // len(PING)
    assert any(good in parser.feed(PING) for _ in range(copies)), "not back in step"
    parser.feed(b"\xff\xff\xfd\x00\x01")
    parser.reset()
    assert parser.feed(PING) == [good], "not back in step after a silence"
    assert parser.idle


def check_bus(reader: Reader) -> None:
    """Nothing is raised or runs on for ever; after a silence every servo answers a ping."""
    kind = reader.byte()
    servos = [
        EmulatedServo(MODELS[model], i, 48, TRUE, start_ns=0, baud=BAUD)
        for i, model in enumerate(MODELS_ON_THE_BUS[: 1 + (kind >> 3) % 3], 1)
    ]
    adapter = Adapter((kind >> 1 & 3) * MS, 62, 0) if kind & 6 else None
    bus = EmulatedBus(servos, baud=BAUD, start_ns=0, adapter=adapter)
    now_ns = MS
    for piece, pause_ns in steps(reader):
        now_ns += pause_ns
        bus.receive(piece, now_ns)
        assert len(bus.transmit(now_ns)) < HUGE
    now_ns += REBOOTED_NS
    bus.transmit(now_ns)
    assert not bus.full
    by_id = {servo.id: servo for servo in servos}
    if len(by_id) < len(servos):
        return  # they were given one id, and answer at once
    for servo in servos:
        bus.host_baud = servo.baud
        bus.receive(encode(servo.id, Instruction.PING), now_ns)
        now_ns += SETTLED_NS
        reply = Parser().feed(bus.transmit(now_ns))
        assert [(frame.id, frame.instruction) for frame in reply] == [
            (servo.id, Instruction.STATUS)
        ], f"servo {servo.id} does not answer: {reply}"
        state = servo.state(now_ns)
        assert all(map(math.isfinite, state)), f"not a number: {state}"
