"""Scripted hands: continuous, periodic, and neither too weak nor too strong for the wall."""

from typing import Any

import pytest

from haptic_wall.hw.plant.mechanism import Mechanism
from haptic_wall.hw.plant.operator_model import LEAD_IN_S, SCRIPTS, operator_of
from haptic_wall.hw.truth import HandName, TrueServo
from tests.typed import not_none

HANDS: list[HandName] = ["push", "tap", "lean"]
MS = 1_000_000
WALL_STIFFNESS = 15.0


def servo(hand: HandName, **settings: Any) -> TrueServo:
    return TrueServo(inertia=0.012, damping=0.012, coulomb=0.1, hand=hand, **settings)


def test_nobody_touches_it_by_default() -> None:
    assert operator_of(TrueServo(inertia=0.012)) is None


@pytest.mark.parametrize("name", HANDS)
def test_it_starts_where_the_servo_stands_and_never_jumps(name: HandName) -> None:
    hand = not_none(operator_of(servo(name, position=0.2, hand_origin=0.1)))
    now = 0
    expected = 0.2
    while now < 10_000 * MS:
        stretch = hand.pull(now)
        assert stretch.until_ns > now
        assert stretch.reference == pytest.approx(expected, abs=1e-12)
        halfway = (now + stretch.until_ns) // 2
        between = hand.pull(halfway)
        assert between.slope == stretch.slope
        assert between.until_ns == stretch.until_ns
        assert between.reference == pytest.approx(
            stretch.reference + stretch.slope * (halfway - now) * 1e-9, abs=1e-12
        )
        expected = stretch.reference + stretch.slope * (stretch.until_ns - now) * 1e-9
        now = stretch.until_ns


@pytest.mark.parametrize("name", HANDS)
def test_from_turns_away_it_comes_no_faster_than_a_hand_turns_a_horn(name: HandName) -> None:
    stretch = not_none(operator_of(servo(name, position=18.8))).pull(0)
    assert stretch.slope == pytest.approx(-2.0)
    reached = stretch.reference + stretch.slope * stretch.until_ns * 1e-9
    assert reached == pytest.approx(SCRIPTS[name].depths[0])


@pytest.mark.parametrize("name", HANDS)
def test_it_repeats_after_its_lead_in(name: HandName) -> None:
    hand = not_none(operator_of(servo(name)))
    period = round(SCRIPTS[name].times_s[-1] * 1e9)
    lead_in = round(LEAD_IN_S * 1e9)
    for since in range(0, period, 37 * MS):
        once, again = hand.pull(lead_in + since), hand.pull(lead_in + since + 3 * period)
        assert again.reference == once.reference
        assert again.slope == once.slope
        assert again.until_ns == once.until_ns + 3 * period


@pytest.mark.parametrize("name", ["push", "tap"])
def test_a_wall_on_the_other_side_is_touched_from_the_other_side(name: HandName) -> None:
    above = not_none(operator_of(servo(name, hand_origin=0.0)))
    below = not_none(operator_of(servo(name, hand_origin=0.0, hand_direction=-1)))
    for now in range(0, 6_000 * MS, 61 * MS):
        assert below.pull(now).reference == pytest.approx(-above.pull(now).reference)


def test_leaning_pushes_in_the_positive_direction_whatever_the_side() -> None:
    for direction in (1, -1):
        hand = not_none(operator_of(servo("lean", hand_origin=0.3, hand_direction=direction)))
        assert hand.pull(2_000 * MS).reference == pytest.approx(0.8)
        assert hand.pull(2_000 * MS).slope == 0.0


def press(
    name: HandName, side: int = 1, duration_ms: int = 9000
) -> tuple[list[float], list[float]]:
    """Depth [rad] and torque [N·m] at every millisecond against a wall of 15 N·m/rad."""
    mechanism = Mechanism(servo(name, hand_direction=side, torque_limit=100.0), 0)
    depths, torques = [], []
    for now in range(duration_ms):
        mechanism.advance(now * MS)
        depth = side * mechanism.position
        torque = -side * WALL_STIFFNESS * max(0.0, depth)
        mechanism.command(torque, now * MS)
        depths.append(depth)
        torques.append(abs(torque))
    return depths, torques


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("name", ["push", "tap"])
def test_it_goes_visibly_in_and_fully_out_far_from_saturation(name: HandName, side: int) -> None:
    depths, torques = press(name, side)
    assert min(depths) < -0.1
    assert 0.05 < max(depths) < 0.2
    assert max(torques) < 0.75 * 4.1


def test_leaning_rests_visibly_inside_the_wall() -> None:
    depths, _ = press("lean")
    rest = depths[-1000:]
    assert min(rest) > 0.05
    assert max(rest) < 0.2
    assert max(rest) - min(rest) < 0.01
