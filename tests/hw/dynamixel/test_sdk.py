"""Set-up through dynamixel-sdk: what a failure costs and says, and that it never reads as zero."""

from __future__ import annotations

import pytest

from haptic_wall.hw.clock import SimulatedClock
from haptic_wall.hw.dynamixel.codec import encode_status
from haptic_wall.hw.dynamixel.sdk import Sdk
from haptic_wall.hw.dynamixel.tables import MODELS
from haptic_wall.hw.errors import ServoLostError, ServoMissingError, UnfitServoError
from tests.hw.dynamixel.lines import MS, ClockLine, Fate, TroubledLine, unharmed

REGISTERS = MODELS["XM430-W350"].registers


class Bench:
    def __init__(self, fate: Fate = unharmed, baud: int = 1_000_000) -> None:
        self.clock = SimulatedClock()
        self.servo = ClockLine(self.clock)
        self.sdk = Sdk(TroubledLine(self.servo, fate), baud, 1, "/dev/ttyTEST")


def first(count: int, fate: Fate) -> Fate:
    return lambda number, reply: fate(number, reply) if number < count else [(0, reply)]


def lost(_number: int, _reply: bytes) -> list[tuple[int, bytes]]:
    return []


def refused(error: int) -> Fate:
    return lambda _number, _reply: [(0, encode_status(1, error))]


def test_the_model_is_found() -> None:
    assert Bench().sdk.ping() == 1020


@pytest.mark.parametrize(
    ("name", "value"), [("led", 1), ("goal_current", -3), ("goal_current", 1193), ("goal_pwm", -1)]
)
def test_what_was_written_is_read_back_with_its_sign(name: str, value: int) -> None:
    sdk = Bench().sdk
    sdk.write(REGISTERS[name], value)
    assert sdk.read(REGISTERS[name]) == value


@pytest.mark.parametrize("trouble", [lost, lambda _, reply: [(0, reply[:-1] + b"\x00")]])
def test_two_bad_replies_in_a_row_are_got_over(trouble: Fate) -> None:
    assert Bench(first(2, trouble)).sdk.ping() == 1020
    sdk = Bench(first(2, trouble)).sdk
    sdk.write(REGISTERS["led"], 1)
    assert sdk.read(REGISTERS["led"]) == 1


def test_nothing_that_answers_is_a_missing_servo_and_says_where() -> None:
    with pytest.raises(ServoMissingError, match=r"id 1 at 1000000 baud on /dev/ttyTEST.*servo\.id"):
        Bench(lost).sdk.ping()


def test_a_read_without_an_answer_raises_in_place_of_zero() -> None:
    with pytest.raises(ServoLostError, match=r"Hardware Error Status \(70\) was read"):
        Bench(lost).sdk.read(REGISTERS["hardware_error_status"])


def test_a_write_without_an_answer_raises() -> None:
    with pytest.raises(ServoLostError, match=r"1 was written to Led \(65\)"):
        Bench(lost).sdk.write(REGISTERS["led"], 1)


def test_a_refusal_says_of_what_and_why() -> None:
    bench = Bench(refused(7))
    with pytest.raises(
        UnfitServoError, match=r"refuses to write 0 to Operating Mode \(11\):.*not available"
    ):
        bench.sdk.write(REGISTERS["operating_mode"], 0)
    with pytest.raises(UnfitServoError, match=r"refuses to read Operating Mode \(11\)"):
        bench.sdk.read(REGISTERS["operating_mode"])
    with pytest.raises(UnfitServoError, match="refuses a ping"):  # no model number is in that
        bench.sdk.ping()


def test_a_latched_hardware_error_does_not_hide_the_value() -> None:
    bench = Bench(lambda _, reply: [(0, encode_status(1, 0x80, reply[9:-2]))])
    bench.servo.registers[70] = 0x20
    assert bench.sdk.read(REGISTERS["hardware_error_status"]) == 0x20


def test_a_late_reply_is_not_taken_for_the_answer_to_another_question() -> None:
    bench = Bench(first(1, lambda _, reply: [(6 * MS, reply)]))  # given up after three
    bench.servo.registers[64], bench.servo.registers[65] = 1, 0
    assert bench.sdk.read(REGISTERS["torque_enable"]) == 1
    assert bench.sdk.read(REGISTERS["led"]) == 0


@pytest.mark.parametrize("data", [b"", b"\x01", b"\x01\x02\x03", bytes(16)])
def test_a_reply_of_another_length_is_passed_over(data: bytes) -> None:
    """It answers another question; a checksum's byte would be taken for the value."""
    stray = encode_status(1, 0, data)
    bench = Bench(first(1, lambda _, reply: [(0, stray), (MS // 10, reply)]))
    bench.servo.registers[102] = 7
    assert bench.sdk.read(REGISTERS["goal_current"]) == 7


def test_replies_of_another_length_alone_are_told() -> None:
    bench = Bench(lambda *_: [(0, encode_status(1, 0, bytes(16)))])
    with pytest.raises(
        ServoLostError,
        match=r"Led \(65\) was read \(a reply with 16 bytes of data came, 1 wanted\)",
    ):
        bench.sdk.read(REGISTERS["led"])
    with pytest.raises(ServoLostError, match=r"Led \(65\) \(a reply with 16 bytes.*0 wanted\)"):
        bench.sdk.write(REGISTERS["led"], 1)
    with pytest.raises(ServoMissingError, match=r"with 16 bytes of data came, 3 wanted"):
        bench.sdk.ping()


def test_an_adapter_left_at_its_slow_timer_is_got_over() -> None:
    bench = Bench(lambda _, reply: [(16 * MS, reply)])
    bench.servo.registers[64], bench.servo.registers[65] = 1, 0
    assert bench.sdk.ping() == 1020
    assert bench.sdk.read(REGISTERS["torque_enable"]) == 1
    assert bench.sdk.read(REGISTERS["led"]) == 0


def test_a_reply_at_the_factory_rate_has_its_time() -> None:
    """A read at 57600 baud takes 4.7 ms on the wire, both ways."""
    bench = Bench(baud=57_600)
    bench.servo.reply_ns = 5 * MS
    begun = bench.clock.now_ns()
    assert bench.sdk.ping() == 1020
    assert bench.clock.now_ns() - begun == 5 * MS


def test_a_write_that_is_not_confirmed_can_be_sent() -> None:
    bench = Bench(lost)
    bench.sdk.write_unanswered(REGISTERS["status_return_level"], 2)
    assert bench.servo.registers[68] == 2


def test_long_registers_are_refused() -> None:
    with pytest.raises(ValueError, match="1 or 2 wanted"):
        Bench().sdk.read(REGISTERS["present_position"])


def test_a_reboot_is_confirmed() -> None:
    with pytest.raises(ServoLostError, match="the reboot was requested"):
        Bench().sdk.reboot()  # this servo knows no reboot
