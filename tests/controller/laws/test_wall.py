"""The wall pushes out, never pulls where it must not, and hides no NaN."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_wall.controller.laws.wall import Derating, Side, Wall, held_torque

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


share = st.sampled_from([1 / 4, 1 / 16, 1 / 64])


def softer(side: Side, load: float, reach: float, scale: float, limit: float = 4.0) -> Wall:
    """A wall with 10 N·m/rad at 0 that holds a load."""
    wall = Wall(10.0, 0.0, 0.0, side)
    wall.derating = Derating(scale, 1.0, scale * limit, math.inf, load, reach)
    return wall


@given(st.floats(0.0, 3.0), st.floats(0.0, 2.0), share)
def test_a_softer_wall_has_its_whole_limit_deeper_than_the_motion(
    depth: float, soft_to: float, scale: float
) -> None:
    """With a limit of 4 N·m the whole spring saturates 0.4 rad deep."""
    wall = softer("both", 0.0, 0.0, scale)
    wall.derating.soft_to = soft_to
    torque = -wall.torque(depth, 0.0)
    assert torque == wall.torque(-depth, 0.0)
    if depth <= max(soft_to, 0.4):
        assert torque == pytest.approx(scale * min(10.0 * depth, 4.0))
    else:
        rise = 10.0 * scale * (depth - max(soft_to, 0.4))
        assert torque == pytest.approx(scale * 4.0 + rise), "the softer spring goes on"


@given(st.floats(0.01, 0.38), share, st.sampled_from([1.0, -1.0]))
def test_a_load_stays_where_it_is_on_a_softer_wall(depth: float, scale: float, side: float) -> None:
    load = -10.0 * depth * side
    for reach in (0.0, 0.5 * depth * side):
        wall = softer("both", load, reach, scale)
        assert wall.torque(depth * side, 0.0) == pytest.approx(load)
        deeper = wall.torque((depth + 0.01) * side, 0.0)
        assert deeper == pytest.approx(load - 0.1 * scale * side), "softer about the load"


@given(st.floats(-1, 1), st.floats(-1, 1), st.floats(-4, 4), share, st.floats(0, 20))
def test_what_holds_a_load_makes_no_wall_stiffer_than_the_whole_one(
    away: float, reach: float, load: float, scale: float, stiffness: float
) -> None:
    def torque(position: float) -> float:
        return held_torque(load, reach, position, stiffness, scale)

    rise = torque(away) - torque(away + 1e-3)
    assert -1e-9 <= rise <= (1.0 - scale) * stiffness * 1e-3 + 1e-9
    assert abs(torque(away)) <= (1.0 - scale) * abs(load)


@given(st.floats(-2, 2), st.floats(-4, 4), share)
def test_a_load_that_is_held_is_within_the_torque_limit(
    position: float, load: float, scale: float
) -> None:
    assert abs(softer("both", load, 0.0, scale).torque(position, 0.0)) <= 4.0 + 1e-9


@given(st.floats(-1, 1), st.floats(-4, 4), st.floats(-10, 10))
def test_a_one_sided_wall_that_holds_a_load_never_pulls_and_is_nothing_outside(
    position: float, load: float, velocity: float
) -> None:
    torque = softer("above", load, 0.0, 0.25).torque(position, velocity)
    assert torque <= 0.0
    assert position > 0.0 or torque == 0.0


def test_contact() -> None:
    assert Wall(1.0, 0.0, 2.0, "above").in_contact(2.1)
    assert not Wall(1.0, 0.0, 2.0, "above").in_contact(2.0)
    assert Wall(1.0, 0.0, 2.0, "below").in_contact(1.9)
    assert Wall(1.0, 0.0, 2.0, "both").in_contact(-99.0)
