"""What the tables say of trials: rates with bounds, what sustains itself, pages in sections."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from scripts.trials.cases import LAGS, ROWS, Case, Lags, Row, draw_row, hand_case
from scripts.trials.draws import bench_of
from scripts.trials.hand_hours import judged
from scripts.trials.rates import (
    few,
    hourly,
    lower_bound,
    most,
    most_per_hour,
    upper_bound,
)
from scripts.trials.run import Trial, WallAsked
from scripts.trials.truth import Truth
from scripts.trials.verdicts import (
    answered,
    at_alarm_and_after,
    goes_on_by_itself,
    longest_unseen_s,
    sustains,
    time_above_s,
    unseen,
)

BENCH = bench_of("xm430-w350")
COUNT = math.tau / 4096
LATE = Truth(0.007967, 0.005846, 0.045195, torque_gain=1.35, delay=0.008)
"""Four times as late as the preset believes"""


def made_up(output: np.ndarray, state: int = 0, alarm_s: float = math.nan) -> Trial:
    n = output.size
    return Trial(
        period=1e-3,
        output=output,
        measured=output,
        torque=np.zeros(n),
        stiffness=np.full(n, 8.0),
        damping=np.zeros(n),
        held=np.zeros(n),
        state=np.full(n, state),
        saturated=np.zeros(n, dtype=np.bool_),
        first_alarm_s=alarm_s,
        trip=None,
        oscillation={},
    )


def swinging(growth: float, amplitude: float, seconds: float = 8.0) -> NDArray[np.float64]:
    time = np.arange(float(round(seconds * 1e3))) * 1e-3
    return amplitude * np.exp(growth * time) * np.cos(math.tau * 5.0 * time)


def test_nothing_in_a_thousand_shows_less_than_three_in_a_thousand() -> None:
    assert upper_bound(0, 1000) == pytest.approx(1.0 - 0.05 ** (1 / 1000))
    assert few(0, 1000) == "0 of 1000 (< 0.3 %)"
    assert few(0, 0) == "0 of 0"


def test_a_bound_excludes_what_would_have_been_seen_more_often() -> None:
    bound = upper_bound(2, 50)
    seen = sum(math.comb(50, k) * bound**k * (1.0 - bound) ** (50 - k) for k in range(3))
    assert seen == pytest.approx(0.05)
    assert lower_bound(48, 50) == pytest.approx(1.0 - bound)
    assert upper_bound(50, 50) == 1.0
    assert most(50, 50) == "50 of 50 (100.0 %, > 94.2 %)"
    with pytest.raises(ValueError, match="5 hits in 4 trials"):
        upper_bound(5, 4)


def test_nothing_in_thirty_hours_shows_less_than_one_in_ten() -> None:
    assert most_per_hour(0, 30.0) == pytest.approx(-math.log(0.05) / 30.0)
    assert hourly(0, 30.0) == "0: 0/h (< 0.1/h)"
    with pytest.raises(ValueError, match="time above 0"):
        most_per_hour(0, 0.0)


@pytest.mark.parametrize(
    ("output", "goes_on"),
    [
        (swinging(0.0, 5.0 * COUNT), True),
        (swinging(0.1, 5.0 * COUNT), True),
        (swinging(0.0, 3.9 * COUNT), False),
        (swinging(-0.2, 50.0 * COUNT), False),
    ],
    ids=["lasts", "grows", "small", "dies slowly"],
)
def test_what_keeps_its_amplitude_above_a_threshold_sustains_itself(
    output: np.ndarray, goes_on: bool
) -> None:
    assert sustains(made_up(output), 4.0 * COUNT) is goes_on
    assert unseen(made_up(output, state=1)) is goes_on
    assert not unseen(made_up(output, state=2))


def test_the_time_until_it_is_seen_is_told() -> None:
    trial = made_up(swinging(0.0, 10.0 * COUNT))
    trial.state[3000:5000] = 2
    assert longest_unseen_s(trial) == pytest.approx(3.0, abs=0.25)
    dies = made_up(swinging(-0.2, 50.0 * COUNT))
    assert longest_unseen_s(dies) == 0.0


def test_the_last_half_cycle_above_a_threshold_is_told() -> None:
    assert time_above_s(made_up(swinging(-0.5, 0.1)), 0.02) == pytest.approx(3.2, abs=0.1)
    assert time_above_s(made_up(swinging(0.0, 0.01)), 0.02) == 0.0


def test_amplitudes_before_and_after_an_alarm_are_told_apart() -> None:
    before, after = at_alarm_and_after(made_up(swinging(0.1, 0.1), alarm_s=4.0))
    assert before == pytest.approx(0.1 * math.exp(0.4), rel=0.02)
    assert after == pytest.approx(0.1 * math.exp(0.8), rel=0.02)
    assert math.isnan(at_alarm_and_after(made_up(swinging(0.1, 0.1)))[0])


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
@pytest.mark.parametrize("lags", LAGS, ids=lambda lags: lags.name)
def test_a_row_draws_what_its_name_says(row: Row, lags: Lags) -> None:
    random = np.random.default_rng(1)
    drawn = [draw_row(BENCH, row, lags, random) for _ in range(40)]
    delays = [truth.delay / BENCH.belief.delay.high for truth in drawn]
    assert lags.low <= min(delays) < max(delays) == lags.high
    assert {truth.flexible for truth in drawn} == {row.flexible}
    assert {truth.backlash + truth.transmission_backlash > 0.0 for truth in drawn} == {row.backlash}
    if row.back_emf is not None:
        assert {truth.back_emf for truth in drawn} == {row.back_emf}


def test_what_is_printed_of_a_case_is_the_case() -> None:
    case = hand_case(BENCH.name, LATE, WallAsked(8.0, 0.04), "rhythm", 7, 2.0)
    again = eval(repr(case))
    assert again == case
    assert np.array_equal(again.run().output, case.run().output)


def test_a_wall_that_oscillates_by_itself_is_found_and_what_follows_is_judged() -> None:
    wall = WallAsked(1e6, 0.04, forced=False)
    case = Case(BENCH.name, LATE, wall, position=0.1)
    assert goes_on_by_itself(case)
    verdict = answered(case)
    assert verdict.alarm_s < 2.0
    assert not verdict.never
    assert not verdict.unseen
    known = Truth(0.011951, 0.011692, 0.09039, delay=0.001)
    assert not goes_on_by_itself(Case(BENCH.name, known, wall, position=0.1))


def test_a_trial_with_an_operator_counts_what_was_done_to_it() -> None:
    known = Truth(0.011951, 0.011692, 0.09039, delay=0.001)
    one = judged(hand_case(BENCH.name, known, WallAsked(8.0, 0.04), "lean", 3, 3.0))
    assert one.seconds == 3.0
    assert (one.softened, one.returned, one.believed, one.trip) == (0, 0, False, None)
