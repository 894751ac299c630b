"""A motion that the wall drives trips near the no-load speed; a hand's does not."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import pytest

from haptic_wall.controller.laws.wall import Wall
from haptic_wall.controller.runtime.checks import Safety, SafetyLimits, speed_limits
from haptic_wall.hw.servo import Facts

COUNT = math.tau / 4096
LIMIT = 3.85
"""0.8 of an XM430-W350's no-load speed [rad/s]"""
SERVO = SafetyLimits(
    max_speed=30.0,
    position_step=COUNT,
    max_loss=0.5,
    loss_window=100,
    max_silence_ns=10**9,
    period_ns=10**6,
    driven_speed=LIMIT,
    torque_limit=4.1,
    inertia=0.006,
    damping=0.004,
    coulomb=0.03,
)


def fed(
    safety: Safety,
    speeds: Sequence[float],
    torque: Callable[[float, float], float],
    wall: Wall,
    start: float = 0.0,
    period: float = 1e-3,
) -> float | None:
    """Instant of the trip [s], from mean speeds over each period; None: it does not."""
    x, t = start, 0.0

    def found(position: float, torque: float) -> bool:
        at_ns = 10**9 + round(t * 1e9)
        safety.good(position, at_ns, False)
        return safety.driven(torque, wall.in_contact(position), wall)

    found(x, 0.0)
    for speed in speeds:
        x, t = x + speed * period, t + period
        counted = round(x / COUNT) * COUNT
        if found(counted, torque(x, speed)):
            return t
    return None


def two_sided(stiffness: float = 0.0) -> Wall:
    return Wall(stiffness, 0.0, 0.0, "both")


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("period", [1e-3, 2e-3, 0.02, 1e-4])
def test_a_wall_that_drives_the_shaft_trips_once_that_has_lasted(sign: int, period: float) -> None:
    """No spring holds this energy."""
    speeds = [sign * 4.4] * round(0.2 / period)
    tripped = fed(Safety(SERVO), speeds, lambda _x, _v: sign * 2.0, two_sided(), period=period)
    assert tripped == pytest.approx(max(0.01, period), abs=0.002)


def test_the_slack_is_two_counts_over_the_whole_window() -> None:
    for speed, trips in ((LIMIT, False), (LIMIT + 0.2, False), (LIMIT + 0.5, True)):
        tripped = fed(Safety(SERVO), [speed] * 200, lambda _x, _v: 2.0, two_sided())
        assert (tripped is not None) is trips


@pytest.mark.parametrize("torque", [0.0, -2.0])
def test_a_hand_may_be_faster_where_the_torque_does_not_help_it(torque: float) -> None:
    assert fed(Safety(SERVO), [9.0] * 300, lambda _x, _v: torque, two_sided()) is None


def test_a_spring_may_give_back_what_it_has_taken() -> None:
    """Pushed in slowly by a hand, then let go: all of the speed is the hand's energy."""
    wall = Wall(8.0, 0.0, 0.0, "above")
    way_in = [0.5] * 600
    way_out = [-min(0.04 * k, 6.0) for k in range(300)]
    driven = Safety(SERVO)
    assert fed(driven, way_in + way_out, lambda x, _v: -8.0 * max(x, 0.0), wall) is None


def test_a_spring_that_comes_on_around_the_shaft_gives_what_it_has_not_taken() -> None:
    """Unless it is a kick that was meant."""
    speeds = [-min(0.2 * k, 6.0) for k in range(120)]
    wall = two_sided(8.0)
    for kicked in (False, True):
        limits = replace(SERVO, damping=0.0, coulomb=0.0, kicked=kicked)
        tripped = fed(Safety(limits), speeds, lambda x, _v: -8.0 * x, wall, start=0.5)
        assert (tripped is None) is kicked


def test_the_limits_come_from_the_no_load_speed_or_from_the_number() -> None:
    xm430 = Facts("XM430", 4096, 4.1, 0.005, no_load_speed=4.817)
    assert speed_limits(None, xm430, real=True) == pytest.approx((14.45, 3.854), rel=1e-3)
    assert speed_limits(None, xm430, real=False) == pytest.approx((30.0, 3.854), rel=1e-3)
    assert speed_limits(7.0, xm430, real=True) == (7.0, 7.0)
    unknown = Facts("simulated", 4096, 4.1, 0.005)
    assert speed_limits(None, unknown, real=False) == (30.0, math.inf)
