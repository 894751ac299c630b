"""A servo that senses its supply's current: the wall that was asked for is the wall that acts.

The driver on the emulated bus in memory. What ought to act is computed here from the balance of
power and the published figures of an XL330-M288, not by the law under test.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_wall.hw.dynamixel.tables import MODELS
from haptic_wall.hw.dynamixel.torque_law import TorqueLaw, torque_law
from haptic_wall.hw.errors import UnfitServoError
from haptic_wall.hw.truth import TrueServo
from tests.hw.dynamixel.bench import Bench
from tests.support.one_servo import OneServo

SMALL = "XL330-M288"
TORQUE = 0.52
"""Published, at the stall [N·m]"""
SMALLEST = TORQUE * math.sqrt(1 / 1470)
"""[N·m] for 1 mA"""
INERTIA = 0.0018142
Send = Callable[[float], float]


def bench(true: TrueServo, **settings: object) -> Bench:
    made = Bench(true, model=SMALL)
    made.settings = replace(made.settings, model=SMALL, probe_torque=0.0, **settings)  # type: ignore[arg-type]
    made.servo = OneServo.driven(made.settings, made.line)
    made.servo.start()
    return made


def test_torques_below_the_first_step_are_none() -> None:
    rig = bench(TrueServo(inertia=INERTIA, coulomb=50.0))
    assert rig.servo.facts.torque_step == pytest.approx(SMALLEST)
    assert rig.servo.write(0.99 * SMALLEST) == 0.0
    assert rig.servo.write(-0.99 * SMALLEST) == 0.0
    assert rig.servo.write(1.01 * SMALLEST) == pytest.approx(SMALLEST)


def test_a_limit_below_the_smallest_torque_is_refused() -> None:
    with pytest.raises(UnfitServoError, match=r"smallest torque of the XL330-M288 is 0\.014 N·m"):
        bench(TrueServo(inertia=INERTIA), torque_limit=0.01)


def test_a_limit_below_the_smallest_torque_at_the_supply_found_is_refused() -> None:
    rig = bench(TrueServo(inertia=INERTIA), torque_limit=1.02 * SMALLEST)
    rig.servo.stop()
    rig.truth.set_supply(5.5, rig.clock.now_ns())
    with pytest.raises(UnfitServoError, match=r"smallest torque at 5\.5 V is 0\.014 N·m"):
        rig.servo.start()
    assert rig.truth.memory["torque_enable"] == 0
    assert rig.state.torque == 0.0


@given(
    torque=st.floats(-0.9, 0.9),
    volts=st.floats(3.7, 6.0),
    name=st.sampled_from(["XL330-M077", SMALL, "XC330-T288"]),
)
def test_no_more_is_sent_than_asked_and_the_next_goal_would_be_more(
    torque: float, volts: float, name: str
) -> None:
    law = torque_law(MODELS[name], 0.35, volts)
    goal = law.goal(torque)
    assert abs(law.torque(goal)) <= abs(torque) * (1 + 1e-9) + 1e-12
    assert abs(torque) < law.torque(abs(goal) + 1)
    assert law.goal(-torque) == -goal
    assert law.goal(law.torque(goal)) == goal


def goals(law: TorqueLaw, torques: list[float]) -> list[int]:
    return [law.goal(torque) for torque in torques]


def test_other_models_are_in_proportion_to_the_nearest_unit() -> None:
    constant = 4.1 / 2.3
    law = torque_law(MODELS["XM430-W350"], constant, 7.0)  # whatever its supply
    step = constant * 2.69 * 1e-3
    assert law.step == step  # to the bit
    torques = [0.37 * step, 0.62 * step, -7.4 * step, 3.0, -4.1]
    assert goals(law, torques) == [round(torque / step) for torque in torques]
    assert law.torque(77) == 77 * step


def test_the_start_reads_the_supply_it_counts_with() -> None:
    rig = bench(TrueServo(inertia=INERTIA, coulomb=50.0))
    rig.servo.stop()
    rig.truth.set_supply(4.2, rig.clock.now_ns())
    rig.servo.start()
    assert rig.servo.facts.torque_step == pytest.approx(SMALLEST * math.sqrt(4.2 / 5))
    returned = rig.servo.write(0.2)
    rig.wait(0.03)
    assert rig.state.torque == pytest.approx(returned, rel=1e-6)
