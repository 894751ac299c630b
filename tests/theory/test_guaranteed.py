"""Limits for a whole range of servos: closed-loop poles of many members as oracle."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np
import pytest

from haptic_wall.controller.theory import (
    critical_stiffness,
    linear_limit,
    max_virtual_damping,
    worst_member,
)
from haptic_wall.controller.theory.guaranteed import (
    cost_of_each_unknown,
    guaranteed_damping_ceiling,
    guaranteed_limit,
    is_stable_over,
)
from haptic_wall.controller.theory.ranges import Member, Ranges
from tests.theory.oracles import Loop, radius

# MX-64 as identified by Rhoban's bam, with the bounds of somebody who has not measured his own
MX_64 = Ranges((0.008, 0.016), (0.008, 0.017), (1e-3, 3e-3), (0.8, 1.2))
PERIOD = 1e-3


def random_ranges(random: np.random.Generator) -> tuple[Ranges, float, float, int]:
    """Ranges up to a factor of four wide, some of them known; virtual damping, period, N."""

    def wide(low: float) -> tuple[float, float]:
        return low, low * 10 ** random.uniform(0, random.choice([0, 0.1, 0.3, 0.6]))

    period = 10 ** random.uniform(-3.5, -2)
    inertia = 10 ** random.uniform(-3.5, 0)
    damping = 10 ** random.uniform(-4, -0.5) * inertia / period
    shortest = random.choice([0, random.uniform(0, 9)])
    longest = shortest + random.choice([0, 1, random.uniform(0, 4)])
    samples = int(random.choice([1, 1, 1, 2, 3, 8]))
    gain = wide(0.8)
    ceiling = float(max_virtual_damping(inertia, damping, period, longest * period, samples))
    ceiling /= gain[1]
    virtual = random.choice([0, -0.95 * damping / gain[1] * random.random(), ceiling])
    ranges = Ranges(wide(inertia), wide(damping), (shortest * period, longest * period), gain)
    return ranges, float(virtual * 0.9 * random.random()), period, samples


def loop(member: Member, stiffness: float, virtual: float, period: float, samples: int) -> Loop:
    gain = member.torque_gain
    return Loop(
        member.inertia,
        member.damping,
        gain * stiffness,
        gain * virtual,
        period,
        member.delay,
        samples,
    )


def members(ranges: Ranges, count: int, random: np.random.Generator) -> list[Member]:
    """Corners, edges and the inside: each value is at a bound in half of the members."""
    share = np.where(
        random.random((count, 4)) < 0.5,
        random.integers(0, 2, (count, 4)),
        random.random((count, 4)),
    )
    bounds = np.array([ranges.inertia, ranges.damping, ranges.delay, ranges.torque_gain])
    values = np.minimum(bounds[:, 0] + share * (bounds[:, 1] - bounds[:, 0]), bounds[:, 1])
    return [Member(*map(float, row)) for row in values]


def test_a_range_of_too_many_periods_is_not_claimed() -> None:
    ranges = Ranges(inertia=(0.01, 0.02), damping=(0.01, 0.02), delay=(0.0, 20.0))
    assert guaranteed_limit(ranges, 0.0, 1e-3).stiffness == 0


def test_every_member_is_stable_up_to_the_limit_and_the_worst_is_not_above_it(
    thorough: bool, wholly: bool
) -> None:
    random = np.random.default_rng(1)
    for _ in range(1000 if thorough else 15 if wholly else 4):
        ranges, virtual, period, samples = random_ranges(random)
        found = guaranteed_limit(ranges, virtual, period, samples)
        assert 0 < found.stiffness <= found.upper
        assert 1 - found.stiffness / found.upper < 0.0101
        for member in [found.worst, *members(ranges, 10, random)]:
            # the limit itself, and now and then a softer wall
            share = random.choice([1.0, 1.0, random.random()])
            softer = loop(member, share * found.stiffness, virtual, period, samples)
            assert radius(softer) < 1, member
        assert radius(loop(found.worst, 1.005 * found.upper, virtual, period, samples)) > 1


def test_the_least_safe_corner_is_not_always_the_worst() -> None:
    # An XL-320's inertia and damping, to 50 % each; the velocity over 16 samples, and virtual
    # damping that takes away half of the servo's own. The heavier servo has the lower limit.
    ranges = Ranges((0.00112 / 1.5, 0.00112 * 1.5), (0.0033 / 1.5, 0.0033 * 1.5), (0.0, 0.0))
    virtual, samples = -0.7 * ranges.damping[0], 16
    corner = Member(ranges.inertia[0], ranges.damping[0], 0.0)
    at_corner = float(
        critical_stiffness(corner.inertia, corner.damping, virtual, PERIOD, 0.0, samples)
    )
    asked = 0.95 * at_corner
    assert radius(loop(corner, asked, virtual, PERIOD, samples)) < 1

    verdict = is_stable_over(ranges, asked, virtual, PERIOD, samples)
    assert not verdict.proved
    assert verdict.counterexample is not None
    assert verdict.counterexample.inertia > corner.inertia
    assert radius(loop(verdict.counterexample, asked, virtual, PERIOD, samples)) > 1

    found = guaranteed_limit(ranges, virtual, PERIOD, samples)
    assert found.stiffness < 0.9 * at_corner
    assert is_stable_over(ranges, found.stiffness, virtual, PERIOD, samples).proved


def test_no_stiffness_is_claimed_where_none_is_stable() -> None:
    ceiling = guaranteed_damping_ceiling(MX_64, PERIOD)
    above = guaranteed_limit(MX_64, 1.01 * ceiling.upper, PERIOD)
    assert (above.stiffness, above.upper) == (0.0, 0.0)
    undamped = guaranteed_limit(MX_64, -MX_64.damping[0] / MX_64.torque_gain[1], PERIOD)
    assert (undamped.stiffness, undamped.upper) == (0.0, 0.0)


def test_below_the_damping_ceiling_every_member_is_stable_with_a_soft_wall() -> None:
    random = np.random.default_rng(3)
    for ranges, samples in ((MX_64, 1), (MX_64, 4)):
        ceiling = guaranteed_damping_ceiling(ranges, PERIOD, samples)
        assert 1 - ceiling.virtual_damping / ceiling.upper < 0.0101
        soft = 1e-3 * ceiling.virtual_damping
        for member in members(ranges, 50, random):
            assert radius(loop(member, soft, ceiling.virtual_damping, PERIOD, samples)) < 1
        above = 1.001 * ceiling.upper
        for stiffness in (1e-6 * soft, soft):
            assert radius(loop(ceiling.worst, stiffness, above, PERIOD, samples)) > 1


def test_out_of_boxes_less_is_proved_never_more(monkeypatch: pytest.MonkeyPatch) -> None:
    full = guaranteed_limit(MX_64, 0.1, PERIOD)
    monkeypatch.setattr(worst_member, "_BUDGET", full.boxes // 2)
    less = guaranteed_limit(MX_64, 0.1, PERIOD)
    assert 0 <= less.stiffness < full.stiffness
    assert less.upper == full.upper
    verdict = is_stable_over(MX_64, full.stiffness, 0.1, PERIOD)
    assert not verdict.proved
    assert verdict.counterexample is None


def test_with_the_linear_limit_the_guards_corner_is_the_guaranteed_limit(
    thorough: bool, wholly: bool
) -> None:
    # The guard takes the smaller of the linear and the exact limit at the least safe corner. The
    # exact one alone can be above the limit of a heavier member by 15 %.
    random = np.random.default_rng(7)
    for _ in range(200 if thorough else 12 if wholly else 3):
        ranges, virtual, period, samples = random_ranges(random)
        gain = ranges.torque_gain[1]
        corner = ranges.damping[0], gain * virtual, period, ranges.delay[1], samples
        exact = critical_stiffness(ranges.inertia[0], *corner) / gain
        linear = linear_limit(*corner) / gain
        found = guaranteed_limit(ranges, virtual, period, samples)
        # 1e-3 is the gap between what is proved and what is unstable
        assert min(float(exact), float(linear)) <= found.stiffness * 1.0015


@pytest.mark.parametrize(
    ("field", "bounds", "message"),
    [
        ("inertia", (0.02, 0.01), "inertia must have low <= high"),
        ("inertia", (0.0, 0.01), "inertia must be > 0"),
        ("damping", (0.0, 0.01), "damping must be > 0"),
        ("delay", (-1e-3, 1e-3), "delay must be >= 0"),
        ("torque_gain", (1.0,), "torque_gain must be a pair"),
    ],
)
def test_ranges_that_make_no_sense_name_the_argument(
    field: str, bounds: tuple[float, ...], message: str
) -> None:
    good = Ranges(inertia=(0.01, 0.02), damping=(0.01, 0.02), delay=(0.0, 1e-3))
    with pytest.raises(ValueError, match=message):
        replace(good, **{field: cast(tuple[float, float], bounds)})


def test_other_arguments_out_of_their_domain_are_named() -> None:
    with pytest.raises(ValueError, match="stiffness must be > 0"):
        is_stable_over(MX_64, 0.0, 0.1, PERIOD)
    with pytest.raises(ValueError, match="virtual_damping must be one number"):
        guaranteed_limit(MX_64, cast(float, [0.0, 0.1]), PERIOD)
    with pytest.raises(ValueError, match="tolerance must be between 0 and 1"):
        guaranteed_limit(MX_64, 0.1, PERIOD, tolerance=0.0)
    with pytest.raises(ValueError, match=r"inertia must be within 0\.008 to 0\.016, got 1"):
        cost_of_each_unknown(MX_64, Member(1.0, 0.011692, 2e-3), 0.1, PERIOD)
