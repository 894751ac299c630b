"""The paper's equations, each held against the exact boundary and the poles."""

from __future__ import annotations

import numpy as np
import pytest

from haptic_wall.controller.paper.closed_forms import no_delay_limit, one_sample_limit
from haptic_wall.controller.paper.error_points import error_points
from haptic_wall.controller.theory import critical_stiffness, linear_limit, max_virtual_damping
from tests.theory.oracles import Loop, radius


def random_walls(count: int, seed: int, delay: float) -> tuple[np.ndarray, np.ndarray]:
    """Delta from 1e-4 to 1, beta from -delta/2 to .95 of the ceiling."""
    random = np.random.default_rng(seed)
    delta = 10 ** random.uniform(-4, 0, count)
    top = 0.95 * max_virtual_damping(1.0, delta, 1.0, delay)
    return delta, -delta / 2 + (top + delta / 2) * random.random(count) ** 3


def test_equation_1_is_the_boundary_without_delay() -> None:
    delta, beta = random_walls(300, 1, 0.0)
    exact = critical_stiffness(1.0, delta, beta, 1.0, 0.0)
    # what its docstring says of cancellation, for the smallest delta here a part in 10^6
    error = np.abs(no_delay_limit(delta, beta) / exact - 1)
    assert np.all(error < 1e-14 / delta**2)
    assert np.all(error[delta > 1e-2] < 1e-9)


def test_equation_13_is_the_boundary_of_one_sample() -> None:
    delta, beta = random_walls(300, 2, 1.0)
    exact = critical_stiffness(1.0, delta, beta, 1.0, 1.0)
    error = np.abs(one_sample_limit(delta, beta) / exact - 1)
    assert np.all(error < 1e-14 / delta**2)
    assert np.all(error[delta > 1e-2] < 1e-9)
    assert one_sample_limit(0.1, -0.1) == 0
    assert one_sample_limit(0.1, 1.01 * max_virtual_damping(1.0, 0.1, 1.0, 1.0)) == 0


@pytest.mark.whole
def test_points_of_figure_10() -> None:
    # delta = 0: one point each, below the line, at a damping that falls with the delay
    for delay in (0.0, 0.5, 1.0, 3.0):
        for error in (0.02, 0.05):
            (point,) = error_points(0.0, delay, error)
            assert point.error == -error
            assert point.alpha == pytest.approx(
                (1 - error) * linear_limit(0.0, point.beta, 1.0, delay), rel=1e-9
            )
    # delta = .01, d = 3: above the line first
    above, below = error_points(0.01, 3.0, 0.02)
    assert (above.error, below.error) == (0.02, -0.02)
    assert above.beta == pytest.approx(-0.0084, abs=5e-5)
    assert below.beta == pytest.approx(0.0152, abs=5e-5)
    # just above the line the loop is still stable there, and at the line unstable further on
    for point, stable in ((above, True), (below, False)):
        line = float(linear_limit(0.01, point.beta, 1.0, 3.0))
        assert (radius(Loop(1.0, 0.01, line, point.beta, 1.0, 3.0)) < 1) == stable
