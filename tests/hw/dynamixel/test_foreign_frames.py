"""Frames that others have published, through the parser and out of the emulated bus.

``tests/data/protocol2_frames.json`` names the source of each.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import NamedTuple

import pytest

from haptic_wall.hw.clock import SimulatedClock
from haptic_wall.hw.dynamixel.codec import Instruction, Parser, encode, encode_status
from haptic_wall.hw.dynamixel.tables import MODELS
from haptic_wall.hw.emulated.bus import EmulatedBus
from haptic_wall.hw.emulated.memory_line import MemoryLine
from haptic_wall.hw.emulated.servo import EmulatedServo
from haptic_wall.hw.truth import TrueServo

DATA = Path(__file__).parents[2] / "data" / "protocol2_frames.json"
FRAMES = [bytes.fromhex(one["hex"]) for one in json.loads(DATA.read_text())]
BAUD = 1_000_000


def frame_of(note: str) -> bytes:
    """The frame with this note."""
    (found,) = [one["hex"] for one in json.loads(DATA.read_text()) if one["note"] == note]
    return bytes.fromhex(found)


@pytest.mark.parametrize("wire", FRAMES, ids=bytes.hex)
def test_the_parser_reads_it_and_the_encoder_writes_the_same_bytes(wire: bytes) -> None:
    (frame,) = Parser().feed(wire)
    if frame.instruction == Instruction.STATUS:
        assert encode_status(frame.id, frame.error, frame.params) == wire
    else:
        assert encode(frame.id, frame.instruction, frame.params) == wire


@pytest.mark.parametrize("piece", [1, 2, 7, 1000])
def test_the_parser_finds_all_of_them_in_one_stream(piece: int) -> None:
    """Two were published glued together; between others there is what a line brings."""
    stream = b"\xff\xff".join(FRAMES) + b"".join(FRAMES)
    parser = Parser()
    found = [
        frame
        for start in range(0, len(stream), piece)
        for frame in parser.feed(stream[start : start + piece])
    ]
    once = [Parser().feed(wire)[0] for wire in FRAMES]
    assert found == once * 2


class Asked(NamedTuple):
    """A servo in the state of a published reply, and the request that has it say that."""

    note: str
    model: str
    id: int
    request: bytes
    firmware: int = 48
    counts: int = 0
    registers: tuple[tuple[str, int], ...] = ()


READ, SYNC, WRITE = Instruction.READ, Instruction.SYNC_READ, Instruction.WRITE
VELOCITY_AND_POSITION = bytes([128, 0, 8, 0])
ANSWERED = [
    Asked(
        "position 794 of id 2",
        "XM430-W350",
        2,
        encode(2, READ, bytes([132, 0, 4, 0])),
        counts=794,
    ),
    Asked("id 2", "XL330-M288", 2, encode(2, Instruction.PING), firmware=49),
    Asked(
        "drive mode 5",
        "XL330-M288",
        1,
        encode(1, READ, bytes([10, 0, 1, 0])),
        registers=(("drive_mode", 5),),
    ),
    *(
        Asked(
            f"id {id_}",
            "XM430-W350",
            id_,
            encode(254, SYNC, VELOCITY_AND_POSITION + bytes([id_])),
            counts=counts,
        )
        for id_, counts in ((1, 0x0FD9), (3, 0x04C2), (5, 0x0B71))
    ),
    Asked("access error", "XM430-W350", 1, encode(1, WRITE, bytes([132, 0, 0, 0, 0, 0]))),
    Asked(
        "CRC error (3), which its author took for Data Range",
        "XM430-W350",
        1,
        encode(1, READ, bytes([132, 0, 4, 0]))[:-2] + b"\x00\x00",
    ),
]


@pytest.mark.parametrize("asked", ANSWERED, ids=lambda asked: f"{asked.note} {asked.model}")
def test_an_emulated_servo_says_it_byte_for_byte(asked: Asked) -> None:
    line, servo = bus_of(asked.model, asked.id, asked.firmware, asked.counts)
    for name, value in asked.registers:
        servo.memory[name] = value
    assert reply(line, asked.request) == frame_of(asked.note)


def bus_of(model: str, id_: int, firmware: int, counts: int) -> tuple[MemoryLine, EmulatedServo]:
    clock = SimulatedClock(5_000_000)
    true = TrueServo(0.01, coulomb=0.1, position=counts * math.tau / 4096)
    servo = EmulatedServo(MODELS[model], id_, firmware, true, start_ns=clock.now_ns(), baud=BAUD)
    servo.memory["return_delay_time"] = 0
    bus = EmulatedBus([servo], baud=BAUD, start_ns=clock.now_ns())
    return MemoryLine(bus, clock), servo


def reply(line: MemoryLine, request: bytes) -> bytes:
    line.write(request)
    found = b""
    while line.wait(line.clock.now_ns() + 3_000_000):
        found += line.read()
    return found
