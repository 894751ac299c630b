"""Trials as a whole: one run, its judges, what is drawn."""

from __future__ import annotations

import math

import numpy as np
import pytest

from haptic_wall.controller.runtime.assembly import guard_schedule
from haptic_wall.hw.clock import SimulatedClock
from scripts.trials.draws import (
    LAG_FACTOR,
    MODE_HZ,
    MOST_BACKLASH,
    bench_of,
    critical_of,
    draw_truth,
)
from scripts.trials.judges import (
    deadline_after,
    ending,
    half_cycles,
    large,
    own_oscillation,
)
from scripts.trials.operators import (
    OPERATORS,
    draw_operator,
    operator_of,
)
from scripts.trials.run import (
    Trial,
    WallAsked,
    run_trial,
    trial_config,
)
from scripts.trials.servo import TrialServo
from scripts.trials.truth import Truth
from tests.scripts.trial_help import called_quiet, mode_hz, released

BENCH = bench_of("xm430-w350")
TRUTH = Truth(0.012, 0.012, 0.09, delay=0.001)
REPORT = (*BENCH.sets, "safety.on_oscillation=report")


def made_up(output: np.ndarray, state: int = 0, trip: str | None = None) -> Trial:
    """A trial with this true motion, at K 8."""
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
        first_alarm_s=math.nan,
        trip=trip,
        oscillation={},
    )


def swinging(seconds: float, growth: float, amplitude: float = 0.1, hertz: float = 5.0) -> Trial:
    time = np.arange(round(seconds * 1e3)) * 1e-3
    return made_up(amplitude * np.exp(growth * time) * np.cos(math.tau * hertz * time))


def test_the_wall_that_is_asked_for_is_rendered_and_the_truth_is_what_moves() -> None:
    trial = run_trial(TRUTH, BENCH.sets, WallAsked(7.0, 0.04), duration_s=1.0, position=0.3)
    assert trial.output.size == 1000
    assert trial.output[0] == 0.3
    assert np.all(trial.stiffness == 7.0)
    assert trial.torque[0] == pytest.approx(-2.1, abs=0.01)
    assert np.max(np.abs(trial.output - trial.measured)) <= 0.501 * TRUTH.position_step
    assert abs(trial.output[-1]) < 0.02
    assert trial.trip is None
    again = run_trial(TRUTH, BENCH.sets, WallAsked(7.0, 0.04), duration_s=1.0, position=0.3)
    assert np.array_equal(trial.output, again.output)


def test_the_guard_decides_unless_the_wall_is_forced() -> None:
    asked = WallAsked(1e6, 0.04, forced=False)
    config = trial_config(
        (*BENCH.sets, "wall.stiffness=1e6", "wall.damping=0.04", "wall.side=both")
    )
    servo = TrialServo(TRUTH, SimulatedClock())
    allowed = guard_schedule(config, servo, simulated=True).decision
    trial = run_trial(TRUTH, BENCH.sets, asked, duration_s=0.05)
    assert 1.0 < allowed.stiffness < 100.0
    assert trial.stiffness[0] == allowed.stiffness


def test_a_trip_ends_a_trial() -> None:
    sets = (*BENCH.sets, "safety.max_speed=1")
    trial = run_trial(TRUTH, sets, WallAsked(7.0, 0.04), duration_s=1.0, position=0.3)
    assert trial.trip == "overspeed"
    assert 0 < trial.output.size < 100


def test_the_critical_stiffness_parts_walls_that_decay_from_walls_that_grow() -> None:
    truth = Truth(0.012, 0.012, 0.0, torque_gain=1.3, delay=0.004, counts_per_rev=0)
    limit = critical_of(truth, 0.04)
    final = [
        own_oscillation(
            run_trial(truth, REPORT, WallAsked(ratio * limit, 0.04), duration_s=6.0, position=0.05),
            BENCH.belief,
        ).final
        for ratio in (0.97, 1.03)
    ]
    assert final[0] < 0.05 < final[1]


def test_reductions_are_told_by_their_begin_and_their_end() -> None:
    trial = swinging(1.0, 0.0)
    trial.stiffness[300:] = 4.0
    trial.stiffness[500:] = np.maximum(1.0, 4.0 - 0.1 * np.arange(500))
    times, stiffness = zip(*trial.reductions, strict=True)
    assert times == pytest.approx((0.3, 0.501))
    assert stiffness == (4.0, 1.0)


def test_half_cycles_are_those_of_the_motion() -> None:
    found = half_cycles(swinging(2.0, -0.5))
    assert found.amplitude.size == 19
    assert np.allclose(np.diff(found.end_s), 0.1, atol=2e-3)
    middle = np.exp(-0.5 * (found.begin_s + 0.05))
    assert np.allclose(found.amplitude, 0.1 * middle, rtol=2e-3)
    assert not found.sustained[2:].any()


def test_an_oscillation_that_goes_on_is_not_in_time() -> None:
    verdict = own_oscillation(swinging(8.0, 0.0), BENCH.belief)
    assert verdict.onset_s == pytest.approx(0.1, abs=2e-3)
    assert verdict.deadline_s == pytest.approx(0.1 + deadline_after(BENCH.belief, 8.0), abs=2e-3)
    assert verdict.judged
    assert not verdict.in_time


def test_a_kick_that_dies_is_no_oscillation_until_it_goes_on() -> None:
    time = np.arange(8000) * 1e-3
    size = np.maximum(0.4 * np.exp(-2.0 * time), 0.05)
    dies = made_up(0.4 * np.exp(-2.0 * time) * np.cos(math.tau * 5.0 * time))
    assert math.isnan(own_oscillation(dies, BENCH.belief).onset_s)
    settles = own_oscillation(made_up(size * np.cos(math.tau * 5.0 * time)), BENCH.belief)
    assert settles.onset_s == pytest.approx(0.5 * math.log(8.0), abs=0.2)
    assert not settles.in_time


def test_one_that_begins_to_decay_before_the_deadline_is_in_time() -> None:
    time = np.arange(8000) * 1e-3
    size = 0.1 * np.exp(np.where(time < 1.0, 0.5 * time, 0.5 - 0.3 * (time - 1.0)))
    verdict = own_oscillation(made_up(size * np.cos(math.tau * 5.0 * time)), BENCH.belief)
    assert verdict.decays_s == pytest.approx(1.0, abs=0.15)
    assert verdict.in_time


def test_one_that_a_trip_ends_before_the_deadline_is_in_time() -> None:
    for seconds, wanted in ((1.0, True), (7.0, False)):
        cut = made_up(swinging(seconds, 0.0).output, trip="oscillation")
        assert own_oscillation(cut, BENCH.belief).in_time is wanted


def test_a_small_oscillation_is_none() -> None:
    verdict = own_oscillation(swinging(8.0, 0.0, amplitude=0.9 * large(4096)), BENCH.belief)
    assert math.isnan(verdict.onset_s)
    assert verdict.in_time


def test_the_deadline_is_six_cycles_of_the_slowest_frequency_but_five_seconds_at_most() -> None:
    rate = math.sqrt(0.7 * 8.0 / 0.017927)
    assert deadline_after(BENCH.belief, 8.0) == pytest.approx(6.0 * math.tau / rate)
    assert deadline_after(BENCH.belief, 0.01) == 5.0


def test_what_sustains_itself_at_the_end_and_is_called_quiet_is_told() -> None:
    count = math.tau / 4096
    assert called_quiet(swinging(5.0, 0.0, amplitude=5.0 * count))
    assert not called_quiet(swinging(5.0, 0.0, amplitude=3.9 * count))
    loud = made_up(swinging(5.0, 0.0, amplitude=5.0 * count).output, state=2)
    assert not called_quiet(loud)
    rests = swinging(5.0, 0.0, amplitude=5.0 * count).output.copy()
    rests[4500:] = rests[4500]
    assert ending(made_up(rests)).amplitude == 0.0


def test_a_ripple_does_not_hide_what_sustains_itself() -> None:
    time = np.arange(8000) * 1e-3
    ripple = np.sin(math.tau * 60.0 * time)
    slow = np.cos(math.tau * 5.0 * time)
    count = math.tau / 4096
    assert called_quiet(made_up(6.0 * count * slow + 0.8 * count * ripple))
    verdict = own_oscillation(made_up(0.1 * slow + 0.5 * count * ripple), BENCH.belief)
    assert not verdict.in_time


@pytest.mark.parametrize("preset", ["xm430-w350", "xl330-m288"])
def test_truths_are_drawn_from_the_whole_box_its_corners_and_the_lag_beyond(preset: str) -> None:
    bench = bench_of(preset)
    belief = bench.belief
    random = np.random.default_rng(3)
    drawn = [
        draw_truth(bench, random, back_emf=None, backlash=None, flexible=None) for _ in range(600)
    ]
    for name in ("inertia", "damping", "coulomb", "torque_gain"):
        bounds = getattr(belief, name)
        values = np.array([getattr(one, name) for one in drawn])
        assert values.min() == bounds.low
        assert values.max() == bounds.high
        inside = (values > bounds.low) & (values < bounds.high)
        assert 0.4 < np.mean(inside) < 0.6
        assert np.mean(values[inside] < math.sqrt(bounds.low * bounds.high)) == pytest.approx(
            0.5, abs=0.1
        )
    lags = np.array([one.delay for one in drawn])
    assert lags.max() == LAG_FACTOR * belief.delay.high
    assert np.mean(lags > belief.delay.high) > 0.4
    assert {one.back_emf for one in drawn} == {"none", "current", "voltage"}
    assert max(one.backlash for one in drawn) == MOST_BACKLASH
    assert max(one.transmission_backlash for one in drawn) > 0.0
    modes = [mode_hz(one) for one in drawn if one.flexible]
    assert MODE_HZ[0] <= min(modes) < max(modes) <= MODE_HZ[1]
    assert {one.encoder for one in drawn} == {"output", "motor"}


@pytest.mark.parametrize("kind", OPERATORS)
def test_an_operator_moves_the_wall_and_the_same_draw_is_the_same_operator(kind: str) -> None:
    one, other = (
        draw_operator(kind, 0.012, 3.0, np.random.default_rng(5), natural_hz=4.0) for _ in range(2)
    )
    assert one == other
    assert len(one.rows) == 3000
    trial = run_trial(TRUTH, BENCH.sets, WallAsked(7.0, 0.04), one, duration_s=3.0)
    assert np.ptp(trial.output) > 10 * TRUTH.position_step
    assert trial.trip is None


def test_who_lets_go_leaves_the_wall_to_itself() -> None:
    holds = operator_of(40.0, 0.5, np.full(2000, 0.3))
    trial = run_trial(TRUTH, BENCH.sets, WallAsked(7.0, 0.04), released(holds, 1.0), duration_s=2.0)
    assert trial.output[999] == pytest.approx(0.3 * 40.0 / 47.0, abs=0.01)
    assert abs(trial.output[-1]) < 0.02
