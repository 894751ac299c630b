"""One owner of the commanded stiffness: along a ramp down, at once and only at rest up."""

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from haptic_wall.controller.guard.schedule import RUN, Allowed, GainSchedule, GainTable
from haptic_wall.controller.laws.wall import Wall
from haptic_wall.controller.runtime.gains import Gains
from haptic_wall.controller.theory.boundary import chain_boundary, chain_ceiling
from haptic_wall.controller.theory.chain import sampled, two_masses
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.controller.theory.crossings import Loops, poles

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


@pytest.mark.parametrize("encoder", ["output", "motor"])
def test_no_pair_on_the_way_to_lower_gains_is_unstable(encoder: str) -> None:
    """Two masses: the delay grows a little, and less damping is allowed, as of late ticks."""
    random = np.random.default_rng(11)
    n, period = 150, 1e-3
    load = random.uniform(0.001, 0.008, n)
    motor, rate = 0.012 - load, math.tau * random.uniform(10.0, 120.0, n)
    moving = motor * load / 0.012
    ratio = random.uniform(0.005, 0.1, n)
    servo = (motor, 0.012, load, moving * rate**2, 2.0 * ratio * moving * rate)
    damping, pairs = random.uniform(0.02, 0.3, n), []
    for delay, share in ((2.1e-3, 0.7), (2.5e-3, 0.2)):
        ceiling = chain_ceiling(*two_masses(*servo, encoder=encoder), period, delay)
        damping = np.minimum(damping * share / 0.7, share * ceiling)
        limit = chain_boundary(
            *two_masses(*servo, encoder=encoder), damping, period, delay
        ).stiffness
        pairs.append((0.8 * limit, damping, ceiling))
    chain, _ = two_masses(*servo, encoder=encoder)
    periods = np.full(n, period)
    loops = Loops(sampled(chain, periods, np.full(n, 0.5)), periods, np.full(n, 2), 1)
    walks = []
    for k0, b0, c0, k1, b1, c1 in np.stack([*pairs[0], *pairs[1]], axis=1).tolist():
        made, wall = gains((k0, b0, c0), (k1, b1, c1))
        made.begin()
        walk = []
        for _ in range(RUN + 2 * RAMP):
            follow(made, 1, AGES[1], may_raise=False)
            walk.append((wall.stiffness, wall.damping))
        walks.append(walk)
    ways = np.array(walks)[:, ::4]

    def unstable(k: FloatArray, b: FloatArray) -> NDArray[np.bool_]:
        found: NDArray[np.bool_] = np.abs(poles(loops, k, b)).max(axis=1) > 1.0 + 1e-9
        return found

    inside = ~unstable(ways[:, 0, 0], ways[:, 0, 1]) & (ways[:, -1, 0] < ways[:, 0, 0])
    assert inside.sum() > 20
    for at in range(ways.shape[1]):
        assert not np.any(inside & unstable(ways[:, at, 0], ways[:, at, 1]))
    # with the damping first some would be
    assert np.any(inside & unstable(ways[:, 0, 0], ways[:, -1, 1]))
