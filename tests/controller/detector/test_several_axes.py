"""The watches of a two-link arm, which share one probe and one reduction, and hands at its tip."""

import math
from dataclasses import replace

import numpy as np
import pytest

from haptic_wall.controller.detector.half_cycles import HalfCycle, HalfCycles
from haptic_wall.controller.detector.regularity import Regularity
from haptic_wall.controller.detector.settings import WatchSettings
from tests.support.judges import called_quiet, own_oscillation
from tests.support.operators import operator_of
from tests.support.planar_arm import ArmCase, run_arm
from tests.support.truth import Truth
from tests.support.truths_drawn import bench_of

BENCH = bench_of("xm430-w350")
LATE = Truth(0.011951, 0.011692, 0.0453, delay=0.008)
"""Four times the believed lag"""
COUPLED = ArmCase("xm430-w350", (LATE, LATE), (0.12, 0.1), (0.6, 0.4), (16.0, 16.0), (0.04, 0.04))
GOOD = replace(COUPLED, truths=(replace(LATE, delay=0.001),) * 2, stiffness=(20.0, 20.0))


@pytest.mark.parametrize("stiffness", [(16.0, 16.0), (0.0, 16.0)])
def test_a_mode_of_the_arm_is_found_and_all_walls_are_reduced(
    stiffness: tuple[float, float],
) -> None:
    case = replace(COUPLED, stiffness=stiffness, damping=(0.04 * (stiffness[0] > 0), 0.04))
    told = run_arm(replace(case, duration_s=3.0), "report")
    assert max(np.ptp(trial.output[-1000:]) for trial in told) > 0.1, "it goes on"
    for trial, k in zip(run_arm(replace(case, duration_s=5.0)), stiffness, strict=True):
        assert trial.trip is None
        assert own_oscillation(trial, BENCH.belief).decays_s < 3.0
        assert not called_quiet(trial)
        assert trial.stiffness[-1] <= 0.25 * k


def test_two_motions_that_beat_are_found_though_no_half_cycle_is_like_the_one_before() -> None:
    first = replace(LATE, inertia=0.0102, coulomb=0.1425, torque_gain=0.795, delay=0.0036)
    second = replace(LATE, inertia=0.0179, damping=0.0234, torque_gain=0.7, delay=0.0028)
    case = ArmCase(
        "xm430-w350",
        (first, second),
        lengths=(0.1018, 0.0671),
        masses=(12.9, 17.4),
        stiffness=(215.0, 26.8),
        damping=(0.2, 0.02),
        pose=(0.0, -0.1013),
        start=(0.1251, 0.046),
        duration_s=12.0,
    )
    told, answered = run_arm(replace(case, duration_s=5.0), "report"), run_arm(case)
    assert min(np.ptp(trial.output[-1000:]) for trial in told) > 0.1, "it goes on"
    assert max(np.ptp(trial.output[-1000:]) for trial in answered) < 0.01


@pytest.mark.parametrize("pull", [0.0, 1.0])
def test_beating_takes_the_torque_of_a_wall_and_no_free_range(pull: float) -> None:
    settings = WatchSettings(1e-3, math.tau / 4096, "reduce", 0, torque_limit=2.0)
    motion = HalfCycles(1e-3, 0.0)
    seen = Regularity(motion, settings)
    for i in range(16):
        duration, end = 0.1 + 0.03 * (i % 3), 0.5 * (-1) ** i
        motion.last.append(HalfCycle(duration, 0.4 + 0.1 * (i % 3), 0.01, pull, 0.0, -end, end))
        seen.take(0.1 * i)
    assert seen.beats(20.0) == (pull > 0.0)


def test_a_probe_softens_every_wall() -> None:
    first, second = run_arm(replace(COUPLED, duration_s=1.5))
    assert first.counts[0] + second.counts[0] >= 1
    assert np.count_nonzero(first.stiffness < 16.0) > 200
    assert np.count_nonzero(first.stiffness != second.stiffness) < 50, "but for its return"


@pytest.mark.parametrize("hertz", [2.0, 10.0])
def test_a_hand_at_the_tip_gets_the_whole_walls_back(hertz: float) -> None:
    time = np.arange(6000) * 1e-3
    phase = math.tau * hertz * time + 0.1 * hertz * np.sin(3.0 * time)  # no machine
    hand = operator_of(15.0, 0.5, 0.15 * np.sin(phase))
    trials = run_arm(replace(GOOD, duration_s=7.0, start=(0.0, 0.0)), operator=hand, angle=0.8)
    for trial in trials:
        assert trial.trip is None
        assert math.isnan(trial.first_alarm_s)
        assert trial.stiffness[-1] == 20.0
    assert sum(trial.counts[1] for trial in trials) <= 4, "it is not probed again and again"


def test_a_load_at_rest_on_one_axis_stays_when_all_walls_become_softer() -> None:
    quick = replace(LATE, delay=0.001, coulomb=0.0)
    case = replace(
        COUPLED,
        truths=(quick, LATE),
        masses=(0.05, 0.002),
        start=(1.0 / 16.0, 0.02),
        loads=(1.0, 0.0),
        duration_s=4.0,
    )
    loaded, other = run_arm(case)
    assert not math.isnan(other.first_alarm_s)
    assert loaded.stiffness[-1] <= 4.0
    assert abs(loaded.output - 1.0 / 16.0).max() < 0.02, "not four times as far"
