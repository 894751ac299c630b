"""Pieces that decay at one rate, each from a height of its own."""

import numpy as np
import pytest

from haptic_wall.controller.experiments.identify.separable import (
    Linear,
    Linearised,
    fit_pieces,
)
from haptic_wall.controller.theory.checks import FloatArray

TIME = np.linspace(0.0, 1.0, 50)
HEIGHTS, RATE = np.array([[1.0, -2.0, 0.3]]), 2.0
MEASURED = HEIGHTS.T * np.exp(-RATE * TIME)
FREE = np.array([0.0]), np.array([np.inf])


def decaying(precision: float = 0.0, most: float = np.inf) -> Linearised:
    def linear(values: FloatArray, own: FloatArray) -> Linear:
        rate = values[0] if values[0] <= most else np.nan
        shape = np.broadcast_to(np.exp(-rate * TIME), MEASURED.shape)
        fitted = own.T * shape
        return Linear(
            fitted - MEASURED,
            -(TIME * fitted)[None],
            shape[None],
            np.ones(MEASURED.shape),
            np.array([precision]),
        )

    return linear


def fitted(
    linear: Linearised, begin: float, bounds: tuple[FloatArray, FloatArray] = FREE, **more: float
) -> tuple[float, FloatArray]:
    values, own = fit_pieces(
        linear, np.array([begin]), np.ones((1, 3)), bounds=bounds, rounds=40, enough=1e-12, **more
    )
    return float(values[0]), own


@pytest.mark.parametrize("begin", [0.1, 8.0])
def test_shared_and_own_values_are_found_together(begin: float) -> None:
    rate, own = fitted(decaying(), begin)
    assert rate == pytest.approx(RATE, rel=1e-6)
    assert own == pytest.approx(HEIGHTS, rel=1e-4)


def test_a_value_stays_within_its_bounds() -> None:
    rate, own = fitted(decaying(), 4.0, (np.array([3.0]), np.array([9.0])))
    assert rate == 3.0
    best = MEASURED @ np.exp(-3.0 * TIME) / np.sum(np.exp(-6.0 * TIME))
    assert own[0] == pytest.approx(best, rel=1e-4)


def test_values_without_a_finite_motion_are_not_taken() -> None:
    assert fitted(decaying(most=3.0), 0.5)[0] == pytest.approx(RATE, rel=1e-6)
    assert fitted(decaying(most=3.0), 5.0)[0] == 5.0  # there is no way back


def test_a_piece_at_rest_keeps_its_own_value() -> None:
    still = Linear(
        np.ones((1, 9)), np.ones((1, 1, 9)), np.full((1, 1, 9), 1e-4), np.ones((1, 9)), np.zeros(1)
    )
    assert still.own_part(still.left[None]) == pytest.approx(0.0)
    assert still.step() == pytest.approx(-1.0)
