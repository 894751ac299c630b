"""The driver as a servo: torque in N·m out, positions in, and torque off however it ends.

Over the emulated bus in memory; the truth is looked at from outside.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import pytest

from haptic_wall.hw.dynamixel.codec import Instruction, Parser
from haptic_wall.hw.errors import ServoLostError, TorqueLostError
from tests.hw.dynamixel.bench import TRUE, Bench
from tests.hw.dynamixel.lines import Fate, TroubledLine, unharmed
from tests.support.one_servo import OneServo

STEP = 2.69e-3 * 4.1 / 2.3
"""[N·m] per current unit of an XM430-W350: unit times stall torque over stall current"""
COUNT = 2 * math.pi / 4096
FREE = replace(TRUE, coulomb=0.0, damping=0.0)


def started(**settings: object) -> Bench:
    bench = Bench(probe_torque=0.0, **settings)  # type: ignore[arg-type]
    bench.servo.start()
    return bench


def test_a_torque_acts_as_it_was_returned() -> None:
    bench = started()
    for wanted in (0.5, -0.5, 0.001, 3.0, -3.0, 0.0):
        sent = bench.servo.write(wanted)
        assert abs(sent - wanted) <= STEP / 2 + 1e-12
        bench.wait(0.001)
        assert bench.state.torque == pytest.approx(sent, abs=1e-12)


def test_the_servos_own_current_limit_bounds_the_torque() -> None:
    """A goal beyond it would be refused without a word, and the old one stay in force."""
    bench = Bench()
    bench.truth.memory["current_limit"] = 100
    bench.servo.start()
    assert bench.servo.facts.torque_limit == pytest.approx(100 * STEP)
    assert bench.servo.write(4.0) == pytest.approx(100 * STEP)
    bench.wait(0.0001)
    assert bench.state.torque == pytest.approx(100 * STEP)


def test_supply_and_temperature_are_known_once_polled() -> None:
    bench = started()
    assert bench.servo.health() == (0.0, 0.0)
    bench.truth.table.temperature = 41
    for _ in range(600):
        bench.servo.request()
        bench.servo.collect(bench.clock.now_ns() + 800_000)
        bench.servo.write(0.0)
        bench.wait(0.001)
    volts, celsius = bench.servo.health()
    assert volts == pytest.approx(bench.truth.table.supply, abs=0.1)
    assert celsius == 41


def test_the_position_is_the_true_one_and_counts_on_over_turns() -> None:
    bench = started(true=replace(FREE, position=3.0))
    seen = []
    for _ in range(400):
        begun = bench.clock.now_ns()
        bench.servo.request()
        reading = bench.servo.collect(begun + 900_000)
        truth = bench.state
        # The sample is taken while its bytes travel, at most 0.3 ms before in a wide block.
        tolerance = COUNT / 2 + 3e-4 * abs(truth.velocity)
        assert reading.position == pytest.approx(truth.position, abs=tolerance)
        assert reading.counts == round(reading.position / COUNT)
        assert reading.sampled_ns == begun
        bench.servo.write(0.5)
        bench.clock.wait_until(begun + 1_000_000)
        seen.append(reading.position)
    assert seen[-1] > 3.0 + 1.0  # past pi without a jump
    assert max(b - a for a, b in itertools.pairwise(seen)) < 0.02


def troubled(fate: Fate) -> tuple[Bench, OneServo, TroubledLine]:
    """A started servo whose replies meet ``fate`` from then on."""
    bench = Bench(FREE, probe_torque=0.0)
    line = TroubledLine(bench.memory_line, unharmed)
    servo = OneServo.driven(bench.settings, line)
    servo.start()
    line.fate, line.number = fate, 0
    return bench, servo, line


def test_stopping_gets_over_lost_replies() -> None:
    bench, servo, line = troubled(lambda number, reply: [] if number < 4 else [(0, reply)])
    servo.write(1.0)
    begun = bench.clock.now_ns()
    assert servo.stop() is True
    assert bench.clock.now_ns() - begun < 25_000_000
    assert line.number >= 5


def test_stopping_without_any_reply_does_not_claim_that_torque_is_off() -> None:
    bench, servo, line = troubled(lambda *_: [])
    servo.write(1.0)
    assert servo.stop() is False
    assert bench.truth.memory["torque_enable"] == 0  # yet all was tried
    line.fate = unharmed
    assert servo.stop() is True


def test_stopping_before_the_start_sends_no_goal() -> None:
    bench = Bench()
    bench.truth.memory["torque_enable"] = 1
    assert bench.servo.stop() is True
    assert bench.truth.memory["torque_enable"] == 0
    who, *others = [frame for data in bench.line.frames for frame in Parser().feed(data)]
    assert who.instruction == Instruction.PING  # a servo of another kind is not written to
    for frame in others:
        assert frame.instruction in (Instruction.SYNC_WRITE, Instruction.READ)
        assert frame.params[:2] == bytes([64, 0])


def test_a_vanished_port_is_a_lost_servo_and_stopping_says_so() -> None:
    bench = started()

    def gone(*_: object) -> bytes:
        raise ServoLostError("The serial port is gone.")

    bench.line.write = bench.line.read = gone  # type: ignore[method-assign, assignment]
    with pytest.raises(ServoLostError):
        bench.servo.write(1.0)
    with pytest.raises(ServoLostError):
        bench.servo.request()
    assert bench.servo.stop() is False
    bench.servo.close()
    assert bench.line.closed == 1


def test_a_zero_that_cannot_be_sent_does_not_keep_the_torque_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A port that took no byte for a moment may take the next."""
    bench = started()
    bench.cycle(0.5)
    write, failures = bench.line.write, iter([True])

    def failing_once(data: bytes) -> None:
        if next(failures, False):
            raise ServoLostError("the port has sent nothing")
        write(data)

    monkeypatch.setattr(bench.line, "write", failing_once)
    assert bench.servo.stop() is True
    assert bench.truth.memory["torque_enable"] == 0


def test_a_start_that_cannot_confirm_torque_off_says_so() -> None:
    bench = Bench()
    read = bench.line.read
    deaf = []

    def deaf_once_torque_is_on() -> bytes:
        data = read()
        if bench.truth.memory["torque_enable"]:
            deaf.append(True)
        return b"" if deaf else data

    bench.line.read = deaf_once_torque_is_on  # type: ignore[method-assign]
    with pytest.raises(ServoLostError, match="could not be read back: switch the power off"):
        bench.servo.start()


def test_a_silent_loop_loses_its_torque_to_the_watchdog() -> None:
    bench = started(watchdog_s=0.04)
    bench.servo.write(1.0)
    bench.wait(0.039)
    assert bench.state.torque > 0.9
    bench.wait(0.002)
    assert bench.state.torque == 0.0


@pytest.mark.parametrize("pause_s", [0.019, 0.03, 0.039, 0.041, 0.5, 20.0])
def test_a_pause_before_the_first_cycle_costs_no_torque(pause_s: float) -> None:
    """The watchdog trips while the program gets ready; goals would be refused without a word."""
    bench = started(watchdog_s=0.04)
    bench.wait(pause_s)
    bench.cycle(1.0)
    bench.wait(0.001)
    assert bench.state.torque == pytest.approx(1.0, abs=STEP / 2)


def test_a_pause_at_zero_torque_costs_no_torque() -> None:
    bench = started(watchdog_s=0.04)
    for torque in (1.0, 0.0):
        bench.cycle(torque)
    bench.wait(0.1)
    bench.cycle(1.0)
    bench.wait(0.001)
    assert bench.state.torque == pytest.approx(1.0, abs=STEP / 2)


@pytest.mark.parametrize("lost", range(7))
def test_torque_is_never_on_without_the_watchdog_after_a_pause(lost: int) -> None:
    """Whichever of the writes that arm it again is not confirmed."""
    bench, servo, line = troubled(unharmed)
    bench.wait(0.1)
    unguarded = bench.spy_unguarded()
    line.fate, line.number = (lambda number, reply: [] if number == lost else [(0, reply)]), 0
    servo.request()
    servo.write(1.0)
    bench.wait(0.001)
    assert unguarded
    assert not any(unguarded)
    assert bench.state.torque == pytest.approx(1.0, abs=STEP / 2)


def test_a_torque_that_the_watchdog_has_ended_is_not_brought_back_but_told() -> None:
    bench = started(watchdog_s=0.04)
    bench.cycle(1.0)
    bench.wait(0.06)
    with pytest.raises(ServoLostError, match=r"heard nothing for 6\d ms.*Watchdog \(40 ms\)"):
        bench.cycle(1.0)
    assert bench.state.torque == 0.0
    assert bench.servo.stop() is True


def test_a_servo_silent_after_a_pause_is_lost() -> None:
    bench, servo, _ = troubled(lambda *_: [])
    servo.write(1.0)
    begun = bench.clock.now_ns()
    bench.wait(0.1)
    with pytest.raises(ServoLostError, match=r"no longer answers.*cable") as lost:
        servo.request()
    assert not isinstance(lost.value, TorqueLostError)
    assert bench.clock.now_ns() - begun < 140_000_000


def test_a_watchdog_that_trips_at_the_end_of_the_start_costs_no_torque() -> None:
    """After the probe has seen the motion it was to see, nothing else would look."""
    bench = Bench(watchdog_s=0.04)
    write, goals = bench.line.write, []

    def stall_while_braking(data: bytes) -> None:
        (frame,) = Parser().feed(data)
        if frame.params[:1] == bytes([102]):
            goals.append(int.from_bytes(frame.params[5:7], "little", signed=True))
            if goals[-1] > 0 and goals[-2] < 0:
                bench.wait(0.06)
        write(data)

    bench.line.write = stall_while_braking  # type: ignore[method-assign]
    bench.servo.start()
    assert min(goals) < 0 < max(goals)
    assert not bench.truth.table.tripped
    bench.cycle(1.0)
    assert bench.state.torque == pytest.approx(1.0, abs=STEP / 2)


def test_a_goal_kept_through_the_watchdog_does_not_come_back_with_its_arming() -> None:
    """The manual does not say whether it is kept; the last zero may not have arrived."""
    bench = started(watchdog_s=0.04)
    bench.cycle(1.0)
    assert bench.state.torque > 0.9
    kept = bench.truth.memory["goal_current"]
    bench.servo.one.goal = 0  # what the driver sent last was lost on its way
    bench.wait(0.06)
    bench.memory_line.wait(bench.clock.now_ns())
    assert bench.truth.table.tripped
    bench.truth.memory["goal_current"] = kept
    bench.servo.request()
    assert not bench.truth.table.tripped
    assert bench.state.torque == 0.0
