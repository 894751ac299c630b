"""The motion that is fitted is that of scipy's solver."""

import math

import numpy as np
import pytest

from haptic_wall.controller.experiments.recorded.friction import MODELS, dry_friction
from haptic_wall.controller.experiments.recorded.record import pieces_of, record_of
from haptic_wall.controller.experiments.recorded.shooting import moved
from tests.controller.experiments.recorded.made import Truth, swing


def terms_of(truth: Truth, **more: float) -> tuple[tuple[str, ...], np.ndarray]:
    values = {
        "damping": truth.damping / truth.total,
        "coulomb": truth.coulomb / truth.total,
        "sine": truth.weight * math.cos(truth.hanging) / truth.total,
        "cosine": -truth.weight * math.sin(truth.hanging) / truth.total,
        **more,
    }
    return tuple(values), np.array([list(values.values())])


@pytest.mark.parametrize("interval", [0.001, 0.0035, 0.0085])
def test_a_free_swing_is_that_of_the_solver(interval: float) -> None:
    truth = Truth()
    time = np.arange(0.0, 2.5, interval)
    true = swing(truth, time, 0.9)
    columns = {"time_s": time, "position_rad": true, "torque_enabled": np.zeros(time.shape)}
    pieces, _ = pieces_of(record_of(columns).stretches)
    names, values = terms_of(truth)
    found = moved(pieces, names, values, np.array([[0.9]]), np.zeros((1, 1)))[0]
    # the steps of up to 8.5 ms are short against a swing of 0.75 s
    assert np.max(np.abs(found - pieces.position)[pieces.held]) < 2e-4


@pytest.mark.whole
def test_a_driven_motion_is_that_of_the_solver() -> None:
    truth = Truth()
    time = np.arange(0.0, 2.0, 0.005)
    torque = 0.2 * np.sin(9.0 * time) + 0.15 * np.sign(np.sin(4.0 * time))
    true = swing(truth, time, truth.hanging, torque)
    pieces, _ = pieces_of(
        record_of({"time_s": time, "position_rad": true, "torque_nm": torque}).stretches
    )
    names, values = terms_of(truth, gain=truth.gain / truth.total, delay=truth.delay)
    at = np.full((1, 1), truth.hanging)
    found = moved(pieces, names, values, at, np.zeros((1, 1)))[0]
    # a torque that changes within a step counts by its mean
    assert np.max(np.abs(found - pieces.position)[pieces.held]) < 2e-3


def test_friction_is_that_of_the_published_models() -> None:
    """By hand from bam's equations: load 0.3 N·m, motor -0.1 N·m, at rest and at 1 rad/s."""
    given = {
        "coulomb": 0.01, "stribeck": 0.02, "stribeck_speed": 1.0, "load": 0.1,
        "load_stribeck": 0.2, "load_motor": 0.3, "load_motor_stribeck": 0.4,
        "load_quadratic": 0.5, "load_motor_quadratic": 0.6,
    }  # fmt: skip
    fades = math.exp(-1.0)
    wanted = {
        "M1": (0.01, 0.01),
        "M2": (0.03, 0.01 + 0.02 * fades),
        "M3": (0.05, 0.05),
        "M4": (0.15, 0.05 + 0.1 * fades),
        "M5": (0.07 + 0.12, 0.07 + 0.12 * fades),
        "M6": (0.07 + 0.126, 0.07 + 0.126 * fades),
    }
    for name, each in wanted.items():
        own = {term.name for term in MODELS[name]}
        terms = {key: np.array([value]) for key, value in given.items() if key in own}
        load, motor = np.array([0.3]), np.array([-0.1])
        found = [
            float(dry_friction(terms, load, motor, np.array([speed]))[0]) for speed in (0.0, 1.0)
        ]
        assert found == pytest.approx(each), name
