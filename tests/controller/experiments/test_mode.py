"""The vibration mode in cruises whose truth is known, and what the guard is told of it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from haptic_wall.controller.experiments.identify.fit import VALUES, Fit
from haptic_wall.controller.experiments.identify.mode import Mode, mode_of
from haptic_wall.controller.experiments.identify.mode_fit import ModeModel, cruises_of
from haptic_wall.controller.experiments.identify.motion import Motion, pieces_of
from haptic_wall.controller.experiments.identify.vibration import (
    believed_vibration,
    heaviest_load,
    vibration_lines,
    vibration_of,
)
from haptic_wall.controller.guard.belief import Belief, Bounded
from tests.cases import sampled
from tests.typed import not_none

PERIOD, COUNT = 1e-3, math.tau / 4096
WHOLE, FRICTION = 0.015, 0.0117
"""Inertia and viscous friction"""


def moved(hertz: float, ratio: float, load: float) -> Motion:
    """Return a shaft that cruises to and fro while the torque sweeps; a load over the motor's."""
    motor = WHOLE / (1.0 + load)
    behind = WHOLE - motor
    moving, w = motor * behind / WHOLE, math.tau * hertz
    k, c = moving * w * w, 2.0 * ratio * moving * w
    # states: position and speed of both, and the held torque
    rates = np.zeros((5, 5))
    rates[0, 1] = rates[2, 3] = 1.0
    rates[1] = np.array([-k, -c - FRICTION, k, c, 1.0]) / motor
    rates[3] = np.array([k, c, -k, -c, 0.0]) / behind
    step = expm(rates * PERIOD)
    samples, torques = [], []
    for way, (low, high) in [
        (w, band) for band in ((6, 12), (10, 25), (20, 60), (50, 130)) for w in (1, -1)
    ]:
        time = PERIOD * np.arange(400)
        phase = math.tau * (low * time + 0.5 * (high - low) * time**2 / 0.4)
        torque = 0.45 * WHOLE * math.tau * low * np.sin(phase) + way * 1.5 * FRICTION
        state = np.array([0.0, way * 1.5, 0.0, way * 1.5, 0.0])
        for each in torque.tolist():
            samples.append(state[2])
            state[4] = each
            state = step @ state
        torques.append(torque)
    position = np.round(np.array(samples) / COUNT) * COUNT
    at = PERIOD * np.arange(position.size, dtype=np.float64)
    return Motion(at, position, at.copy(), np.concatenate(torques))


def found_in(motion: Motion) -> Mode:
    spans = [(0.4 * n - 0.02, 0.4 * (n + 1) - 1e-6, 1.0 - 2.0 * (n % 2)) for n in range(8)]
    values = {**dict.fromkeys(VALUES, 0.0), "inertia": WHOLE, "damping": FRICTION}
    fit = Fit(values, (), pieces_of(motion, [(0, 1)]), np.zeros((1, 1)))
    cruises = cruises_of(motion, spans, PERIOD, fit)
    return mode_of(ModeModel(cruises, WHOLE))


def believed(inertia: float) -> Belief:
    known = Bounded.exactly
    return Belief(known(inertia), known(FRICTION), known(0.09), known(1e-3), known(1.0))


@pytest.mark.parametrize(
    ("hertz", "ratio", "load"), sampled([(38.0, 0.02, 0.3), (110.0, 0.01, 1.0)], 2)
)
def test_a_vibration_is_found_within_its_bounds(hertz: float, ratio: float, load: float) -> None:
    mode = found_in(moved(hertz, ratio, load))
    assert mode.hertz.low <= hertz <= mode.hertz.high < 1.1 * mode.hertz.low
    by_motor = FRICTION * load / (2.0 * math.tau * hertz * WHOLE)
    damped = not_none(mode.ratio)
    assert damped.low <= ratio + by_motor <= damped.high < 5.0 * ratio
    assert mode.inertia == pytest.approx(WHOLE, rel=0.02)


def test_of_a_rigid_servo_a_lower_bound_is_told_and_believed() -> None:
    mode = found_in(moved(5000.0, 0.05, 0.1))
    assert mode.ratio is None
    assert mode.hertz.low > 100.0
    found = vibration_of(mode, FRICTION, 1.0, 1.0, 1000.0)
    assert "below" in " ".join(vibration_lines(found))
    rigid = believed(WHOLE)
    told = believed_vibration(found, rigid)
    assert told["flexible_hz"]["low"] == pytest.approx(mode.hertz.low, rel=1e-5)
    assert told["flexible_damping_ratio"]["low"] == 0.005
    horn = replace(
        rigid, load_inertia=Bounded.exactly(1e-6), flexible_hz=Bounded(3000.0, 2000.0, 4000.0)
    )
    assert believed_vibration(found, horn) == {}  # more was known
    slow = replace(horn, flexible_hz=Bounded(60.0, 20.0, 90.0))
    assert believed_vibration(found, slow)["flexible_hz"]["low"] > 100.0


def test_friction_on_the_motor_is_taken_from_the_damping_ratio() -> None:
    mode = Mode(Bounded(10.0, 9.9, 10.1), Bounded(0.02, 0.018, 0.022), WHOLE)
    found = vibration_of(mode, 0.03, 1.0, 2.0, 1000.0)
    assert found.ratio is not None
    by_motor = 0.03 * 2.0 / (2.0 * math.tau * 10.0 * WHOLE)
    assert found.ratio.low == pytest.approx(max(0.018 - by_motor, 1e-4))
    assert found.ratio.low <= found.ratio.value <= found.ratio.high == 0.022
    assert found.load_inertia.high == pytest.approx(WHOLE * 2.0 / 3.0)


def test_a_servo_heavier_than_believed_may_have_that_much_load() -> None:
    bare = believed(0.006)
    assert heaviest_load(WHOLE, bare) == pytest.approx(1.5)
    assert heaviest_load(0.006, bare) == 1.0
