"""One owner of the commanded stiffness: along a ramp down, at once and only at rest up."""

from typing import Any

import pytest

from haptic_wall.controller.guard.schedule import RUN, Allowed, GainSchedule, GainTable
from haptic_wall.controller.laws.wall import Wall
from haptic_wall.controller.runtime.gains import Gains

PERIOD_NS = 1_000_000
AGES = [0, 100_000, 200_000]
RAMP = 30


def gains(*allowed: tuple[Any, ...], window: int = 100) -> tuple[Gains, Wall]:
    wall = Wall(0.0, 0.0, 0.0, "both", clip=2.0)
    table = GainTable(
        Allowed(stiffness, damping, 0.0, *ceiling) for stiffness, damping, *ceiling in allowed
    )
    schedule = GainSchedule(table, AGES[: len(allowed)], [PERIOD_NS], 90.0, window)
    return Gains(schedule, wall, RAMP), wall


def follow(made: Gains, ticks: int, age_ns: int = 0, may_raise: bool = True) -> int:
    return sum(made.follow(age_ns, PERIOD_NS, may_raise) for _ in range(ticks))


def test_the_stiffness_goes_down_before_the_damping() -> None:
    made, wall = gains((40.0, 0.2), (20.0, 0.1, 0.25))
    made.begin()
    pairs = []
    for _ in range(RUN + 2 * RAMP):
        follow(made, 1, AGES[1], may_raise=False)
        pairs.append((wall.stiffness, wall.damping))
    assert pairs[-1] == (20.0, 0.1)
    assert all(k == 20.0 or b == 0.2 for k, b in pairs)
    assert len({k for k, _ in pairs}) == len({b for _, b in pairs}) == RAMP + 1


def test_a_damping_above_its_new_ceiling_goes_down_with_the_stiffness() -> None:
    made, wall = gains((40.0, 0.2), (20.0, 0.1, 0.15))
    made.begin()
    ratios = []
    for _ in range(60):
        follow(made, 1, AGES[1], may_raise=False)
        ratios.append(wall.damping / wall.stiffness)
    assert (wall.stiffness, wall.damping) == (20.0, 0.1)
    assert ratios == pytest.approx([0.005] * 60), "along the ray"


def test_stiffness_rises_at_once_but_only_where_it_may() -> None:
    made, wall = gains((40.0, 0.2), (20.0, 0.1), window=20)
    made.begin()
    follow(made, 60, AGES[1])
    assert wall.stiffness == 20.0
    follow(made, 400, 0, may_raise=False)
    assert wall.stiffness == 20.0, "the spring is loaded"
    follow(made, 1, 0)
    assert wall.stiffness == 40.0


def test_a_stiffness_lowered_for_a_change_returns_where_the_change_is_withdrawn() -> None:
    made, wall = gains((40.0, 0.2))
    made.begin()
    made.lower(10.0)
    follow(made, 2 * RAMP, may_raise=False)
    assert wall.stiffness == 10.0
    made.release()
    follow(made, 2 * RAMP, may_raise=False)
    assert wall.stiffness == 10.0, "not in contact"
    follow(made, 2 * RAMP)
    assert wall.stiffness == 40.0


def test_a_longer_delay_that_allows_more_waits_for_a_moment_at_rest() -> None:
    made, wall = gains((20.0, 0.2), (40.0, 0.1))
    made.begin()
    follow(made, 60, AGES[1], may_raise=False)
    assert (wall.stiffness, wall.damping) == (20.0, 0.1), "less damping at once, more K later"
    follow(made, 2, AGES[1])
    assert (wall.stiffness, wall.damping) == (40.0, 0.1)
