"""The speeds that the guard reports beside a one-sided wall's limit."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from haptic_wall.controller.guard.belief import Belief, Bounded
from haptic_wall.controller.guard.guard import Situation
from haptic_wall.controller.guard.rebound import rebound

KNOWN = Situation(
    Belief(
        inertia=Bounded(0.012, 0.008, 0.018),
        damping=Bounded(0.0117, 0.0058, 0.0234),
        coulomb=Bounded(0.09, 0.045, 0.18),
        delay=Bounded(0.001, 0.0, 0.002),
        torque_gain=Bounded(1.0, 0.7, 1.35),
    ),
    period=1e-3,
    torque_limit=4.1,
    position_step=2 * np.pi / 4096,
)
DELAY = 2.2e-3


def test_friction_stronger_than_one_count_leaves_no_low_end() -> None:
    found = rebound(2.0, 0.005, "above", 1, KNOWN, DELAY)
    assert found.lowest is None
    assert found.highest is not None
    assert found.highest > 4.8  # more than an XM430 reaches


def test_the_least_friction_that_is_believed_in_counts() -> None:
    bare = replace(KNOWN, belief=replace(KNOWN.belief, coulomb=Bounded(0.09, 0.0, 0.18)))
    with_some = rebound(7.0, 0.04, "below", 1, KNOWN, DELAY).lowest
    without = rebound(7.0, 0.04, "below", 1, bare, DELAY).lowest
    assert with_some is not None
    assert without is not None
    assert 0 < with_some < without


def test_a_clip_below_the_servos_limit_lowers_the_high_end() -> None:
    servo = rebound(2.0, 0.005, "above", 1, KNOWN, DELAY).highest
    clipped = rebound(2.0, 0.005, "above", 1, KNOWN, DELAY, torque_limit=0.5).highest
    assert servo is not None
    assert clipped is not None
    assert clipped < servo / 8


def test_above_the_limit_nothing_is_promised() -> None:
    found = rebound(100.0, 0.005, "above", 1, KNOWN, DELAY)
    assert found.report() == {"rebound_speed": 0.0, "rebound_speed_high": 0.0}


def test_a_two_sided_wall_promises_nothing_of_the_kind() -> None:
    found = rebound(2.0, 0.005, "both", 1, KNOWN, DELAY)
    assert found.report() == {"rebound_speed": None, "rebound_speed_high": None}


def test_a_wall_without_stiffness_and_damping_is_reported_without_infinity() -> None:
    found = rebound(0.0, 0.0, "above", 1, KNOWN, DELAY)
    assert found.highest == math.inf
    assert found.report() == {"rebound_speed": None, "rebound_speed_high": None}
