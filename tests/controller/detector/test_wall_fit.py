"""The wall of a recording is found from its torques."""

import math

import numpy as np
import pytest

from haptic_wall.controller.detector.wall_fit import fitted_wall
from haptic_wall.controller.theory.checks import FloatArray
from tests.typed import not_none

T, STEP = 1e-3, math.tau / 4096


def rendered(
    stiffness: float,
    damping: float,
    surface: float,
    side: int = 0,
    late: int = 0,
    limit: float = math.inf,
) -> tuple[FloatArray, FloatArray]:
    times = np.arange(0.0, 3.0, T)
    moved = 0.1 * np.sin(9.0 * times) * np.exp(0.2 * times) + 0.02 * np.sin(23.0 * times)
    positions = np.round((moved + 0.03) / STEP) * STEP
    speeds = np.concatenate([[0.0], np.diff(positions)]) / T
    torques = np.clip(-stiffness * (positions - surface) - damping * speeds, -limit, limit)
    if side:
        outside = (side * (positions - surface) <= 0.0) | (side * torques >= 0.0)
        torques = np.where(outside, 0.0, torques)
    return positions, np.concatenate([np.zeros(late), torques[: torques.size - late]])


@pytest.mark.parametrize("side", [0, 1, -1])
@pytest.mark.parametrize(("late", "limit"), [(0, math.inf), (3, math.inf), (0, 0.6)])
def test_a_wall_is_found_from_torque_against_position(side: int, late: int, limit: float) -> None:
    wall = not_none(fitted_wall(*rendered(8.0, 0.02, 0.01, side, late, limit), T))
    assert wall.stiffness == pytest.approx(8.0, rel=1e-3)
    assert wall.virtual_damping == pytest.approx(0.02, abs=1e-4)
    assert wall.surface == pytest.approx(0.01, abs=1e-4)
    assert wall.side == side
    assert wall.inserted == pytest.approx(late * T)


def test_no_damping_is_found_to_be_none() -> None:
    assert not_none(fitted_wall(*rendered(8.0, 0.0, 0.0), T)).virtual_damping == 0.0


def test_a_position_that_is_missing_is_no_obstacle() -> None:
    positions, torques = rendered(8.0, 0.02, 0.01)
    positions[500:600], torques[700:710] = math.nan, math.nan
    assert not_none(fitted_wall(positions, torques, T)).stiffness == pytest.approx(8.0, rel=1e-3)


def test_torques_of_something_else_are_no_walls() -> None:
    positions, torques = rendered(8.0, 0.0, 0.0)
    noise = np.random.default_rng(1).normal(0.0, 0.3, torques.size)
    assert fitted_wall(positions, noise, T) is None
    assert fitted_wall(positions, -torques, T) is None, "it pulls apart"
    assert fitted_wall(positions, np.zeros_like(torques), T) is None
    changed = np.where(np.arange(torques.size) < 1500, torques, 0.25 * torques)
    assert fitted_wall(positions, changed, T) is None
