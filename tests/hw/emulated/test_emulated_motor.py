"""The motor of an emulated servo: published figures, and currents that the supply sees."""

import math
from dataclasses import replace

import pytest

from haptic_wall.hw.dynamixel.tables import MODELS, Model
from haptic_wall.hw.emulated.motor import motor_of
from haptic_wall.hw.truth import TrueServo
from tests.hw.dynamixel.emulated_client import FREE, MS, TORQUE_UNIT, Client
from tests.typed import not_none

MODE, TORQUE_ENABLE, GOAL_CURRENT, GOAL_PWM, GOAL_POSITION, TEMPERATURE = 11, 64, 102, 100, 116, 146
TEMPERATURE_LIMIT, MAX_VOLTAGE, SHUTDOWN, HARDWARE_ERROR, VOLTAGE = 31, 32, 63, 70, 144
PRESENT_PWM, PRESENT_CURRENT, PRESENT_VELOCITY = 124, 126, 128
SMALL = "XL330-M288"
HELD = TrueServo(inertia=0.01, coulomb=50.0, position=1.0, torque_limit=20.0)
RPM = 2 * math.pi / 60

published = [model for model in MODELS.values() if model.no_load_rpm and model.stall_current]


@pytest.mark.parametrize("model", published, ids=lambda model: model.name)
def test_stall_and_no_load_are_the_published_ones(model: Model) -> None:
    motor = motor_of(model, not_none(model.torque_constant))
    stalled = motor.current(1.0, model.voltage, 0.0)
    assert stalled == pytest.approx(model.stall_current)
    assert stalled * motor.torque_constant == pytest.approx(model.stall_torque)
    assert motor.current(1.0, model.voltage, not_none(model.no_load_rpm) * RPM) == pytest.approx(
        0, abs=1e-12
    )


def held(model: str, goal: int, true: TrueServo = HELD) -> Client:
    """A servo in current mode, held by friction, with this Goal Current for a while."""
    client = Client((model, 1), true=true, recorded=False)
    client.enable_current_mode()
    assert client.write(1, GOAL_CURRENT, goal, 2) == 0
    client.pass_time(100 * MS)
    return client


@pytest.mark.parametrize("goal", [92, -368, 735, 1470])
def test_torque_of_a_supply_sensed_servo_goes_with_the_root_of_its_current(goal: int) -> None:
    client = held(SMALL, goal)
    share = math.copysign(math.sqrt(abs(goal) / 1470), goal)
    assert client.torque() == pytest.approx(0.52 * share, rel=1e-6)
    assert client.read(1, PRESENT_CURRENT, 2, signed=True) == pytest.approx(goal, abs=1)
    pwm = client.read(1, PRESENT_PWM, 2, signed=True)
    assert pwm == pytest.approx(885 * share, abs=1)


def test_goal_pwm_limits_the_torque_of_current_mode_too() -> None:
    """At a standstill a share of the supply drives the same share of the stall current."""
    most = 4.1 * 200 / 885
    client = held("XM430-W350", 800)
    assert client.torque() == pytest.approx(800 * TORQUE_UNIT)
    client.write(1, GOAL_PWM, 200, 2)
    client.pass_time(10 * MS)
    assert client.torque() == pytest.approx(most)
    assert client.read(1, PRESENT_PWM, 2) == 200
    client.write(1, GOAL_CURRENT, -800, 2)
    client.pass_time(10 * MS)
    assert client.torque() == pytest.approx(-most)
    client.write(1, GOAL_CURRENT, 100, 2)
    client.pass_time(10 * MS)
    assert client.torque() == pytest.approx(100 * TORQUE_UNIT)  # less than the limit: as asked
    client.write(1, GOAL_PWM, 0, 2)
    client.pass_time(10 * MS)
    assert client.torque() == 0.0
    client.write(1, GOAL_PWM, 885, 2)
    assert client.torque() == pytest.approx(100 * TORQUE_UNIT)  # held again, at once
    client.write(1, GOAL_PWM, 200, 2)
    client.write(1, TORQUE_ENABLE, 0, 1)
    assert client.torque() == 0.0


def test_back_emf_in_current_mode_is_asked_for() -> None:
    """Held torque as commanded by default; what 12 V can drive where that is wanted."""
    speeds = []
    for back_emf in (False, True):
        client = Client(true=replace(FREE, back_emf=back_emf))
        client.enable_current_mode()
        client.write(1, GOAL_CURRENT, 500, 2)
        client.pass_time(100 * MS)
        speeds.append(client.servos[1].state(client.clock.now_ns()).velocity)
    assert speeds[0] == pytest.approx(500 * TORQUE_UNIT / FREE.inertia * 0.1, rel=1e-3)
    assert speeds[1] == pytest.approx(46 * RPM, rel=0.02)


def test_goal_current_acts_through_the_current_loop() -> None:
    client = Client(true=replace(HELD, current_bandwidth=80.0, dead_band=0.1))
    client.enable_current_mode()
    client.write(1, GOAL_CURRENT, 500, 2)
    goal = 500 * TORQUE_UNIT - 0.1
    assert client.torque() < 0.5 * goal
    client.pass_time(100 * MS)
    assert client.torque() == pytest.approx(goal)
