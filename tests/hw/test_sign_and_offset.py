"""A servo mounted the other way round, and one with another zero, render the same wall."""

import math
from typing import Any

import pytest

from haptic_wall.controller.runtime.session import run_session
from haptic_wall.controller.runtime.telemetry import Telemetry
from haptic_wall.controller.settings.load import load_config
from haptic_wall.hw.clock import SimulatedClock
from haptic_wall.hw.hand import SharedHand

WALL = (
    "loop.clock=simulated",
    "servo.kick=0.05",
    "wall.position=1",
    "guard.mode=off",
    "wall.damping=0.04",
)


def rendered(preset: str, *sets: str) -> Any:
    telemetry = Telemetry.create()
    result = run_session(
        load_config(preset, [*WALL, *sets]).config, SimulatedClock(), telemetry, 0.6
    )
    rows, _ = telemetry.read(0)
    telemetry.close()
    assert result.torque_off
    return rows


@pytest.mark.parametrize(("preset", "hand"), [("simulated", "push"), ("emulated-ideal", "lean")])
def test_a_servo_the_other_way_round_renders_the_same_wall(preset: str, hand: str) -> None:
    usual = rendered(preset, f"servo.hand={hand}")
    turned = rendered(preset, f"servo.hand={hand}", "servo.sign=-1")
    assert max(abs(usual["torque"])) > 0.1
    for column in ("position", "torque"):
        assert (usual[column] == turned[column]).all(), column


def test_another_zero_of_the_servo_moves_no_wall() -> None:
    preset = "emulated-ideal"
    counts = 512 * math.tau / 4096
    usual = rendered(preset)
    moved = rendered(preset, f"servo.offset={counts}", "servo.sign=-1")
    for column in ("position", "torque"):
        assert moved[column] == pytest.approx(usual[column], abs=2 * math.tau / 4096), column


def test_a_hand_is_told_positions_of_the_joint() -> None:
    hand = SharedHand.create([(-1, 0.5)])
    hand.hold(1.5, 3.0, 1.4, 0)
    grasp = SharedHand(hand.descriptor).look(0)
    assert grasp is not None
    assert (grasp.origin, grasp.target) == pytest.approx((-0.9, -1.0))
    hand.close()
