"""Registers by name: the cost of a failure and its message, and that it never reads as zero."""

from __future__ import annotations

import pytest

from haptic_wall.hw.clock import SimulatedClock
from haptic_wall.hw.dynamixel.codec import encode_status
from haptic_wall.hw.dynamixel.register_access import Table
from haptic_wall.hw.dynamixel.tables import MODELS
from haptic_wall.hw.errors import ServoLostError, ServoMissingError, UnfitServoError
from tests.hw.dynamixel.lines import MS, ClockLine, Fate, TroubledLine, unharmed


class Bench:
    def __init__(self, fate: Fate = unharmed, baud: int = 1_000_000) -> None:
        self.clock = SimulatedClock()
        self.servo = ClockLine(self.clock)
        line = TroubledLine(self.servo, fate)
        self.table = Table.on(line, baud, 1, "/dev/ttyTEST", MODELS["XM430-W350"])


def first(count: int, fate: Fate) -> Fate:
    return lambda number, reply: fate(number, reply) if number < count else [(0, reply)]


def lost(_number: int, _reply: bytes) -> list[tuple[int, bytes]]:
    return []


def refused(error: int) -> Fate:
    return lambda _number, _reply: [(0, encode_status(1, error))]


@pytest.mark.parametrize(
    ("name", "value"), [("led", 1), ("goal_current", -3), ("goal_current", 1193), ("goal_pwm", -1)]
)
def test_what_was_written_is_read_back_with_its_sign(name: str, value: int) -> None:
    table = Bench().table
    assert table.write(name, value) == value
    assert table.read(name) == value


@pytest.mark.parametrize("count", [1, 3])
@pytest.mark.parametrize(
    "trouble", [lost, lambda _, reply: [(0, reply[:-1] + b"\x00")], *map(refused, range(1, 8))]
)
def test_bad_replies_in_a_row_are_got_over(trouble: Fate, count: int) -> None:
    """A refusal too: it may be that of a damaged or an earlier request."""
    assert Bench(first(count, trouble)).table.ping() == 1020
    assert Bench(first(count, trouble)).table.write("led", 1) == 1
    bench = Bench(first(count, trouble))
    bench.servo.registers[65] = 1
    assert bench.table.read("led") == 1


def test_nothing_that_answers_is_a_missing_servo_and_says_where() -> None:
    with pytest.raises(ServoMissingError, match=r"id 1 at 1000000 baud on /dev/ttyTEST: .*scan"):
        Bench(lost).table.ping()


def test_what_has_no_answer_raises_in_place_of_zero() -> None:
    table = Bench(lost).table
    with pytest.raises(ServoLostError, match=r"ttyTEST .*to read Hardware Error Status \(70\): ch"):
        table.read("hardware_error_status")
    with pytest.raises(ServoLostError, match=r"request to write 1 to Led \(65\): check the cable"):
        table.write("led", 1)
    with pytest.raises(ServoLostError, match="the request to reboot"):
        Bench().table.reboot()  # this servo knows no reboot


def test_a_refusal_says_of_what_and_why() -> None:
    table = Bench(refused(7)).table
    with pytest.raises(
        UnfitServoError, match=r"refuses to write 0 to Operating Mode \(11\) \(acce"
    ):
        table.write("operating_mode", 0)
    with pytest.raises(UnfitServoError, match=r"refuses to read Operating Mode \(11\)"):
        table.read("operating_mode")
    with pytest.raises(UnfitServoError, match="refuses a ping"):  # no model number is in that
        table.ping()


@pytest.mark.parametrize("error", [2, 3, 5])
def test_requests_that_arrive_damaged_are_the_lines_fault(error: int) -> None:
    table = Bench(refused(error)).table
    garbled = r"\((instruction|crc|data length) error\): .*cable"
    with pytest.raises(ServoLostError, match=garbled):
        table.read("led")
    with pytest.raises(ServoLostError, match=garbled):
        table.write("led", 1)
    with pytest.raises(ServoMissingError, match=r"ttyTEST \(.* error\): .*cable"):
        table.ping()


def test_a_latched_hardware_error_does_not_hide_the_value() -> None:
    bench = Bench(lambda _, reply: [(0, encode_status(1, 0x80, reply[9:-2]))])
    bench.servo.registers[70] = 0x20
    assert bench.table.read("hardware_error_status") == 0x20


def test_a_write_is_confirmed_by_no_other_writes_reply() -> None:
    """Of the second write the request is lost once, and the first one's reply comes late."""
    bench = Bench(first(1, lambda _, reply: [(7 * MS, reply)]))
    assert bench.table.write("led", 1) == 1
    losses = [1]

    def lose_one(data: bytes) -> None:
        if losses:
            losses.pop()
        else:
            ClockLine.write(bench.servo, data)

    bench.servo.write = lose_one  # type: ignore[method-assign]
    assert bench.table.write("torque_enable", 1) == 1
    assert bench.servo.registers[64] == 1


@pytest.mark.parametrize("data", [b"", b"\x01", b"\x01\x02\x03", bytes(16)])
def test_a_reply_of_another_length_is_passed_over(data: bytes) -> None:
    stray = encode_status(1, 0, data)
    bench = Bench(first(1, lambda _, reply: [(0, stray), (MS // 10, reply)]))
    bench.servo.registers[102] = 7
    assert bench.table.read("goal_current") == 7
