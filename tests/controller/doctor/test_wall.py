"""Whether the servo's Current Limit leaves the requested wall a stiffness."""

import re

import pytest

from haptic_wall.controller.doctor.wall import judge_wall
from haptic_wall.controller.settings.load import load_config
from haptic_wall.hw.dynamixel.tables import MODELS
from haptic_wall.hw.dynamixel.torque_law import torque_law
from haptic_wall.hw.servo import Check
from tests.cases import sampled


def judged(current: int, *sets: str, model: str = "XM430-W350") -> Check:
    config = load_config("xm430-w350", [f"servo.model={model}", *sets]).config
    servo = MODELS[model]
    assert servo.torque_constant is not None
    law = torque_law(servo, servo.torque_constant, servo.voltage)
    return judge_wall(config, current, servo.current_limit, law)


@pytest.mark.parametrize("model", sampled(["XM430-W350", "XL330-M288", "XM540-W270"], 3))
@pytest.mark.parametrize("damping", [0.02, 0.03])
def test_the_advised_current_limit_is_the_least_that_suffices(model: str, damping: float) -> None:
    sets = f"wall.damping={damping}"
    finding = judged(1, sets, model=model)
    assert not finding.ok and finding.found.startswith("0 of 7 N·m/rad")
    advised = re.fullmatch(r"raise Current Limit \(38\) to (\d+), which leaves (.*)", finding.fix)
    assert advised
    most = MODELS[model].current_limit
    found = [judged(each, sets, model=model).found for each in (int(advised[1]), most)]
    assert found[0].split(" at ")[0] == found[1].split(" at ")[0]
    assert advised[2].split()[0] == found[0].split()[0]
    assert not judged(int(advised[1]) - 1, sets, model=model).found.startswith(found[0].split()[0])


def test_what_no_current_limit_mends_is_named() -> None:
    finding = judged(1193, "guard.quantisation_share=1e-6")
    assert not finding.ok and "limit quantisation" in finding.fix


@pytest.mark.parametrize("sets", ["wall.stiffness=0", "wall.law=damper", "guard.mode=off"])
def test_no_stiffness_is_right_where_none_is_requested_or_none_is_limited(sets: str) -> None:
    assert judged(1, sets).ok
