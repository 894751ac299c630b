"""One owner of the commanded stiffness: along a ramp down, at once and only at rest up."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple, cast

import pytest

from haptic_wall.controller.guard.schedule import RUN, GainSchedule
from haptic_wall.controller.guard.types import Decision
from haptic_wall.controller.laws.wall import Wall
from haptic_wall.controller.runtime.gains import Gains

PERIOD_NS = 1_000_000
AGES = [0, 100_000, 200_000]
RAMP = 30


class Allowed(NamedTuple):
    stiffness: float
    damping: float
    delay: float = 0.0


def gains(*allowed: tuple[Any, ...], window: int = 100) -> tuple[Gains, Wall]:
    wall = Wall(0.0, 0.0, 0.0, "both", clip=2.0)
    decisions = [Allowed(*each) for each in allowed]
    schedule = GainSchedule(
        [cast(Sequence[Decision], decisions)], AGES[: len(allowed)], [PERIOD_NS], 90.0, window
    )
    return Gains(schedule, wall, RAMP, 5.0), wall


def follow(made: Gains, ticks: int, age_ns: int = 0, may_raise: bool = True) -> int:
    return sum(made.follow(age_ns, PERIOD_NS, may_raise) for _ in range(ticks))


def test_nothing_is_commanded_before_it_begins() -> None:
    made, wall = gains((40.0, 0.1))
    follow(made, 5)
    assert (wall.stiffness, wall.damping, made.in_force) == (0.0, 0.0, False)
    assert made.coming == 40.0
    made.begin()
    assert (wall.stiffness, wall.damping) == (40.0, 0.1)


def test_stiffness_and_damping_go_down_together_over_the_ramp() -> None:
    made, wall = gains((40.0, 0.2), (20.0, 0.1))
    made.begin()
    ratios = []
    for _ in range(60):
        follow(made, 1, AGES[1], may_raise=False)
        ratios.append(wall.damping / wall.stiffness)
    assert (wall.stiffness, wall.damping) == (20.0, 0.1)
    assert ratios == pytest.approx([0.005] * 60), "along the ray"


def test_a_second_reason_makes_no_fall_slower_that_is_under_way() -> None:
    made, wall = gains((40.0, 0.2), (10.0, 0.1), (8.0, 0.1))
    made.begin()
    while wall.stiffness == 40.0:
        follow(made, 1, AGES[1])
    steps, last = [40.0 - wall.stiffness], wall.stiffness
    while wall.stiffness > 8.0:
        follow(made, 1, AGES[2])
        steps.append(last - wall.stiffness)
        last = wall.stiffness
    assert len(steps) > RUN, "the second reason came while the stiffness fell"
    assert min(steps) >= steps[0] * (1.0 - 1e-9)


def test_stiffness_rises_at_once_but_only_where_it_may() -> None:
    made, wall = gains((40.0, 0.2), (20.0, 0.1), window=20)
    made.begin()
    follow(made, 60, AGES[1])
    assert wall.stiffness == 20.0
    follow(made, 400, 0, may_raise=False)
    assert wall.stiffness == 20.0, "the spring is loaded"
    follow(made, 1, 0)
    assert wall.stiffness == 40.0


def test_a_longer_delay_that_allows_more_waits_for_a_moment_at_rest() -> None:
    made, wall = gains((20.0, 0.2), (40.0, 0.1))
    made.begin()
    follow(made, 60, AGES[1], may_raise=False)
    assert (wall.stiffness, wall.damping) == (20.0, 0.1), "less damping at once, more K later"
    follow(made, 2, AGES[1])
    assert (wall.stiffness, wall.damping) == (40.0, 0.1)


def test_a_scale_lowers_the_springs_largest_torque_too() -> None:
    made, wall = gains((40.0, 0.2))
    made.begin()
    made.scale(0.25, 1.0, 0.0, 0.0, 0.0)
    assert (wall.scale, wall.damping_scale) == (0.25, 1.0)
    assert wall.elastic_limit == 0.25 * 2.0, "of the clip, which is below the servo's limit"
    assert wall.stiffness == 40.0


def test_the_largest_rise_is_to_the_stiffest_of_all_decisions() -> None:
    made, _ = gains((20.0, 0.2), (40.0, 0.1))
    made.begin()
    assert made.largest_rise == 20.0


def test_a_law_of_its_own_gains_is_left_alone() -> None:
    made, wall = gains((40.0, 0.2), (20.0, 0.1))
    wall.guarded = False
    made.begin()
    follow(made, 60, AGES[1])
    assert (wall.stiffness, wall.damping) == (0.0, 0.0)
    assert not math.isinf(made.stiffness)
