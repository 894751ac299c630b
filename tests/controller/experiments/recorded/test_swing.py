"""The motion that is fitted is that of scipy's solver."""

import math
from pathlib import Path

import numpy as np
import pytest

from haptic_wall.controller.experiments.identify.motion import Motion, Pieces
from haptic_wall.controller.experiments.identify.motion import pieces_of as cut_at
from haptic_wall.controller.experiments.identify.motion_model import simulated
from haptic_wall.controller.experiments.recorded.estimate import Pendulum, identify_record
from haptic_wall.controller.experiments.recorded.friction import GAUSSIAN, MODELS
from haptic_wall.controller.experiments.recorded.record import pieces_of, record_of
from haptic_wall.controller.experiments.recorded.shooting import model_of
from tests.controller.experiments.recorded.made import Truth, swing

ROOT = Path(__file__).parents[4]


def terms_of(truth: Truth, **more: float) -> dict[str, float]:
    return {
        "damping": truth.damping / truth.total,
        "coulomb": truth.coulomb / truth.total,
        "sine": truth.weight * math.cos(truth.hanging) / truth.total,
        "cosine": -truth.weight * math.sin(truth.hanging) / truth.total,
        **more,
    }


def off(pieces: Pieces, terms: dict[str, float], begin: float) -> float:
    """How far the simulated motion is from the true one at most [rad]."""
    model = model_of(pieces, terms)
    own = np.array([[[begin]], [[0.0]]])
    left = model.left(model.begin[None], own)[0]
    return float(np.max(np.abs(left)[pieces.held]))


@pytest.mark.parametrize("interval", [0.001, 0.0035, 0.0085])
def test_a_free_swing_is_that_of_the_solver(interval: float) -> None:
    truth = Truth()
    time = np.arange(0.0, 2.5, interval)
    true = swing(truth, time, 0.9)
    columns = {"time_s": time, "position_rad": true, "torque_enabled": np.zeros(time.shape)}
    pieces, _ = pieces_of(record_of(columns).stretches)
    # Steps of 6 to 8.5 ms make a swing of 0.75 s faster by 0.02 %.
    assert off(pieces, terms_of(truth), 0.9) < 1.5e-3


def test_friction_is_that_of_the_published_models() -> None:
    """By hand from bam's equations: load 0.3 N·m, motor -0.1 N·m, at 1 rad/s and at next to none.

    A shaft that these turn loses the friction's torque: so does its speed within a short step.
    """
    given = {"coulomb": 0.01, "excess": 0.02, "fading": 1.0, "gear": 0.1}
    fades = math.exp(-1.0)
    wanted = {
        "M1": (0.01, 0.01),
        "M2": (0.03, 0.01 + 0.02 * fades),
        "M3": (0.05, 0.05),
    }
    step = 1e-6
    time = step * np.arange(3.0)
    motion = Motion(time, np.zeros(3), np.array([-1.0]), np.array([-0.1]))
    pieces = cut_at(motion, [(0, 3)])
    for name, each in wanted.items():
        values = {key: value for key, value in given.items() if key in MODELS[name]}
        # The weight of a horizontal pendulum pulls with 0.3 N·m.
        values |= {"inertia": 1e-3, "gain": 1.0, "cosine": -0.3, "exponent": GAUSSIAN}
        terms = {key: np.array([[value]]) for key, value in values.items()}
        for speed, friction in zip((1e-2, 1.0), each, strict=True):
            x = simulated(pieces, terms, np.array([[speed]]), np.zeros((1, 1)))[0, 0]
            net = 1e-3 * (x[2] - 2.0 * x[1] + x[0]) / step**2
            assert 0.3 - 0.1 - net == pytest.approx(friction, abs=2e-3), name


@pytest.mark.whole
def test_the_result_does_not_depend_on_where_the_horn_is_mounted() -> None:
    """The first 0.7 s of a real drop, whose standard errors changed tenfold."""
    file = ROOT / "docs" / "examples" / "xl330-pendulum" / "kp100_lift_and_drop.csv"
    names = file.read_text(encoding="utf-8").splitlines()[0].split(",")
    columns = dict(zip(names, np.loadtxt(file, delimiter=",", skiprows=1).T, strict=True))
    time = columns["time_s"]
    kept = time < time[columns["torque_enabled"] == 0.0][0] + 0.7
    one, other = (
        identify_record(
            record_of(
                {
                    "time_s": time[kept],
                    "position_rad": columns["position_rad"][kept] + shift,
                    "torque_enabled": columns["torque_enabled"][kept],
                }
            ),
            Pendulum(0.49, 0.1),
        )
        for shift in (0.0, 2.0)
    )
    for name in ("inertia_total", "damping", "coulomb"):
        here, there = one.known[name], other.known[name]
        assert there.value == pytest.approx(here.value, abs=0.02 * here.stderr)
        assert there.stderr == pytest.approx(here.stderr, rel=0.05)
    assert other.known["hanging"].value - one.known["hanging"].value == pytest.approx(2.0, 1e-3)
