"""The bins follow ages and intervals: down at once on a run, up only slowly and untouched."""

import itertools
import math
from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from haptic_wall.controller.guard.bins import Bins
from haptic_wall.controller.guard.schedule import (
    INTERVAL_BINS,
    RAISE_WINDOWS,
    RUN,
    Allowed,
    GainSchedule,
    GainTable,
    age_bins_ns,
    interval_bins_ns,
)
from haptic_wall.controller.guard.types import GuardSettings, Request, Situation
from haptic_wall.controller.laws.delay import DelayRing
from tests.support.beliefs import belief

AGES = [0, 100_000, 200_000, 400_000, 800_000]
WINDOW = 100
PERIOD = 1_000_000
NO_WALL = Allowed(0.0, 0.0)


def of_ages() -> GainSchedule:
    gains = [Allowed(100.0 / (1 + age / 1e5), 0.0, age * 1e-9) for age in AGES]
    return GainSchedule(GainTable([*gains, NO_WALL]), AGES, [PERIOD], 90.0, WINDOW)


def aged(
    subject: GainSchedule,
    ticks: int,
    age: int,
    may_raise: bool = False,
    every: int = 1,
    usual: int = 50_000,
) -> list[bool]:
    """Show an age in one tick of ``every``, else the usual one; in which ticks a bin changed."""
    ages = [age if k % every == 0 else usual for k in range(ticks)]
    return [subject.observe(each, PERIOD, may_raise) for each in ages]


@pytest.mark.parametrize(("every", "covered"), [(20, 100_000), (5, 800_000)])
def test_the_percentile_is_covered_and_not_the_worst(every: int, covered: int) -> None:
    subject = of_ages()
    aged(subject, WINDOW, 700_000, may_raise=True, every=every)
    assert subject.allowed.delay == covered * 1e-9


def test_a_run_of_high_ages_lowers_at_once() -> None:
    subject = of_ages()
    assert aged(subject, RUN, 350_000) == [False] * (RUN - 1) + [True]
    assert subject.allowed.delay == 400_000 * 1e-9


def test_a_hiccup_does_not_lower() -> None:
    changed = aged(of_ages(), WINDOW * 3, 800_000, may_raise=True, every=60, usual=0)
    assert not any(changed)


def test_raised_only_after_whole_windows_and_out_of_contact() -> None:
    subject = of_ages()
    aged(subject, RUN, 800_000, may_raise=True)
    assert subject.allowed.delay == 800_000 * 1e-9
    assert not any(aged(subject, (RAISE_WINDOWS + 2) * WINDOW, 50_000)), "never while touched"
    assert aged(subject, 1, 50_000, may_raise=True) == [True]
    assert subject.allowed.delay == 100_000 * 1e-9
    subject = of_ages()
    aged(subject, RUN, 800_000, may_raise=True)
    early = aged(subject, (RAISE_WINDOWS + 1) * WINDOW, 0, may_raise=True)
    assert early.index(True) >= (RAISE_WINDOWS - 1) * WINDOW


def test_a_pending_raise_does_not_survive_a_run_that_lowers() -> None:
    subject = of_ages()
    aged(subject, RUN, 350_000)
    aged(subject, (RAISE_WINDOWS + 2) * WINDOW, 50_000)
    aged(subject, RUN, 800_000)
    assert subject.allowed.delay == 800_000 * 1e-9
    quick = aged(subject, (RAISE_WINDOWS - 1) * WINDOW, 50_000, may_raise=True)
    assert not any(quick), "five whole windows after the lowering, untouched or not"


@pytest.mark.parametrize("period_ns", [500_000, 1_000_000, 10_000_000, 20_000_000])
def test_the_real_bins_reach_beyond_a_pipelined_sample_and_a_loss(period_ns: int) -> None:
    ages = age_bins_ns(period_ns)
    assert ages == sorted(set(ages))
    assert ages[-1] >= 3 * period_ns
    assert len(ages) < 130, "each costs the start some milliseconds"


def test_beyond_the_last_age_and_the_last_interval_there_is_no_wall() -> None:
    subject = of_ages()
    aged(subject, RUN, AGES[-1] + 1)
    assert subject.allowed == NO_WALL
    of_intervals = intervals()
    for pattern in ([1.0] * 34 + [16.0], [1000.0]):
        shown(of_intervals, pattern, 7000)
        assert of_intervals.allowed == NO_WALL
    shown(of_intervals, [1.0], (RAISE_WINDOWS + 2) * 1000)
    assert of_intervals.allowed.stiffness == 100.0


def test_a_handful_of_ages_is_no_reason_for_a_stiffer_bin() -> None:
    subject = of_ages()
    aged(subject, WINDOW, 350_000)
    aged(subject, 1, 0)
    subject.settle()
    assert subject.allowed.delay == 400_000 * 1e-9


# The served interval


def intervals() -> GainSchedule:
    table = GainTable([*(Allowed(100.0 / k, 0.0) for k in INTERVAL_BINS), NO_WALL])
    return GainSchedule(table, [0], interval_bins_ns(PERIOD), 90.0, 1000, 50)


def shown(
    subject: GainSchedule,
    pattern: Sequence[float] | NDArray[np.float64],
    periods: int,
    may_raise: bool = True,
) -> list[float]:
    """Show a repeated pattern of intervals [periods] for a while; when bins changed [periods]."""
    passed = 0.0
    changes: list[float] = []
    for each in itertools.cycle(pattern):
        if passed >= periods:
            return changes
        passed += each
        if subject.observe(0, round(each * PERIOD), may_raise):
            changes.append(passed)
    return changes


@pytest.mark.parametrize(
    ("pattern", "counted"),
    [
        ([1.0], 1.0),
        ([0.85, 1.15], 1.0),
        ([1.5], 1.5),
        ([1.0, 2.0], 2.0),
        ([2.0], 2.0),
        ([1.0] * 22 + [3.0], 1.5),
        ([1.0] * 486 + [15.0], 2.0),  # in a tenth of the blocks
        ([0.5, 1.5], 1.25),
    ],
)
def test_the_interval_that_counts_is_weighted_by_its_time(
    pattern: list[float], counted: float
) -> None:
    subject = intervals()
    shown(subject, pattern, 7000)
    assert subject.allowed.stiffness == 100.0 / counted


def test_a_longer_interval_lowers_within_two_blocks() -> None:
    subject = intervals()
    assert shown(subject, [1.0], 2000) == []
    (changed,) = shown(subject, [1.5], 2000)
    assert changed <= 2 * 50 + 2 * 1.5


def test_the_interval_is_raised_after_windows_that_allow_it_and_only_at_rest() -> None:
    subject = intervals()
    shown(subject, [2.0], 500)
    assert shown(subject, [1.0], 9000, may_raise=False) == []
    assert subject.allowed.stiffness == 50.0
    assert len(shown(subject, [1.0], 10)) == 1
    assert subject.allowed.stiffness == 100.0


@pytest.mark.parametrize("stall", [2.0, 8.0, 19.0])
def test_one_short_stall_in_five_windows_changes_nothing(stall: float) -> None:
    subject = intervals()
    assert shown(subject, [1.0] * 6000 + [stall], 40_000) == []


@pytest.mark.parametrize("stall", [40.0, 400.0])
def test_a_long_stall_softens_for_some_seconds_and_not_for_ever(stall: float) -> None:
    subject = intervals()
    shown(subject, [1.0] * 3000 + [stall], 3000 + round(stall))
    shown(subject, [1.0], 100)
    assert subject.allowed.stiffness < 100.0
    shown(subject, [1.0], (RAISE_WINDOWS + 2) * 1000)
    assert subject.allowed.stiffness == 100.0


@pytest.mark.parametrize("stall", [16.0, 60.0])
def test_stalls_that_come_again_keep_one_bin(stall: float) -> None:
    subject = intervals()
    shown(subject, [1.0] * 500 + [stall], 20_000)
    assert len(shown(subject, [1.0] * 500 + [stall], 40_000)) == 0


@pytest.mark.parametrize("before", [0, 45, 345])
def test_one_stall_in_the_warm_up_changes_nothing(before: int) -> None:
    """It makes its block longer, so that the half second holds fewer than ten of them."""
    subject = intervals()
    shown(subject, [1.0] * before + [30.0] + [1.0] * (470 - before), 500)
    subject.settle()
    assert subject.allowed.stiffness == 100.0


def test_both_bins_count_at_once() -> None:
    table = GainTable([*(Allowed(10.0 * a / k, 0.0, a) for k in (1, 2) for a in (2, 1)), NO_WALL])
    subject = GainSchedule(table, [0, 500_000], [PERIOD, 2 * PERIOD], 90.0, 1000, 50)
    for _ in range(200):
        subject.observe(400_000, 2 * PERIOD, may_raise=False)
    assert subject.allowed == table.at(3) == (5.0, 0.0, 1.0, math.inf, 0.0)
    assert subject.index == 3


@pytest.mark.parametrize("seed", range(20))
def test_in_the_long_run_no_interval_counts_as_shorter_than_it_is(seed: int) -> None:
    """Whatever mixture of intervals is served, as long as it is the same in each block."""
    random = np.random.default_rng(seed)
    kinds = random.choice([1.0, 1.2, 1.5, 2.0, 3.0, 5.0], 3, replace=False)
    pattern = random.choice(kinds, 10)
    subject = intervals()
    shown(subject, pattern, 7000)
    true = (pattern**2).sum() / pattern.sum()
    counted = INTERVAL_BINS[min(subject.index, len(INTERVAL_BINS) - 1)]
    worst = 2 * true - pattern.mean()
    assert counted * 1.06 >= worst, "5 % within a bin, and a stall that is not counted"
    above = [each for each in INTERVAL_BINS if 1.05 * each >= 1.03 * worst]
    assert counted <= above[0], "and no further than the next bin"


@pytest.mark.parametrize("steps", [1, 3, 7])
@pytest.mark.parametrize("index", [0, 1, 4, 6])
def test_the_delay_of_the_ring_lies_in_the_range_that_a_bin_counts(steps: int, index: int) -> None:
    """Ticks at a regular interval, with the ring itself: each pushes its own instant."""
    edges = interval_bins_ns(PERIOD)
    link = belief(inertia=0.01, damping=0.01, load_inertia=0.001, flexible_hz=40.0)
    where = Situation(link, PERIOD * 1e-9, 4.1, 0.0)
    bins = Bins(Request(0.0, 0.0, "both"), GuardSettings(), where, steps, [0], edges)
    _, there = bins.at(index)
    low, high = (share * edges[index] / PERIOD for share in there.served)
    least, most = (delay / where.period for delay in there.inserted)
    random = np.random.default_rng(1)
    for interval in random.uniform(low, high, 7).tolist():
        ring, waits, before = DelayRing(steps), [], -1
        for k in range(3000):
            now = k * interval + 1e-6
            out = ring.push(now, math.floor(now) - before)
            before = math.floor(now)
            if k > 100:
                # the torque that leaves acts from now on
                waits.append(now - out)
        if index:
            assert least - 0.02 <= np.mean(waits) <= most + 0.02
        else:
            assert np.mean(waits) == pytest.approx(steps, rel=0.05)
