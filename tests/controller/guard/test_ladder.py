"""The rung follows the measured ages: down at once on a run, up only slowly and untouched."""

import itertools
from dataclasses import dataclass

import pytest

from controller.guard.ladder import RAISE_WINDOWS, RUN, GuardLadder, rung_ages_ns

AGES = [0, 100_000, 200_000, 400_000, 800_000]
WINDOW = 100


@dataclass(frozen=True)
class Rung:
    stiffness: float
    delay: float


def ladder(percentile=90.0):
    rungs = [Rung(100.0 / (1 + age / 1e5), age * 1e-9) for age in AGES]
    return GuardLadder(rungs, AGES, percentile, WINDOW)


def test_the_rung_covers_the_age():
    subject = ladder()
    for age in (150_000,) * 50:
        subject.observe(age, may_raise=False)
    subject.settle()
    assert subject.age_ns == 200_000


def test_warm_up_may_settle_on_any_rung():
    subject = ladder()
    for age in (700_000,) * 50:
        subject.observe(age, may_raise=False)
    subject.settle()
    assert subject.age_ns == 800_000


def test_the_percentile_is_covered_and_not_the_worst():
    subject = ladder(percentile=90.0)
    for k in range(WINDOW):
        subject.observe(700_000 if k % 20 == 0 else 50_000, may_raise=True)
    assert subject.age_ns == 100_000
    subject = ladder(percentile=90.0)
    for k in range(WINDOW):
        subject.observe(700_000 if k % 5 == 0 else 50_000, may_raise=True)
    assert subject.age_ns == 800_000


def test_a_run_of_high_ages_lowers_at_once():
    subject = ladder()
    changed = [subject.observe(350_000, may_raise=False) for _ in range(RUN)]
    assert changed == [False] * (RUN - 1) + [True]
    assert subject.age_ns == 400_000


def test_a_hiccup_does_not_lower():
    subject = ladder()
    for k in range(WINDOW * 3):
        assert not subject.observe(800_000 if k % 60 == 0 else 0, may_raise=True)


def test_raised_only_after_whole_windows_and_out_of_contact():
    subject = ladder()
    for _ in range(RUN):
        subject.observe(800_000, may_raise=True)
    assert subject.age_ns == 800_000
    for _ in range((RAISE_WINDOWS + 2) * WINDOW):
        assert not subject.observe(50_000, may_raise=False), "never while touched"
    assert subject.observe(50_000, may_raise=True)
    assert subject.age_ns == 100_000
    subject = ladder()
    for _ in range(RUN):
        subject.observe(800_000, may_raise=True)
    early = [subject.observe(0, may_raise=True) for _ in range((RAISE_WINDOWS + 1) * WINDOW)]
    assert early.index(True) >= (RAISE_WINDOWS - 1) * WINDOW


def test_a_pending_raise_does_not_survive_a_run_that_lowers():
    subject = ladder()
    for _ in range(RUN):
        subject.observe(350_000, may_raise=False)
    for _ in range((RAISE_WINDOWS + 2) * WINDOW):
        subject.observe(50_000, may_raise=False)
    for _ in range(RUN):
        subject.observe(800_000, may_raise=False)
    assert subject.age_ns == 800_000
    quick = [subject.observe(50_000, may_raise=True) for _ in range((RAISE_WINDOWS - 1) * WINDOW)]
    assert not any(quick), "five whole windows after the lowering, untouched or not"


def test_a_run_never_takes_a_stiffer_rung_than_a_window_has_just_asked_for():
    subject = ladder()
    for k in range(WINDOW - RUN + 1):
        subject.observe(350_000 if k % 5 == 1 else 0, may_raise=False)
    for _ in range(RUN - 1):
        subject.observe(150_000, may_raise=False)
    assert subject.age_ns == 400_000, "the window's end"
    subject.observe(10**9, may_raise=False)
    assert subject.age_ns == 400_000


def test_a_window_that_asks_for_the_rung_there_is_does_not_interrupt_a_run():
    subject = ladder()
    for k in range(WINDOW):
        subject.observe(350_000 if k >= WINDOW - RUN // 2 else 0, may_raise=False)
    for _ in range(RUN - RUN // 2 - 1):
        assert not subject.observe(350_000, may_raise=False)
    assert subject.observe(350_000, may_raise=False), "as many in a row as a run takes"


def test_ages_beyond_the_ladder_take_its_last_rung():
    subject = ladder()
    for _ in range(RUN):
        subject.observe(10**9, may_raise=False)
    assert subject.age_ns == AGES[-1]


def test_the_real_rungs_rise_and_are_fine_where_buses_are_quick():
    ages = rung_ages_ns(1_000_000)
    assert ages == sorted(set(ages))
    assert ages[0] == 0
    assert ages[-1] == 20_000_000
    assert max(b - a for a, b in itertools.pairwise(ages) if b <= 600_000) == 10_000
    assert len(ages) == pytest.approx(90, abs=15)


@pytest.mark.parametrize("period_ns", [500_000, 1_000_000, 10_000_000, 20_000_000])
def test_the_real_rungs_reach_beyond_a_pipelined_sample_and_a_loss(period_ns):
    ages = rung_ages_ns(period_ns)
    assert ages == sorted(set(ages))
    assert ages[-1] >= 3 * period_ns
    assert len(ages) < 130, "each costs the start some milliseconds"


def test_a_handful_of_ages_is_no_reason_for_a_stiffer_rung():
    subject = ladder()
    for _ in range(RUN):
        subject.observe(350_000, may_raise=False)
    for _ in range(WINDOW - RUN):
        subject.observe(350_000, may_raise=False)
    subject.observe(0, may_raise=False)
    subject.settle()
    assert subject.age_ns == 400_000


def test_where_replies_take_several_periods_the_rungs_reach_three_of_them():
    ages = rung_ages_ns(1_000_000, 16_000_000)
    assert ages[: len(rung_ages_ns(1_000_000))] == rung_ages_ns(1_000_000)
    assert ages == sorted(set(ages))
    assert ages[-1] >= 48_000_000
    assert len(ages) < 130
