"""The backstop in closed loops on servos that are not what is believed, and with hands."""

import math
from dataclasses import replace

import numpy as np
import pytest

from haptic_wall.controller.detector.detection import Known, detect
from haptic_wall.controller.detector.state import State
from haptic_wall.controller.laws.wall import Side
from tests.cases import sampled
from tests.support.judges import called_quiet, own_oscillation, unseen
from tests.support.operators import NOBODY, Operator, operator_of
from tests.support.trial import Case, Trial, WallAsked, run_trial
from tests.support.truth import Truth
from tests.support.truths_drawn import bench_of

BENCH = bench_of("xm430-w350")
RIGID = Truth(0.008, 0.0059, 0.0453, torque_gain=2.4 / 1.783, delay=0.006)
VALUE = Truth(0.011951, 0.011692, 0.09039, delay=0.001)
XL330 = Truth(0.0018142, 0.0018309, 0.0064165, torque_limit=0.52, stall_torque=0.52, delay=0.015)


def run(
    truth: Truth,
    damping: float,
    *sets: str,
    operator: Operator = NOBODY,
    kick: float = 0.05,
    duration_s: float = 5.0,
    stiffness: float | None = None,
) -> Trial:
    """At the guard's K, or at the one that is given."""
    wall = WallAsked(stiffness or 1e6, damping, forced=stiffness is not None)
    return run_trial(
        truth, (*BENCH.sets, *sets), wall, operator, duration_s=duration_s, position=kick
    )


def test_a_lag_beyond_the_belief_is_found_and_the_oscillation_decays_in_time() -> None:
    trial = run(RIGID, 0.04)
    found = own_oscillation(trial, BENCH.belief)
    assert found.judged
    assert found.in_time
    assert trial.first_alarm_s < found.deadline_s
    assert trial.trip is None
    assert trial.stiffness[-1] < trial.stiffness[0]
    assert not called_quiet(trial)


@pytest.mark.parametrize("stiffness", [42.0, 55.0])
def test_an_oscillation_at_the_torque_limit_is_seen_in_its_record(stiffness: float) -> None:
    """Its period changes as it grows, so that no sinusoid fits; the run's own watch judges it."""
    truth = replace(VALUE, delay=0.003)
    report = "safety.on_oscillation=report"
    trial = run(truth, 0.0, report, stiffness=stiffness, kick=0.2, duration_s=3.0)
    times = np.arange(float(trial.measured.size)) * trial.period
    known = Known(trial.period, VALUE.inertia, math.tau / 4096, truth.delay)
    found = detect(times, trial.measured, trial.torque, known)
    assert found.worst == State.GROWING
    assert found.first_alarm_s == pytest.approx(trial.first_alarm_s, abs=0.05)


def ended_or_died(trial: Trial) -> bool:
    return trial.trip is not None or (
        own_oscillation(trial, BENCH.belief).in_time and not called_quiet(trial)
    )


@pytest.mark.parametrize("kick", sampled([0.05, 0.2], 2))
def test_a_load_that_oscillates_on_its_transmission_is_found(kick: float) -> None:
    assert ended_or_died(run(VALUE.with_mode(30.0, 0.02, 0.5), 0.2, kick=kick))


@pytest.mark.parametrize("delay", sampled([0.002, 0.003, 0.004], 3))
def test_where_backlash_makes_a_limit_cycle_the_stiffness_comes_down(delay: float) -> None:
    truth = Truth(0.011951, 0.011692, 0.0453, delay=delay, backlash=math.radians(0.25))
    trial = run(truth, 0.2, duration_s=8.0)
    assert trial.stiffness[-1] < trial.stiffness[0]
    assert not called_quiet(trial)


def rhythm() -> Operator:
    time = np.arange(8000) * 1e-3
    return operator_of(30.0, 0.5, 0.25 * np.sin(math.tau * 2.0 * time))


@pytest.mark.parametrize("limit", sampled([0.5, 0.3, 1.0], 3))
def test_a_hand_that_saturates_a_soft_wall_gets_it_back_at_the_surface(limit: float) -> None:
    truth = Truth(0.011951, 0.011692, 0.09039, delay=0.001, torque_limit=limit)
    trial = run(truth, 0.04, f"servo.torque_limit={limit}", operator=rhythm(), stiffness=10.0)
    assert trial.saturated.mean() > 0.2
    assert math.isnan(trial.first_alarm_s)
    assert trial.trip is None
    lowered = np.flatnonzero(trial.stiffness < 10.0)
    assert lowered.size, "it was probed"
    assert np.ptp(lowered) < 1000, "once: a motion like that is not probed again for a while"
    back = lowered[-1] + 1
    # At the surface: the torque that comes back is no more than the engage torque.
    assert (1.0 - 0.25) * 10.0 * abs(trial.measured[back]) <= 0.1 + 10.0 * 2 * math.tau / 4096


@pytest.mark.whole
def test_a_load_that_swings_the_shaft_at_one_hertz_is_not_asked_about_for_ever() -> None:
    """Its answers take longer than any without a load, so that none is clear."""
    load = operator_of(0.0, 0.0, np.zeros(13000), push=0.12 * 0.52, mass=0.004)
    wall = WallAsked(1e6, 0.01, forced=False)
    trial = run_trial(
        XL330, bench_of("xl330-m288").sets, wall, load, duration_s=12.0, position=0.228
    )
    assert not math.isnan(trial.first_alarm_s)
    assert np.ptp(trial.output[-1000:]) < 0.01


def test_a_transmission_that_keeps_its_period_at_a_power_that_no_hand_has_is_found() -> None:
    truth = Truth(
        0.00976,
        0.0158,
        0.0452,
        torque_gain=0.7,
        delay=0.0045,
        backlash=0.001,
        back_emf="none",
        stall_torque=0.7 * BENCH.stall_torque,
        no_load_speed=BENCH.no_load_speed,
    )
    trial = run(truth.with_mode(22.3, 0.0104, 0.302), 0.2, kick=0.0379, duration_s=3.0)
    assert own_oscillation(trial, BENCH.belief).largest > math.radians(4.0)
    assert ended_or_died(trial)


def rests(trial: Trial, load: float) -> None:
    """It has come to rest on the reduced wall, where the load was: the wall still carries it."""
    assert trial.trip is None
    assert trial.counts[2] == 1
    assert np.ptp(trial.output[-300:]) < 0.02
    assert trial.torque[-1] == pytest.approx(-load, abs=0.25 * load)
    assert trial.output[-1] == pytest.approx(load / trial.stiffness[0], rel=0.4)


@pytest.mark.parametrize("mass", sampled([0.03, 0.054], 2))
def test_a_weight_that_swings_at_its_wall_is_held_and_comes_to_rest(mass: float) -> None:
    """It is heavier than the believed servo, and the wall holds it with a third of its torque."""
    truth = Truth(0.017927, 0.011692, 0.045195, delay=0.0067)
    load = operator_of(0.0, 0.0, np.zeros(7000), push=1.2, mass=mass)
    trial = run(truth, 0.04, operator=load, stiffness=14.0, kick=0.19, duration_s=6.5)
    rests(trial, 1.2)
    assert np.abs(trial.output).max() < 0.5


def test_an_oscillation_under_a_load_decays() -> None:
    """It grows fast; the detector, whose lag is four times too short, is quiet."""
    truth = Truth(0.011951, 0.011692, 0.09039, delay=0.004)
    load = operator_of(0.0, 0.0, np.zeros(5000), push=1.1)
    trial = run(truth, 0.04, operator=load, stiffness=40.0, duration_s=3.0)
    rests(trial, 1.1)
    assert np.abs(trial.output).max() < 0.5


def leaning(mean: float, seconds: float) -> Operator:
    """A person who leans with ``mean`` N·m, and sways with half of it at 2.5 Hz."""
    time = np.arange(round(seconds * 1e3)) * 1e-3
    push = mean * (1.0 + 0.5 * np.sin(math.tau * 2.5 * time)) * (1.0 - np.exp(-time / 0.3))
    return operator_of(0.95, 0.08, np.full(time.size, mean / 19.0), push=push, mass=0.005)


def test_a_leaning_person_is_not_let_down_by_a_probe() -> None:
    trial = run(VALUE, 0.02, operator=leaning(0.82, 3.0), stiffness=19.0, kick=0.0, duration_s=3.0)
    asked = int(np.flatnonzero(trial.stiffness < 19.0)[0])
    before, after = trial.output[:asked].max(), trial.output[asked:].max()
    assert after < before + math.radians(6.0), "a quarter of the stiffness lets the sway grow"
    assert trial.stiffness[-1] == 19.0
    assert trial.trip is None


@pytest.mark.parametrize("side", sampled(["above", "both"], 2))
def test_whoever_lets_go_in_a_probe_is_not_pushed(side: Side) -> None:
    """What holds the load ends near the surface, and the whole wall comes back there."""

    def moved(operator: Operator) -> Trial:
        wall = WallAsked(19.0, 0.02, side)
        return run_trial(VALUE, BENCH.sets, wall, operator, duration_s=3.4, position=0.0)

    stays = moved(leaning(0.82, 4.0))
    asked = int(np.flatnonzero(stays.stiffness < 19.0)[0])
    for later in (20, 80, 140):
        left = asked + later
        trial = moved(leaning(0.82, 1e-3 * left))
        out = -np.diff(trial.output[left:]).min() * 1e3
        # At most what the whole wall gives to whoever lets go at the deepest place until then.
        deepest = trial.output[left - 400 : left].max()
        inertia = VALUE.inertia
        assert 0.5 * inertia * out**2 < 1.2 * 0.5 * 19.0 * deepest**2
        assert trial.held[asked:left].all()
        assert trial.output[left:].min() > -1.5 * deepest or side == "above"
        assert trial.stiffness[-1] == 19.0
        assert trial.held[-1] == 0.0


@pytest.mark.parametrize("side", ["both", "above"])
@pytest.mark.parametrize("then", sampled([0.6, 0.45], 2))
def test_a_push_that_comes_in_a_probe_does_not_go_through(side: Side, then: float) -> None:
    """The probed wall and its hold are weaker than the push, which comes without turning points."""

    def moved(operator: Operator, duration_s: float) -> Trial:
        wall = WallAsked(19.0, 0.02, side)
        return run_trial(VALUE, BENCH.sets, wall, operator, duration_s=duration_s)

    asked = int(np.flatnonzero(moved(leaning(0.82, 4.0), 2.6).stiffness < 19.0)[0])
    sways = leaning(0.82, 1e-3 * (asked + 100))
    pushes = [(0.0, 0.02, 0.0, 0.0, 4.1 * then)] * 5000
    trial = moved(replace(sways, rows=[*sways.rows, *pushes]), 5.5)
    assert trial.stiffness[asked + 150] == 4.75, "it is still probed"
    assert np.abs(trial.output).max() < 7.0 * 4.1 * then / 19.0, "27 turns and more"
    assert trial.output[-1] == pytest.approx(4.1 * then / 19.0, rel=0.1)
    assert trial.stiffness[-1] == 19.0
    assert trial.trip is None


def test_a_load_that_eases_on_a_reduced_wall_stays_at_its_place() -> None:
    """Less than half of it was left, and its hold was dropped: it went through by four turns."""
    truth = replace(XL330, damping=0.0036617, no_load_speed=10.786, delay=0.0125)
    eases = np.interp(np.arange(9000) * 1e-3, [2.5, 5.5], [0.286, 0.129])
    load = operator_of(0.0, 0.0, np.zeros(9000), push=eases)
    sets = bench_of("xl330-m288").sets
    wall = WallAsked(1.32, 0.005)
    trial = run_trial(truth, sets, wall, load, duration_s=7.5, position=0.2667)
    assert trial.counts[2] == 1
    assert trial.trip is None
    assert np.abs(trial.output[2500:]).max() < 0.3
    assert trial.torque[-1] == pytest.approx(-0.129, abs=0.02)
    assert np.abs(np.diff(trial.torque[2500:])).max() < 0.05 * 0.52, "no step"


def test_the_log_says_what_was_commanded_while_a_load_is_held() -> None:
    truth = replace(VALUE, delay=0.004)
    load = operator_of(0.0, 0.0, np.zeros(3000), push=1.1)
    trial = run(truth, 0.04, operator=load, stiffness=40.0, duration_s=1.0)
    softer = trial.stiffness < 40.0
    assert softer.any()
    assert (trial.held[~softer] == 0.0).all()
    scale = trial.stiffness / 40.0
    spring = np.clip(-trial.stiffness * trial.measured, -4.1 * scale, 4.1 * scale)
    speed = np.diff(trial.measured, prepend=trial.measured[0]) * 1e3
    commanded = np.clip(spring + trial.held - trial.damping * speed, -4.1, 4.1)
    assert trial.torque[1:] == pytest.approx(commanded[1:], abs=0.005)


@pytest.mark.parametrize(("push", "kick"), [(0.5, 0.3), (0.8, 0.1)])
def test_a_reduced_wall_does_not_let_its_load_run_away(push: float, kick: float) -> None:
    """In the probe the smaller load slows the motion down beyond measure."""
    load = operator_of(0.0, 0.0, np.zeros(5000), push=push)
    trial = run(replace(VALUE, delay=0.004), 0.04, operator=load, stiffness=40.0, kick=kick)
    assert trial.first_alarm_s < 5.0
    assert np.abs(trial.output).max() < 2.0


def test_a_hand_that_presses_the_wall_like_a_button_ends_no_run() -> None:
    """Its spring throws the shaft back, faster than the hand has pressed it in."""
    limit = 0.5
    truth = Truth(0.011951, 0.011692, 0.09039, delay=0.001, torque_limit=limit)
    press = np.concatenate([np.linspace(-0.1, 0.2, 170), np.full(200, 0.2), np.full(300, -0.1)])
    free = np.concatenate([np.zeros(370), np.full(100, 1.0), np.full(200, 0.25)])
    grip = np.where(free > 0.0, 2.0 * (free < 1.0), 8.0)
    finger = operator_of(np.tile(grip, 9), 0.025 * np.tile(grip, 9), np.tile(press, 9))
    sets = (*BENCH.sets, f"servo.torque_limit={limit}")
    wall = WallAsked(10.0, 0.04, "above")
    trial = run_trial(truth, sets, wall, finger, duration_s=6.0, position=-0.1)
    assert trial.trip is None


def test_a_wall_that_throws_the_shaft_back_is_found_within_five_contacts() -> None:
    """It is pushed against steadily; the lag is twice what is believed."""
    truth = Truth(0.017927, 0.005846, 0.045195, torque_gain=1.35, delay=0.00385)
    push = operator_of(0.0, 0.0, np.zeros(5000), push=0.161)
    wall = WallAsked(98.3, 0.2, "above")
    trial = run_trial(truth, BENCH.sets, wall, push, duration_s=5.0, position=-0.09)
    assert trial.first_alarm_s < 2.0
    assert np.ptp(trial.output[-1000:]) < 0.02


def test_a_saturated_oscillation_kept_up_by_the_softer_wall_does_not_get_the_wall_back() -> None:
    """Small, it has the period that it had large; a hand would be left alone for ten seconds."""
    bench = bench_of("xl330-m288")
    truth = Truth(0.0027213, 0.0073234, 0.025666, torque_gain=2.0, delay=0.005, torque_limit=0.52)
    push = operator_of(0.0, 0.0, np.zeros(8000), push=-0.052)
    wall = WallAsked(12.03, 0.0025)
    trial = run_trial(truth, bench.sets, wall, push, duration_s=8.0, position=-0.3)
    assert trial.stiffness[-1] < trial.stiffness[0]
    assert trial.trip or np.ptp(trial.output[-1000:]) < 0.05


def test_a_saturated_oscillation_that_grows_fast_is_found_before_it_is_large() -> None:
    """Each half-cycle takes longer than the one before: its period is not regular."""
    trial = run(replace(VALUE, delay=0.01), 0.02, stiffness=50.0)
    assert trial.first_alarm_s < 1.0
    assert np.abs(trial.output).max() < 1.3
    assert np.abs(trial.output[-1000:]).max() < 0.5


def test_a_link_that_a_damper_shakes_too_fast_for_a_hand_is_found_however_rounded() -> None:
    """At 75 Hz and eleven counts rounding makes no half-cycle like the one before."""
    truth = Truth(
        *(0.0027213, 0.0018309, 0.0064165),
        torque_gain=2.0,
        current_bandwidth=110.5,
        torque_limit=0.52,
        load_inertia=0.00011356,
        transmission_stiffness=26.4,
        transmission_damping=0.0031,
    )
    sets = bench_of("xl330-m288").sets
    trial = run_trial(truth, sets, WallAsked(0.0, 0.1633), duration_s=2.0, struck=0.527)
    assert trial.first_alarm_s < 0.5
    assert np.ptp(trial.output[-500:]) < 4.0 * math.tau / 4096


def test_a_small_motion_that_a_reduced_wall_keeps_up_is_seen_and_ended() -> None:
    """Six counts at 15 Hz, of a law whose torque differs much from count to count."""
    truth = replace(VALUE, inertia=0.017927, damping=0.023384, coulomb=0.18078, torque_gain=1.35)
    truth = replace(truth, delay=0.002, back_emf="current", stall_torque=5.535)
    rows = (
        "[[-0.8, 1], [-0.466395, 0.225576], [0.439409, 0.188032], [0.44982, -0.133721], [0.8, -1]]"
    )
    wall = WallAsked(1413.446, 0.2)
    law = ("wall.law=profile", f"wall.profile={rows}")
    case = Case("xm430-w350", truth, wall, position=0.0347, velocity=2.645139, law=law)
    trial = case.run()
    assert trial.stiffness[-1] < 0.1 * trial.stiffness[0]
    assert not unseen(trial)


def pushed(times: list[float], pushes: list[float], duration_s: float) -> Trial:
    """A wall whose lag is not believed swings, and is pushed, linearly between times [s], [N·m]."""
    push = np.interp(np.arange(round(times[-1] * 1e3)) * 1e-3, times, pushes)
    return run(
        replace(VALUE, delay=0.005),
        0.02,
        operator=operator_of(0.0, 0.0, np.zeros(push.size), push=push),
        stiffness=11.5,
        kick=0.2,
        duration_s=duration_s,
    )


def test_a_push_on_a_wall_that_an_alarm_has_reduced_is_held() -> None:
    """A small turn on the way counted as a motion that goes on, and the torque before it as mean.

    The wall went down to a 64th, and the push went through it by more than a turn.
    """
    trial = pushed([3.0, 4.0, 5.0, 5.5, 9.0], [0.0, 1.23, 1.23, 0.984, 0.984], 8.5)
    assert trial.counts[2] == 1
    assert trial.stiffness[2900] == trial.stiffness[-1] == pytest.approx(11.5 / 4)
    assert np.abs(trial.output[3000:]).max() < 0.5
    assert trial.torque[-1] == pytest.approx(-0.984, abs=0.15)


def test_whoever_lets_go_on_a_wall_that_an_alarm_has_reduced_is_not_thrown() -> None:
    """The held torque reached as far past the surface as the old swing: 7.8 rad/s, 139 degrees."""
    trial = pushed([2.0, 3.0, 6.0], [0.0, 1.23, 1.23], 7.0)
    assert trial.counts[2] == 1
    let_go = trial.output[6000:]
    assert trial.held[5999] < -0.5, "most of the push is held"
    whole = let_go[0] * math.sqrt(11.5 / VALUE.inertia)
    assert np.abs(np.diff(let_go)).max() * 1e3 < 1.1 * whole
    assert let_go.min() > -3.0 * let_go[0], "a softer spring stops it later"


@pytest.mark.parametrize("mean", sampled([1.3, 1.85], 2))
def test_a_law_that_holds_no_load_is_not_probed_under_one(mean: float) -> None:
    """Probed, its limit was below the person's push: 37 and 78 degrees, and for good by turns."""
    stops = "wall.law=stops", "wall.low=-0.5", "wall.high=0.0"
    trial = run(
        VALUE, 0.02, *stops, operator=leaning(mean, 3.0), stiffness=19.0, kick=0.0, duration_s=3.0
    )
    assert trial.output.max() < 1.2 * 1.5 * mean / 19.0
    assert trial.stiffness.min() == 19.0


def test_a_free_range_is_never_probed() -> None:
    """There is no torque that could move the shaft, however evenly somebody swings it."""
    swung = 0.3 * np.sin(math.tau * 3.0 * np.arange(20_000) * 1e-3)
    stops = "wall.law=stops", "wall.low=-1.5", "wall.high=1.5"
    trial = run(
        VALUE, 0.02, *stops, operator=operator_of(20.0, 0.3, swung), stiffness=19.0, duration_s=20.0
    )
    assert np.ptp(trial.output) > 0.4
    assert trial.counts == (0, 0, 0)


def test_a_damped_wall_that_swings_under_a_load_is_found() -> None:
    """At its frequency late damping is most of the stiffness; the probe must take it, too."""
    truth = replace(XL330, inertia=0.0036284, damping=0.0036617, delay=0.02, back_emf="current")
    truth = replace(truth, no_load_speed=10.786)
    load = operator_of(0.0, 0.0, np.zeros(4000), push=0.104)
    wall = WallAsked(7.0, 0.219)
    sets = bench_of("xl330-m288").sets
    trial = run_trial(truth, sets, wall, load, duration_s=3.0, position=0.065)
    assert trial.counts[2] == 1
    assert np.ptp(trial.output[-500:]) < 0.01, "it went on by 3 degrees as a hand's"
