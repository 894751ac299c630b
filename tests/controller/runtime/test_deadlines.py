"""The grid never drifts, never bursts, and is served on time."""

import time

from hypothesis import example, given
from hypothesis import strategies as st

from haptic_wall.controller.runtime.deadlines import (
    PLACE_SHARE,
    SPIN_MAX_NS,
    SPIN_MIN_NS,
    first_deadline,
    measured_spin_margin_ns,
    next_deadline,
    spinning,
    waiter_for,
)
from haptic_wall.hw.clock import MonotonicClock, SimulatedClock


@given(period=st.integers(100_000, 20_000_000))
@example(period=5_000_000)
@example(period=20_000_000)
def test_the_grid_begins_within_two_periods_away_from_the_kernel_s_own_ticks(period: int) -> None:
    before = time.monotonic_ns()
    first = first_deadline(MonotonicClock(), period)
    assert before + period <= first <= time.monotonic_ns() + 2 * period
    assert first % period == round(PLACE_SHARE * min(period, 1_000_000))


@given(st.integers(0, 10**18), st.integers(0, 10**12), st.integers(500_000, 20_000_000))
def test_grid_properties(deadline: int, late: int, period: int) -> None:
    now = deadline + late
    following, missed = next_deadline(deadline, now, period)
    assert (following - deadline) % period == 0, "the grid never shifts"
    assert following - deadline == (missed + 1) * period, "what is skipped is counted"
    assert following > deadline, "a deadline is served once"
    assert following > now - period, "no burst: at most one deadline is due"


def test_a_simulated_clock_arrives_exactly() -> None:
    wait = waiter_for(SimulatedClock(7), 1_000_000)
    assert wait(10**9) == 10**9
    assert wait(5) == 10**9, "time does not go back"


def test_a_wait_is_never_early() -> None:
    wait = spinning(200_000, MonotonicClock())
    for _ in range(20):
        deadline = time.monotonic_ns() + 1_000_000
        assert wait(deadline) >= deadline
    past = time.monotonic_ns() - 1
    assert wait(past) > past


def test_the_margin_is_as_set_or_measured_and_leaves_most_of_a_short_period_to_sleep() -> None:
    assert SPIN_MIN_NS <= measured_spin_margin_ns(naps=20) <= SPIN_MAX_NS
