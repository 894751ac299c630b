"""Instructions beyond read and write, as a client meets them on the wire.

Frames marked as published are those of the e-manual's examples.
"""

import math
from dataclasses import replace

import pytest

from haptic_wall.hw.dynamixel.codec import (
    BROADCAST,
    ErrorCode,
    Instruction,
)
from haptic_wall.hw.emulated.instructions import CLEAR_KEY
from haptic_wall.hw.truth import TrueServo
from tests.hw.dynamixel.emulated_client import FREE, MS, Client

ID, BAUD_RATE, RETURN_DELAY, HOMING, TEMPERATURE_LIMIT, MAX_VOLTAGE = 7, 8, 9, 20, 31, 32
TORQUE_ENABLE, LED, POSITION_P_GAIN, POSITION = 64, 65, 84, 132
X = "XM430-W350"


def words(*values: int) -> bytes:
    return b"".join(value.to_bytes(2, "little") for value in values)


def at(turns: float) -> TrueServo:
    """At rest so many turns from its zero."""
    return replace(FREE, position=turns * 2 * math.pi)


# Factory reset


def spoiled(firmware: int = 48) -> Client:
    client = Client((X, 9), firmware=firmware)
    assert client.write(9, HOMING, 77, 4) == 0
    assert client.write(9, POSITION_P_GAIN, 1, 2) == 0
    assert client.write(9, BAUD_RATE, 3, 1) == 0  # 1 Mbit/s
    client.bus.host_baud = 1_000_000
    return client


@pytest.mark.parametrize(
    ("option", "id_", "baud"), [(0xFF, 1, 57_600), (0x01, 9, 57_600), (0x02, 9, 1_000_000)]
)
def test_factory_reset_keeps_what_its_option_says(option: int, id_: int, baud: int) -> None:
    client = spoiled()
    reply = client.answer(9, Instruction.FACTORY_RESET, bytes([option]))
    assert (reply.id, reply.error) == (9, 0)  # answered before it takes effect
    client.bus.host_baud = baud
    client.send(id_, Instruction.PING)
    assert client.replies(within_ns=10 * MS) == []  # it reboots
    client.pass_time(500 * MS)
    client.send(id_, Instruction.READ, words(0, 148))
    (reply,) = client.replies(within_ns=50 * MS)
    assert reply.params[ID] == id_
    assert reply.params[RETURN_DELAY] == 250
    assert reply.params[HOMING : HOMING + 4] == bytes(4)
    assert reply.params[POSITION_P_GAIN : POSITION_P_GAIN + 2] == words(800)


def test_factory_reset_of_everything_is_refused_when_broadcast_since_firmware_42() -> None:
    for firmware, reset in ((41, True), (42, False)):
        client = spoiled(firmware=firmware)
        client.send(BROADCAST, Instruction.FACTORY_RESET, b"\xff")
        client.pass_time(500 * MS)
        assert client.replies() == []
        assert (client.servos[9].id == 1) == reset
        assert (client.servos[9].memory["homing_offset"] == 0) == reset


@pytest.mark.parametrize(
    ("instruction", "params", "error"),
    [
        (Instruction.FACTORY_RESET, b"", ErrorCode.DATA_LENGTH),
        (Instruction.FACTORY_RESET, b"\x03", ErrorCode.DATA_RANGE),
        (Instruction.CLEAR, b"\x01", ErrorCode.DATA_LENGTH),
        (Instruction.CLEAR, b"\x02" + CLEAR_KEY, ErrorCode.DATA_RANGE),
        (Instruction.CLEAR, b"\x01" + CLEAR_KEY[::-1], ErrorCode.DATA_RANGE),
        (Instruction.CONTROL_TABLE_BACKUP, b"\x01CTRL", ErrorCode.INSTRUCTION),
    ],
)
def test_without_its_option_and_its_key_nothing_is_done(
    instruction: Instruction, params: bytes, error: ErrorCode
) -> None:
    client = Client(true=at(3.25))
    assert client.answer(1, instruction, params).error == error
    assert client.read(1, POSITION, 4) > 3 * 4096


# Clear


def test_clear_brings_the_position_back_into_one_turn() -> None:
    for turns in (3.25, -2.75):
        client = Client(true=at(turns))
        assert client.read(1, POSITION, 4, signed=True) == turns * 4096
        client.line.write(
            bytes.fromhex("FF FF FD 00 01 08 00 10 01 44 58 4C 22 B1 DC")
        )  # published
        (reply,) = client.replies()
        assert (reply.id, reply.error) == (1, 0)
        assert client.read(1, POSITION, 4, signed=True) == 1024


# Bulk


def test_bulk_read_is_answered_by_each_in_the_order_asked() -> None:
    client = Client((X, 1), (X, 2))
    client.line.write(  # published: voltage of 1, temperature of 2
        bytes.fromhex("FF FF FD 00 FE 0D 00 92 01 90 00 02 00 02 92 00 01 00 1A 05")
    )
    replies = client.replies()
    assert [(r.id, r.error, r.params) for r in replies] == [
        (1, 0, words(120)),
        (2, 0, bytes([client.read(2, 146, 1)])),
    ]


def test_bulk_write_reaches_each_with_its_own_registers_and_is_not_answered() -> None:
    client = Client((X, 1), (X, 2))
    assert client.write(1, MAX_VOLTAGE, 150, 2) == 0
    assert client.write(2, TEMPERATURE_LIMIT, 70, 1) == 0
    client.line.write(  # published: maximum voltage of 1, temperature limit of 2
        bytes.fromhex("FF FF FD 00 FE 10 00 93 01 20 00 02 00 A0 00 02 1F 00 01 00 50 B7 68")
    )
    assert client.replies() == []
    assert client.read(1, MAX_VOLTAGE, 2) == 160
    assert client.read(2, TEMPERATURE_LIMIT, 1) == 80


# Two servos with one id


def leds(client: Client) -> list[int]:
    return [servo.memory["led"] for servo in client.servos.values()]


def test_different_answers_of_one_id_collide_and_both_obey() -> None:
    client = Client((X, 1), ("XL330-M288", 2))
    client.write(2, ID, 1, 1)
    client.send(1, Instruction.PING)
    assert client.replies() == []  # bytes came, but no frame
    client.send(1, Instruction.WRITE, words(LED) + b"\x01")
    client.replies()
    assert leds(client) == [1, 1]
    client.write(1, LED, 0, 1)  # the same answer of both comes through
    assert leds(client) == [0, 0]


# What a host may send that is not as it should be


# Others


def test_a_registered_write_is_checked_again_when_it_is_carried_out() -> None:
    client = Client()
    assert client.answer(1, Instruction.REG_WRITE, words(HOMING) + bytes([1, 0, 0, 0])).error == 0
    client.write(1, TORQUE_ENABLE, 1, 1)
    assert client.answer(1, Instruction.ACTION).error == ErrorCode.ACCESS
    assert client.read(1, HOMING, 4) == 0
