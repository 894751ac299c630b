"""The trials around a link's ceiling: the trial servo has the exact one, walls are judged."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from haptic_wall.controller.theory import critical_stiffness
from haptic_wall.hw.clock import SimulatedClock
from scripts.trials.beyond_ceiling import (
    SHARES,
    ceiling_of,
    draw_linked,
    draw_walls,
    limit_of,
    vibration,
)
from scripts.trials.cases import PRESETS, Case
from scripts.trials.passive_ceiling import CONTROL, controlled, link_believed
from scripts.trials.run import WallAsked
from scripts.trials.servo import TrialServo
from scripts.trials.truth import Truth
from scripts.trials.verdicts import small, sustains

LINKED = Truth(
    inertia=0.0177,
    damping=0.0075,
    torque_gain=0.91,
    delay=0.44e-3,
    current_bandwidth=219.0,
    load_inertia=0.0062,
    transmission_stiffness=71.9,
    transmission_damping=0.0221,
)
"""A link that vibrates at 21 Hz on an XM430, without Coulomb friction"""


def _growth(truth: Truth, stiffness: float, damping: float) -> float:
    """Amplitude of the vibration after two seconds over that after one, without rounding."""
    smooth = replace(truth, coulomb=0.0, counts_per_rev=0, torque_limit=1e9, torque_step=0.0)
    clock = SimulatedClock()
    servo = TrialServo(smooth, clock)
    share = truth.load_inertia / truth.inertia
    servo.body.motor_velocity, servo.body.velocity = -share, 1.0 - share  # at rest as a whole
    last = 0.0
    for tick in range(2000):
        clock.wait_until(tick * 1_000_000)
        servo.request()
        position = servo.collect(0).position
        servo.write(-stiffness * position - damping * (position - last) / 1e-3)
        last = position
    speed = np.abs(np.diff(servo.outputs))
    return float(speed[1500:].max() / speed[500:1000].max())


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("seed", range(3))
def test_a_vibration_grows_above_the_exact_ceiling_and_dies_below(preset: str, seed: int) -> None:
    """With fractions of a period and a current loop, in a simulation that shares no formula."""
    truth = draw_linked(preset, np.random.default_rng(seed), friction=True)
    assert truth.coulomb > 0.0 and truth.current_bandwidth >= 100.0
    ceiling = ceiling_of(truth)
    assert _growth(truth, 0.0, 0.95 * ceiling) < 1.0 < _growth(truth, 0.0, 1.05 * ceiling)
    stiffness = limit_of(truth, 0.5 * ceiling)
    assert _growth(truth, 0.5 * stiffness, 0.5 * ceiling) < 1.0


def test_every_share_meets_the_same_servos() -> None:
    drawn = [draw_walls(PRESETS[0], share, 4, np.random.default_rng(5)) for share in SHARES]
    first = drawn[0]
    for share, cases in zip(SHARES, drawn, strict=True):
        assert [case.truth for case in cases] == [case.truth for case in first]
        ratios = [case.wall.damping / ceiling_of(case.truth) for case in cases]
        assert ratios == pytest.approx([share] * 4)
    assert [case.wall.stiffness > 0.0 for case in first] == [False, False, True, True]
    assert [case.truth.coulomb > 0.0 for case in first] == [True, False, True, False]


def _wall(share: float) -> Case:
    """A wall on that servo, let go, with its link struck."""
    wall = WallAsked(30.4, share * ceiling_of(LINKED))
    return Case(PRESETS[0], LINKED, wall, position=0.229, struck=1.2)


@pytest.mark.whole
def test_a_wall_at_twice_the_ceiling_is_told_from_one_below() -> None:
    found = vibration(_wall(2.0))
    assert found.lasts and found.alarm_s < 2.0
    assert found.at_alarm > 1.0
    below = vibration(_wall(0.5))
    assert not (below.lasts or below.hums or below.large) and math.isnan(below.alarm_s)
    assert below.reduced is None


@pytest.mark.whole
def test_passivity_control_with_a_known_link_adds_nothing_near_its_ceiling() -> None:
    case = _wall(0.9)
    found = controlled(replace(case, law=link_believed(case.truth)))
    assert found.injected == pytest.approx(0.0, abs=1e-9)
    assert found.amplitude[0] == found.amplitude[1]


def test_passivity_control_stabilises_the_fastest_rigid_servo_of_a_belief() -> None:
    """Its wall swings 1.7 times as fast as the believed servo's, and more with late damping."""
    inertia, damping, gain, delay = 0.00121, 0.00366, 2.0, 0.005
    dampings = np.linspace(0.0, 1.5 * inertia / (delay + 1e-3), 200)
    limits = critical_stiffness(inertia, damping, dampings, 1e-3, delay)
    virtual = 0.7 * dampings[np.argmax(limits)]
    stiffness = 1.05 * float(np.interp(virtual, dampings, limits))
    truth = Truth(inertia=inertia, damping=damping, torque_gain=gain, delay=delay)
    wall = WallAsked(stiffness / gain, virtual / gain)
    case = Case("xl330-m288", truth, wall, position=0.1, duration_s=2.5, law=(CONTROL,))
    found = case.run("report")
    assert 0.5 * np.ptp(found.output[-300:]) < 0.005
    assert math.isnan(found.first_alarm_s)


def test_passivity_control_does_not_feed_a_vibration_of_a_link_that_nobody_believes() -> None:
    """Below its ceiling the vibration dies; the damping added for the kick must not keep it up."""
    case = _wall(0.9)
    plain = case.run("report")
    found = replace(case, law=(CONTROL,)).run("report")
    assert found.damping[:1000].max() > 1.5 * case.wall.damping, "it acts, as nothing is believed"
    assert not sustains(plain, small())
    assert not sustains(found, small())
