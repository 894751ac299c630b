"""The contract of all buses, and what is the line servo's own, on a board in memory."""

from __future__ import annotations

import pytest

pytest.importorskip("line_servo", reason="pip install docs/examples/line_servo")

from line_board import Board
from line_servo import LineServo

from haptic_wall.controller.pytest_plugin.servo_contract import BusContract, Rig
from haptic_wall.hw.clock import SimulatedClock
from haptic_wall.hw.errors import ServoMissingError
from haptic_wall.hw.servo import Outcome
from haptic_wall.hw.settings import ServoSettings

SETTINGS = ServoSettings(backend="line", torque_limit=0.8)


class MemoryLine:
    """Hands what is written to a board, and its answer back."""

    def __init__(self, clock):
        self.clock = clock
        self.board = Board(clock.now_ns())
        self.answer = b""

    def write(self, data):
        self.answer += self.board.take(data, self.clock.now_ns())

    def read(self):
        answer, self.answer = self.answer, b""
        return answer

    def wait(self, deadline_ns):
        if not self.answer:
            self.clock.wait_until(deadline_ns)
        return bool(self.answer)

    def close(self):
        pass


class TestLineServo(BusContract):
    def make_rig(self):
        clock = SimulatedClock()
        return Rig(LineServo(SETTINGS, MemoryLine(clock)), clock, push=0.3)


@pytest.fixture
def line():
    return MemoryLine(SimulatedClock())


@pytest.fixture
def servo(line):
    return LineServo(SETTINGS, line)


def test_an_answer_that_comes_late_is_not_taken_for_the_next_one(servo, line):
    servo.start()
    servo.request()
    late, line.answer = line.answer, b""
    assert servo.collect(line.clock.now_ns() + 500_000)[0].outcome is Outcome.LOST
    line.answer = late
    servo.request()
    assert servo.collect(line.clock.now_ns() + 500_000)[0].outcome is Outcome.OK
    (counts,) = servo.traffic.counts
    assert (counts.lost, counts.late) == (1, 1)


def test_a_broken_answer_is_no_position(servo, line):
    servo.start()
    servo.request()
    line.answer = b"P 1 2x\n"
    assert servo.collect(line.clock.now_ns() + 500_000)[0].outcome is Outcome.CORRUPT


def test_a_board_that_is_not_there_is_missing(servo, line):
    line.board.take = lambda *_: b""
    with pytest.raises(ServoMissingError, match="does not answer"):
        servo.start()
    assert servo.stop() is False
