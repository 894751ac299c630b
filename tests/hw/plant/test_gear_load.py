"""Friction of a gear under load: its corners, and the instant at which a growing hand wins."""

from __future__ import annotations

import math

import numpy as np
import pytest

from haptic_wall.hw.plant.gear_load import GearLoad

M3 = GearLoad(0.1, 0.1, 0.0, 0.0, 0.0, 0.0)
M6 = GearLoad(0.3, 0.02, 0.2, 0.1, 0.04, 0.05)


def test_a_motor_that_holds_a_weight_loads_the_gear_from_both_sides() -> None:
    assert M3.in_motion(0.5, -0.5) == pytest.approx(0.1)
    assert M3.in_motion(0.5, 0.5) == 0.0
    assert M3.at_rest(0.5, -0.5) == 0.0
    assert not M3.fades
    assert M6.fades


@pytest.mark.parametrize(
    ("motor", "external", "square"),
    [
        (1.0, -0.5, 0.05 * 0.25),  # the motor drives
        (0.5, -1.0, 0.04 * 0.25),  # the load drives
        (1.0, 0.5, 0.0),  # they push together
        (1.0, -1.0, 0.0),
    ],
)
def test_the_squares_count_while_the_sides_oppose_each_other(
    motor: float, external: float, square: float
) -> None:
    shares = abs(0.2 * motor - 0.1 * external)
    assert M6.at_rest(motor, external) == pytest.approx(shares + square)
    assert M6.in_motion(motor, external) == pytest.approx(abs(0.3 * motor - 0.02 * external))


def friction(load: GearLoad, motor: float, external: float) -> float:
    return load.in_motion(motor, external) + load.at_rest(motor, external)


def test_the_slope_is_that_of_the_friction_at_rest() -> None:
    random = np.random.default_rng(1)
    for motor, external in random.normal(size=(200, 2)).tolist():
        higher, lower = (friction(M6, motor, external + step) for step in (1e-7, -1e-7))
        assert M6.slope(motor, external) == pytest.approx((higher - lower) / 2e-7, abs=1e-5)


STATIC = 0.1


def missing(load: GearLoad, motor: float, external: float, direction: float) -> float:
    """Torque that is missing until it breaks away in this direction [N·m]."""
    return STATIC + friction(load, motor, external) - direction * (motor + external)


def test_a_hand_breaks_it_away_where_the_friction_is_first_exceeded(thorough: bool) -> None:
    random = np.random.default_rng(3)
    tried, left = np.linspace(0.0, 1.5, 4000).tolist(), 0
    for _ in range(2000 if thorough else 200):
        shares = (random.uniform(0.0, 0.45, 4) * (random.random(4) < 0.7)).tolist()
        load = GearLoad(*shares, *random.uniform(0.0, 0.5, 2).tolist())
        motor, external = random.normal(0.0, 0.4, 2).tolist()
        direction = math.copysign(1.0, random.normal())
        if min(missing(load, motor, external, side) for side in (1.0, -1.0)) < 0.0:
            continue  # it does not stick
        grown = load.until_breakaway(motor + external, STATIC, motor, external, direction, 1.5)
        short = (missing(load, motor, external + direction * g, direction) for g in tried)
        first = next((g for g, value in zip(tried, short, strict=True) if value < 0.0), math.inf)
        if math.isinf(first):
            assert math.isinf(grown)
            continue
        left += 1
        assert grown == pytest.approx(first, abs=1.1 * 1.5 / 4000)
        assert missing(load, motor, external + direction * (grown + 1e-9), direction) < 1e-8
    assert left > 50
