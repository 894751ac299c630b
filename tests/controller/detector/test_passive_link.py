"""Passivity control on servos that are faster than believed."""

import math

import numpy as np

from haptic_wall.controller.theory import critical_stiffness
from tests.support.trial import Case, WallAsked
from tests.support.truth import Truth

CONTROL = ("wall.passivity_control=true",)


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
