"""The wire: when things happen, who answers, in what order, and what garbage does."""

import math
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_wall.hw.dynamixel.codec import (
    BROADCAST,
    Instruction,
    Parser,
    crc16,
    encode,
)
from tests.hw.dynamixel.emulated_client import BYTE_NS, FREE, MS, TORQUE_UNIT, Client

X = "XM430-W350"
PING = encode(1, Instruction.PING)
READ_POSITION = bytes([132, 0, 4, 0])


def times_of(client: Client, event: str) -> list[float]:
    return [float(row[0]) for row in client.rows() if row[1] == event]


def test_position_is_sampled_when_the_last_byte_of_the_request_has_travelled() -> None:
    client = Client()
    client.enable_current_mode()
    client.write(1, 102, 1000, 2)
    begun = client.clock.now_ns() - 11 * BYTE_NS  # when the write took effect
    client.pass_time(30 * MS)
    sampled = client.clock.now_ns() + 14 * BYTE_NS
    counts = client.read(1, 132, 4, signed=True)
    t = (sampled - begun) * 1e-9
    position = FREE.position + 0.5 * 1000 * TORQUE_UNIT / FREE.inertia * t * t
    assert counts == round(position * 4096 / (2 * math.pi))


def test_ping_for_all_is_answered_in_the_order_of_ids_with_a_slot_for_each_missing_one() -> None:
    client = Client((X, 7), (X, 2), ("XL330-M288", 5))
    start = client.clock.now_ns()
    client.send(BROADCAST, Instruction.PING)
    replies = client.replies(within_ns=10 * MS)
    missing = [2, 4, 5]  # ids 0, 1; 3, 4; 6
    due = [start + (10 + 14 * (n + 1)) * BYTE_NS + 3 * MS * missing[n] for n in range(3)]
    assert times_of(client, "tx")[-3:] == pytest.approx([t * 1e-9 for t in due], abs=1e-9)
    assert [r.id for r in replies] == [2, 5, 7]
    assert [int.from_bytes(r.params[:2], "little") for r in replies] == [1020, 1200, 1020]


def test_sync_read_answers_in_the_order_asked_and_passes_over_the_missing() -> None:
    client = Client((X, 1), (X, 2), (X, 3))
    client.send(BROADCAST, Instruction.SYNC_READ, READ_POSITION + bytes([3, 9, 1]))
    replies = client.replies()
    assert [r.id for r in replies] == [3, 1]
    assert all(len(r.params) == 4 for r in replies)


def test_a_sync_write_reaches_each_with_its_own_value_and_a_refused_one_fails_alone() -> None:
    client = Client((X, 1), (X, 2))
    for i in (1, 2):
        client.enable_current_mode(i)
    client.sync_write(102, 2, {1: 2000, 2: -60})
    assert client.replies() == []
    assert client.torque(1) == 0.0
    assert client.torque(2) == pytest.approx(-60 * TORQUE_UNIT)


@pytest.mark.parametrize(("ids", "whole"), [((1, 9, 2), 1), ((1, 2, 9), 2), ((9, 1, 2), 0)])
def test_fast_sync_read_breaks_off_at_a_missing_servo(
    ids: tuple[int, int, int], whole: int
) -> None:
    client = Client((X, 1), (X, 2))
    client.send(BROADCAST, Instruction.FAST_SYNC_READ, READ_POSITION + bytes(ids))
    client.line.wait(client.clock.now_ns() + MS)
    wire = client.line.read()
    assert len(wire) == (8 + 8 * whole if whole else 0)
    assert [frame.id for frame in Parser(joint=3).feed(wire)] == list(ids[:whole])


def test_different_answers_of_one_id_collide_and_both_obey() -> None:
    client = Client((X, 1), ("XL330-M288", 2))
    client.write(2, 7, 1, 1)
    client.send(1, Instruction.PING)
    assert client.replies() == []  # bytes came, but no frame
    client.send(1, Instruction.WRITE, bytes([65, 0, 1]))
    client.replies()
    assert [servo.memory["led"] for servo in client.servos.values()] == [1, 1]
    client.write(1, 65, 0, 1)  # the same answer of both comes through
    assert [servo.memory["led"] for servo in client.servos.values()] == [0, 0]


def test_only_servos_at_the_hosts_speed_hear_it() -> None:
    client = Client((X, 1), (X, 2))
    assert client.write(2, 8, 3, 1) == 0  # 1 Mbit/s; answered at the old speed
    assert client.ask(2, Instruction.PING) is None
    assert client.ask(1, Instruction.PING) is not None
    client.bus.host_baud = 1_000_000
    start = client.clock.now_ns()
    assert client.ask(1, Instruction.PING) is None
    start = client.clock.now_ns()
    assert client.ask(2, Instruction.PING) is not None
    assert client.clock.now_ns() - start == 24 * 10_000


def test_a_gap_in_a_frame_makes_servos_look_for_a_new_header() -> None:
    for gap, answered in ((1.4 * MS, True), (1.6 * MS, False)):
        client = Client()
        client.line.write(PING[:5])
        client.pass_time(5 * BYTE_NS + int(gap))
        client.line.write(PING[5:])
        assert bool(client.replies()) == answered


@settings(max_examples=30)
@given(st.lists(st.tuples(st.integers(0, 160), st.binary(min_size=1, max_size=8)), max_size=30))
def test_any_writes_leave_every_register_in_its_range(writes: list[tuple[int, bytes]]) -> None:
    client = Client(fast=False)
    servo = client.servos[1]
    for address, data in writes:
        client.send(servo.id, Instruction.WRITE, address.to_bytes(2, "little") + data)
        client.pass_time(MS)
    for register in servo.memory.registers.values():
        value = servo.memory[register.name]
        tripped = register.name == "bus_watchdog" and value == 255
        assert tripped or register.minimum <= value <= register.maximum, register


def shouted(chance: random.Random) -> bytes:
    """A frame of any instruction to anybody, whole, damaged or unstuffed, or noise."""
    id_ = chance.choice([1, 2, BROADCAST, chance.randrange(253)])
    params = chance.choice([b"", bytes([64, 0, 1]), READ_POSITION, b"\xff\xff\xfd\x00"])
    params += chance.randbytes(chance.choice([0, 0, 1, 4, 30]))
    frame = bytearray(encode(id_, chance.choice(list(Instruction)), params))
    match chance.randrange(6):
        case 0:
            frame[chance.randrange(len(frame))] ^= 1 << chance.randrange(8)
        case 1:
            del frame[chance.randrange(len(frame)) :]
        case 2:
            return chance.randbytes(chance.randrange(1, 200))
        case 3:
            body = bytes([id_, len(params) + 3, 0, chance.choice(list(Instruction))]) + params
            raw = b"\xff\xff\xfd\x00" + body
            return raw + crc16(raw).to_bytes(2, "little")
    return bytes(frame)


def test_whatever_is_shouted_every_servo_answers_after_a_silence(thorough: bool) -> None:
    for seed in range(2000 if thorough else 60):
        chance = random.Random(seed)
        client = Client((X, 1), ("XL330-M288", 2), fast=False, recorded=False)
        for _ in range(20):
            client.bus.receive(shouted(chance), client.clock.now_ns())
            client.pass_time(chance.choice([0, 20_000, 2 * MS, 40 * MS]))
        client.pass_time(1_000 * MS)
        servos = client.servos.values()
        for servo in servos:
            client.bus.host_baud = servo.baud
            client.line.read()
            client.send(servo.id, Instruction.PING)
            alike = sum(each.id == servo.id for each in servos) > 1
            assert alike or [each.id for each in client.replies(100 * MS)] == [servo.id], seed
            assert all(map(math.isfinite, servo.state(client.clock.now_ns()))), seed
