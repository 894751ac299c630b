"""Passivity control on servos that are faster than believed, and on a link that nobody believes."""

import math
from dataclasses import replace

import numpy as np
import pytest

from haptic_wall.controller.theory import critical_stiffness
from tests.support.judges import small, sustains
from tests.support.links_drawn import ceiling_of
from tests.support.trial import Case, WallAsked
from tests.support.truth import Truth

CONTROL = ("wall.passivity_control=true",)
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
WALL = Case(
    "xm430-w350", LINKED, WallAsked(30.4, 0.9 * ceiling_of(LINKED)), position=0.229, struck=1.2
)
"""Let go below the link's ceiling, with the link struck"""


def test_it_stabilises_the_fastest_rigid_servo_of_a_belief() -> None:
    """Its wall swings 1.7 times as fast as the believed servo's, and more with late damping."""
    inertia, damping, gain, delay = 0.00121, 0.00366, 2.0, 0.005
    dampings = np.linspace(0.0, 1.5 * inertia / (delay + 1e-3), 200)
    limits = critical_stiffness(inertia, damping, dampings, 1e-3, delay)
    virtual = 0.7 * dampings[np.argmax(limits)]
    stiffness = 1.05 * float(np.interp(virtual, dampings, limits))
    truth = Truth(inertia=inertia, damping=damping, torque_gain=gain, delay=delay)
    wall = WallAsked(stiffness / gain, virtual / gain)
    found = Case("xl330-m288", truth, wall, position=0.1, duration_s=2.5, law=CONTROL).run("report")
    assert 0.5 * np.ptp(found.output[-300:]) < 0.005
    assert math.isnan(found.first_alarm_s)


@pytest.mark.whole
def test_it_does_not_feed_a_vibration_of_a_link_that_nobody_believes() -> None:
    """Below its ceiling the vibration dies; the damping added for the kick must not keep it up."""
    found = replace(WALL, law=CONTROL).run("report")
    assert found.damping[:1000].max() > 1.5 * WALL.wall.damping, "it acts, as nothing is believed"
    assert not sustains(WALL.run("report"), small())
    assert not sustains(found, small())
