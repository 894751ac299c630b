"""The simulated servo's own behaviour; the contract tests hold the shared one."""

import math
from typing import Any

import pytest

from haptic_wall.hw.clock import SimulatedClock
from haptic_wall.hw.dynamixel.tables import MODELS
from haptic_wall.hw.emulated.servo import EmulatedServo
from haptic_wall.hw.servo import Outcome
from haptic_wall.hw.simulated import SimulatedBus
from haptic_wall.hw.truth import TrueServo
from tests.support.one_servo import OneServo

MS = 1_000_000


def started(start_ns: int = 0, **settings: Any) -> tuple[OneServo, SimulatedClock]:
    clock = SimulatedClock(start_ns)
    true = TrueServo(**{"inertia": 0.01, "counts_per_rev": 0, **settings})
    servo = OneServo(SimulatedBus([true], clock))
    servo.start()
    return servo, clock


def test_the_position_is_that_of_the_request_however_late_it_is_collected() -> None:
    servo, clock = started()
    servo.write(1.0)
    clock.wait_until(10 * MS)
    servo.request()
    clock.wait_until(15 * MS)
    reading = servo.collect(20 * MS)
    assert reading.outcome is Outcome.OK
    assert reading.sampled_ns == 10 * MS
    # u t² / 2 m
    assert reading.position == pytest.approx(0.5 * 100.0 * 0.01**2, rel=1e-12)
    assert math.isnan(reading.torque)


def test_its_time_begins_with_the_start() -> None:
    # A hand would have moved it, had it begun when it was opened.
    clock = SimulatedClock()
    true = TrueServo(inertia=0.01, counts_per_rev=0, hand="lean", position=0.1)
    servo = OneServo(SimulatedBus([true], clock))
    clock.wait_until(5000 * MS)
    servo.start()
    servo.request()
    assert servo.collect(0).position == 0.1
    clock.wait_until(7000 * MS)
    servo.request()
    assert servo.collect(0).position == pytest.approx(0.5, abs=1e-3)


def test_a_reading_answers_one_request() -> None:
    servo, _ = started()
    with pytest.raises(RuntimeError, match="call request first"):
        servo.collect(0)
    servo.request()
    servo.collect(0)
    with pytest.raises(RuntimeError, match="call request first"):
        servo.collect(0)


def test_it_has_the_drive_of_an_emulated_one() -> None:
    """Goals of 500 and -300 units of current, to near the no-load speed and back."""
    drive = {"current_bandwidth": 90.0, "back_emf": True, "current_droop": 0.1, "dead_band": 0.02}
    true: dict[str, Any] = {"inertia": 0.01, "coulomb": 0.05, "torque_limit": 4.1, **drive}
    no_load = 46.0 * math.tau / 60.0
    servo, clock = started(**true, no_load_speed=no_load)
    model = MODELS["XM430-W350"]
    emulated = EmulatedServo(model, 1, 48, TrueServo(**true), start_ns=0, baud=57_600)
    for name, value in (("operating_mode", 0), ("goal_current", 0), ("torque_enable", 1)):
        emulated.memory[name] = value
    for units in (500, -300, 0):
        emulated.write(102, units.to_bytes(2, "little", signed=True), clock.now_ns())
        servo.write(units * model.current_unit_ma * 1e-3 * 4.1 / 2.3)
        for _ in range(60):
            clock.wait_until(clock.now_ns() + MS)
            servo.request()
            position = servo.collect(clock.now_ns()).position
            assert position == pytest.approx(emulated.state(clock.now_ns()).position, abs=1e-9)
        if units == 500:
            assert 0.8 * no_load < emulated.state(clock.now_ns()).velocity < no_load
