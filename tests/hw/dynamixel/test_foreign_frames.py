"""Frames that others have published, through the parser and out of the emulated bus.

``tests/data/protocol2_frames.json`` names the source of each.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import NamedTuple

import pytest

from haptic_wall.hw.dynamixel.codec import Instruction, Parser, encode, encode_status
from haptic_wall.hw.truth import TrueServo
from tests.hw.dynamixel.emulated_client import Client

DATA = Path(__file__).parents[2] / "data" / "protocol2_frames.json"
FRAMES = [bytes.fromhex(one["hex"]) for one in json.loads(DATA.read_text())]


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
    true = TrueServo(0.01, coulomb=0.1, position=asked.counts * math.tau / 4096)
    client = Client((asked.model, asked.id), true=true, firmware=asked.firmware)
    for name, value in asked.registers:
        client.servos[asked.id].memory[name] = value
    assert client.heard(asked.request) == frame_of(asked.note)
