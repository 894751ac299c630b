"""Judges of trials, on made-up motions and on a few runs."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from haptic_wall.hw.clock import SimulatedClock
from tests.support.cases_drawn import PRESETS
from tests.support.judges import (
    called_quiet,
    deadline_after,
    ending,
    half_cycles,
    large,
    longest_unseen_s,
    own_oscillation,
    sustains,
    time_above_s,
    unseen,
)
from tests.support.links_drawn import PERIOD, ceiling_of, draw_linked, limit_of
from tests.support.operators import OPERATORS, draw_operator
from tests.support.trial import Case, Trial, WallAsked, run_trial
from tests.support.trial_servo import TrialServo
from tests.support.truth import COUNT, Truth
from tests.support.truths_drawn import LAG_FACTOR, bench_of, critical_of, draw_truth
from tests.support.verdicts import Answered, held, oscillation

BENCH = bench_of(PRESETS[0])
TRUTH = Truth(0.012, 0.012, 0.09, delay=0.001)
LATE = Truth(0.007967, 0.005846, 0.045195, torque_gain=1.35, delay=0.008)
"""Four times as late as the preset believes"""
TIME = np.arange(8000) * 1e-3


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


def swinging(
    growth: float = 0.0, amplitude: float = 0.1, seconds: float = 8.0
) -> NDArray[np.float64]:
    time = np.arange(float(round(seconds * 1e3))) * 1e-3
    return amplitude * np.exp(growth * time) * np.cos(math.tau * 5.0 * time)


def test_half_cycles_are_those_of_the_motion() -> None:
    found = half_cycles(made_up(swinging(-0.5, seconds=2.0)))
    assert found.amplitude.size == 19
    assert np.allclose(np.diff(found.end_s), 0.1, atol=2e-3)
    assert np.allclose(found.amplitude, 0.1 * np.exp(-0.5 * (found.begin_s + 0.05)), rtol=2e-3)
    assert not found.sustained[2:].any()


def test_an_oscillation_must_decay_or_be_ended_before_its_deadline() -> None:
    goes_on = own_oscillation(made_up(swinging()), BENCH.belief)
    assert goes_on.onset_s == pytest.approx(0.1, abs=2e-3)
    assert goes_on.deadline_s == pytest.approx(0.1 + deadline_after(BENCH.belief, 8.0), abs=2e-3)
    assert goes_on.judged and not goes_on.in_time
    size = 0.1 * np.exp(np.where(TIME < 1.0, 0.5 * TIME, 0.5 - 0.3 * (TIME - 1.0)))
    decays = own_oscillation(made_up(size * np.cos(math.tau * 5.0 * TIME)), BENCH.belief)
    assert decays.decays_s == pytest.approx(1.0, abs=0.15)
    assert decays.in_time
    for seconds, wanted in ((1.0, True), (7.0, False)):
        ended = made_up(swinging(seconds=seconds), trip="oscillation")
        assert own_oscillation(ended, BENCH.belief).in_time is wanted


def test_a_kick_that_dies_and_a_small_motion_are_no_oscillation() -> None:
    wave = np.cos(math.tau * 5.0 * TIME)
    for quiet in (0.4 * np.exp(-2.0 * TIME) * wave, swinging(amplitude=0.9 * large(4096))):
        assert math.isnan(own_oscillation(made_up(quiet), BENCH.belief).onset_s)
    settles = made_up(np.maximum(0.4 * np.exp(-2.0 * TIME), 0.05) * wave)
    own = own_oscillation(settles, BENCH.belief)
    assert own.onset_s == pytest.approx(0.5 * math.log(8.0), abs=0.2)
    assert not own.in_time


def test_the_deadline_is_six_cycles_of_the_slowest_frequency_but_five_seconds_at_most() -> None:
    rate = math.sqrt(0.7 * 8.0 / 0.017927)
    assert deadline_after(BENCH.belief, 8.0) == pytest.approx(6.0 * math.tau / rate)
    assert deadline_after(BENCH.belief, 0.01) == 5.0


@pytest.mark.parametrize(
    ("growth", "counts", "goes_on"),
    [(0.0, 5.0, True), (0.1, 5.0, True), (0.0, 3.9, False), (-0.2, 50.0, False)],
)
def test_what_keeps_its_amplitude_above_a_threshold_sustains_itself(
    growth: float, counts: float, goes_on: bool
) -> None:
    output = swinging(growth, counts * COUNT)
    assert sustains(made_up(output), 4.0 * COUNT) is goes_on
    assert unseen(made_up(output, state=1)) is goes_on
    assert not unseen(made_up(output, state=2))


def test_what_goes_on_at_the_end_is_told_from_rest_and_under_a_ripple() -> None:
    five = swinging(amplitude=5.0 * COUNT)
    assert called_quiet(made_up(five))
    assert not called_quiet(made_up(five, state=2))
    rests = np.where(TIME < 7.5, five, five[7500])
    assert ending(made_up(rests)).amplitude == 0.0
    ripple = 0.8 * COUNT * np.sin(math.tau * 60.0 * TIME)
    assert called_quiet(made_up(1.2 * five + ripple))
    assert not own_oscillation(made_up(swinging() + ripple), BENCH.belief).in_time


def test_times_above_a_threshold_and_unseen_are_told() -> None:
    trial = made_up(swinging(amplitude=10.0 * COUNT))
    trial.state[3000:5000] = 2
    assert longest_unseen_s(trial) == pytest.approx(3.0, abs=0.25)
    assert longest_unseen_s(made_up(swinging(-0.2, 50.0 * COUNT))) == 0.0
    assert time_above_s(made_up(swinging(-0.5, 0.1)), 0.02) == pytest.approx(3.2, abs=0.1)


def test_the_wall_that_is_asked_for_is_rendered_and_the_truth_is_what_moves() -> None:
    trial = run_trial(TRUTH, BENCH.sets, WallAsked(7.0, 0.04), duration_s=1.0, position=0.3)
    assert np.all(trial.stiffness == 7.0)
    assert trial.torque[0] == pytest.approx(-2.1, abs=0.01)
    assert np.max(np.abs(trial.output - trial.measured)) <= 0.501 * COUNT
    assert abs(trial.output[-1]) < 0.02
    sets = (*BENCH.sets, "safety.max_speed=1")
    ended = run_trial(TRUTH, sets, WallAsked(7.0, 0.04), duration_s=1.0, position=0.3)
    assert ended.trip == "overspeed"
    assert ended.output.size < 100
    guards = WallAsked(1e6, 0.04, forced=False)
    allowed = run_trial(TRUTH, BENCH.sets, guards, duration_s=0.05)
    assert 1.0 < allowed.stiffness[0] < 100.0


def test_the_critical_stiffness_parts_walls_that_decay_from_walls_that_grow() -> None:
    truth = Truth(0.012, 0.012, 0.0, torque_gain=1.3, delay=0.004, counts_per_rev=0)
    limit, sets = critical_of(truth, 0.04), (*BENCH.sets, "safety.on_oscillation=report")
    below, above = (
        np.abs(
            run_trial(
                truth, sets, WallAsked(ratio * limit, 0.04), duration_s=6.0, position=0.05
            ).output[-500:]
        ).max()
        for ratio in (0.97, 1.03)
    )
    assert below < 0.05 < above


@pytest.mark.whole
def test_a_wall_that_oscillates_by_itself_is_found_and_what_follows_is_judged() -> None:
    wall = WallAsked(1e6, 0.04, forced=False)
    verdict = oscillation(Case(BENCH.name, LATE, wall, position=0.1))
    assert isinstance(verdict, Answered)
    assert verdict.alarm_s < 2.0
    assert not verdict.never and not verdict.unseen
    assert oscillation(Case(BENCH.name, TRUTH, wall, position=0.1)) is None


def test_a_trial_with_an_operator_counts_what_was_done_to_it() -> None:
    one = held(Case(BENCH.name, TRUTH, WallAsked(8.0, 0.04), 3.0, operator="lean", seed=3))
    assert one.seconds == 3.0
    assert (one.softened, one.suspected, one.trip, one.faults) == (0, False, None, "")


@pytest.mark.parametrize("kind", OPERATORS)
def test_an_operator_moves_the_wall_and_the_same_draw_is_the_same_operator(kind: str) -> None:
    one, other = (
        draw_operator(kind, 0.012, 3.0, np.random.default_rng(5), natural_hz=4.0) for _ in range(2)
    )
    assert one == other
    trial = run_trial(TRUTH, BENCH.sets, WallAsked(7.0, 0.04), one, duration_s=1.0)
    assert np.ptp(trial.output) > 10 * COUNT


@pytest.mark.parametrize("preset", PRESETS)
def test_truths_are_drawn_from_the_whole_belief_its_corners_and_the_lag_beyond(preset: str) -> None:
    belief, random = bench_of(preset).belief, np.random.default_rng(3)
    drawn = [
        draw_truth(bench_of(preset), random, back_emf=None, backlash=None, flexible=None)
        for _ in range(400)
    ]
    for name in ("inertia", "damping", "coulomb", "torque_gain"):
        bounds = getattr(belief, name)
        values = np.array([getattr(one, name) for one in drawn])
        assert (values.min(), values.max()) == (bounds.low, bounds.high)
        inside = (values > bounds.low) & (values < bounds.high)
        assert 0.4 < np.mean(inside) < 0.6
    lags = np.array([one.delay for one in drawn])
    assert lags.max() == LAG_FACTOR * belief.delay.high
    assert np.mean(lags > belief.delay.high) > 0.4
    assert {one.back_emf for one in drawn} == {"none", "current", "voltage"}
    assert {one.encoder for one in drawn} == {"output", "motor"}
    assert max(one.transmission_backlash for one in drawn) > 0.0


@pytest.mark.parametrize("preset", PRESETS)
def test_a_vibration_grows_above_the_exact_ceiling_and_dies_below(preset: str) -> None:
    """With fractions of a period and a current loop, in a simulation that shares no formula."""
    truth = draw_linked(preset, np.random.default_rng(1), friction=False)
    ceiling = ceiling_of(truth)
    stiffness = limit_of(truth, 0.5 * ceiling)
    for share, k, grows in ((0.95, 0.0, False), (1.05, 0.0, True), (0.5, 0.5, False)):
        assert (vibration(truth, k * stiffness, share * ceiling) > 1.0) is grows


def vibration(truth: Truth, stiffness: float, damping: float) -> float:
    """Amplitude after two seconds over that after one, without rounding and limit."""
    values = {name: getattr(truth, name) for name in truth.__slots__}
    smooth = Truth(**{**values, "counts_per_rev": 0, "torque_limit": 1e9, "torque_step": 0.0})
    clock, share = SimulatedClock(), truth.load_inertia / truth.inertia
    servo = TrialServo(smooth, clock, velocity=-share, struck=1.0)  # at rest as a whole
    last = 0.0
    for tick in range(2000):
        clock.wait_until(tick * 1_000_000)
        servo.request()
        position = servo.collect(0).position
        servo.write(-stiffness * position - damping * (position - last) / PERIOD)
        last = position
    speed = np.abs(np.diff(servo.outputs))
    return float(speed[1500:].max() / speed[500:1000].max())
