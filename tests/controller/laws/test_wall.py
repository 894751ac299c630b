"""The wall pushes out, never pulls where it must not, and hides no NaN."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_wall.controller.laws.wall import Side, Wall

number = st.floats(-100, 100)


def test_spring_and_damper_add_up() -> None:
    assert Wall(10.0, 0.5, 1.0, "both").torque(1.2, 2.0) == pytest.approx(-10 * 0.2 - 0.5 * 2.0)


def test_outside_nothing_acts() -> None:
    assert Wall(10.0, 0.5, 1.0, "above").torque(0.9, 50.0) == 0.0
    assert Wall(10.0, 0.5, 1.0, "below").torque(1.1, -50.0) == 0.0


@given(number, number, st.floats(0, 1e6), st.floats(-10, 10))
def test_a_one_sided_wall_never_pulls(
    position: float, velocity: float, stiffness: float, damping: float
) -> None:
    assert Wall(stiffness, damping, 0.3, "above").torque(position, velocity) <= 0.0
    assert Wall(stiffness, damping, 0.3, "below").torque(position, velocity) >= 0.0


@given(number, number, st.floats(0.01, 5))
def test_no_torque_is_above_the_clip(position: float, velocity: float, clip: float) -> None:
    for side in ("above", "below", "both"):
        whole = Wall(10.0, 0.5, 0.3, side).torque(position, velocity)
        clipped = Wall(10.0, 0.5, 0.3, side, clip).torque(position, velocity)
        assert clipped == max(-clip, min(clip, whole))


@given(number, number)
def test_below_is_above_in_the_mirror(position: float, velocity: float) -> None:
    above = Wall(7.0, 0.2, 0.5, "above").torque(position, velocity)
    below = Wall(7.0, 0.2, -0.5, "below").torque(-position, -velocity)
    assert above == -below


@pytest.mark.parametrize("side", ["above", "below", "both"])
def test_nan_comes_out_as_nan(side: Side) -> None:
    wall = Wall(10.0, 0.1, 0.0, side)
    assert math.isnan(wall.torque(math.nan, 0.0))
    assert math.isnan(Wall(10.0, 0.1, 0.0, side, 1.0).torque(math.nan, 0.0))
    inside = {"above": 1.0, "below": -1.0, "both": 1.0}[side]
    assert math.isnan(wall.torque(inside, math.nan))


def test_contact() -> None:
    assert Wall(1.0, 0.0, 2.0, "above").in_contact(2.1)
    assert not Wall(1.0, 0.0, 2.0, "above").in_contact(2.0)
    assert Wall(1.0, 0.0, 2.0, "below").in_contact(1.9)
    assert Wall(1.0, 0.0, 2.0, "both").in_contact(-99.0)
