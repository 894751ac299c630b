"""How an emulated servo moves in each mode.

The oracle is the manual (units, gains), the published figures of the model, and
mechanics in closed form.
"""

import math
from dataclasses import replace

import pytest

from haptic_wall.hw.dynamixel.codec import ErrorCode
from haptic_wall.hw.dynamixel.tables import MODELS
from haptic_wall.hw.emulated.bus import EmulatedBus
from haptic_wall.hw.emulated.servo import EmulatedServo
from haptic_wall.hw.truth import TrueArm, TrueServo
from tests.hw.dynamixel.emulated_client import Client
from tests.typed import not_none

X, X540, SMALL = "XM430-W350", "XM540-W270", "XL330-M288"
POSITION, EXTENDED = 3, 4
# A published identification of an MX-64, the next relative of an XM430 (Rhoban "bam").
MX64 = TrueServo(0.011951, 0.011692, 0.09039, position=math.pi, torque_limit=20.0)
COUNTS = 4096 / (2 * math.pi)


class Moving:
    """One servo in a mode, and its registers by name."""

    def __init__(self, model: str = X, mode: int = POSITION, true: TrueServo = MX64) -> None:
        self.client = Client((model, 1), true=true, recorded=False)
        self.servo = self.client.servos[1]
        self.registers = MODELS[model].registers
        self.write(operating_mode=mode)

    def set(self, name: str, value: int) -> int:
        """The error byte of the reply."""
        register = self.registers[name]
        return self.client.write(1, register.address, value, register.size)

    def write(self, **values: int) -> None:
        for name, value in values.items():
            assert self.set(name, value) == 0, name

    def __getitem__(self, name: str) -> int:
        register = self.registers[name]
        return self.client.read(1, register.address, register.size, signed=register.minimum < 0)

    def pass_time(self, seconds: float) -> None:
        self.client.pass_time(round(seconds * 1e9))

    def on(self, **goals: int) -> "Moving":
        self.write(torque_enable=1, **goals)
        return self


def friction_counts(model: str, true: TrueServo) -> float:
    """How far from its goal Coulomb friction can hold a proportional controller [counts]."""
    figures = MODELS[model]
    share = true.coulomb / not_none(figures.stall_torque)
    return share * 885 / (800 / 128)


@pytest.mark.parametrize("model", [X, X540, SMALL, "XW540-T260", "XC330-T288"])
def test_position_mode_goes_to_its_goal_and_says_when_it_is_there(model: str) -> None:
    true = replace(MX64, coulomb=0.01 * not_none(MODELS[model].stall_torque))
    servo = Moving(model, true=true).on(goal_position=2600)
    servo.pass_time(0.03)
    assert servo["moving"] == 1
    servo.pass_time(4)
    assert servo["present_position"] == pytest.approx(2600, abs=friction_counts(model, true) + 1)
    assert servo["moving"] == 0


def test_enabling_torque_moves_nothing() -> None:
    servo = Moving()
    servo.write(goal_position=100)
    servo.on()
    servo.pass_time(0.2)
    assert servo["present_position"] == servo["goal_position"] == 2048


def test_extended_mode_counts_turns_and_position_mode_forgets_them() -> None:
    servo = Moving(mode=EXTENDED).on(goal_position=-10_000)
    servo.pass_time(5)
    assert servo["present_position"] == pytest.approx(-10_000, abs=5)
    assert servo.client.position() == pytest.approx(-10_000 / COUNTS, abs=5 / COUNTS)
    servo.write(torque_enable=0, operating_mode=POSITION)
    servo.on()
    assert servo["present_position"] == pytest.approx(-10_000 % 4096, abs=5)


def test_the_bus_watchdog_stops_it() -> None:
    servo = Moving().on(bus_watchdog=5, goal_position=4000)
    servo.pass_time(0.099)
    assert abs(servo.servo.state(servo.client.clock.now_ns()).velocity) > 0.5
    servo.pass_time(1)
    stopped = servo.client.position()
    assert servo["bus_watchdog"] == 255
    assert servo["moving"] == 0
    assert servo.set("goal_position", 100) == ErrorCode.DATA_RANGE
    servo.write(bus_watchdog=0)
    servo.pass_time(0.5)
    assert servo.client.position() == pytest.approx(stopped, abs=0.02)


@pytest.mark.parametrize("model", ["XM430-W350", "XL330-M288"])
def test_servos_of_an_arm_move_together_whoever_is_asked(model: str) -> None:
    """The second drive is computed in steps (an XL330 senses its supply); nobody asks the first."""
    true = TrueServo(inertia=0.002, damping=0.01, coulomb=0.0)
    servos = [
        EmulatedServo(MODELS[each], id_, 48, true, start_ns=0, baud=4_000_000)
        for id_, each in enumerate(("XM430-W350", model), 1)
    ]
    EmulatedBus(servos, baud=4_000_000, start_ns=0, arm=TrueArm("planar", mass_2=0.05))
    for name, value in (("operating_mode", 0), ("torque_enable", 1), ("goal_current", 30)):
        register = servos[1].memory.registers[name]
        servos[1].write(register.address, register.encode(value), 0)
    for now_ms in range(1, 301):
        servos[1].state(now_ms * 1_000_000)
        if now_ms == 150:
            after = servos[0].state(now_ms * 1_000_000).position
    first, second = (each.mechanism for each in servos)
    assert first.time_ns == second.time_ns
    assert first.position < after < -0.01
    assert second.position > 0.01
    assert second.torque > 0.0
