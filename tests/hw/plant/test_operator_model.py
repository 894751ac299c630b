"""Scripted hands: continuous, periodic, and neither too weak nor too strong for the wall."""

from typing import Any

import pytest

from haptic_wall.hw.plant.operator_model import operator_of
from haptic_wall.hw.truth import HandName, TrueServo
from tests.typed import not_none

HANDS: list[HandName] = ["push", "tap", "lean"]
MS = 1_000_000


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
        held, until = hand.pull(now)
        assert until > now
        assert held.reference == pytest.approx(expected, abs=1e-12)
        halfway = (now + until) // 2
        between, same = hand.pull(halfway)
        assert (between.slope, same) == (held.slope, until)
        assert between.reference == pytest.approx(
            held.reference + held.slope * (halfway - now) * 1e-9, abs=1e-12
        )
        expected = held.reference + held.slope * (until - now) * 1e-9
        now = until


def test_leaning_pushes_with_a_steady_torque() -> None:
    for direction in (1, -1):
        hand = not_none(operator_of(servo("lean", hand_origin=0.3, hand_direction=direction)))
        held, _ = hand.pull(2_000 * MS)
        assert held.reference == pytest.approx(0.3 + direction * 0.5)
        assert held.slope == 0.0
