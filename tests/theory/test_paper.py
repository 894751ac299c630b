"""The paper's equations, each held against the exact boundary and the poles."""

from __future__ import annotations

import numpy as np
import pytest

from haptic_wall.controller.theory import critical_stiffness, max_virtual_damping, passive_limit
from haptic_wall.controller.theory.paper import (
    characteristic_polynomial,
    error_points,
    gain_margin,
    linear,
    linear_error,
    linear_limit,
    linear_no_delay,
    linear_one_sample,
    no_delay_condition,
    no_delay_limit,
    one_sample_determinant,
    one_sample_limit,
    one_sample_polynomial,
    passive_no_delay,
    start_error,
    to_dimensionless,
    to_si,
)
from tests.theory.oracles import Loop, radius, state_matrix


def random_walls(count: int, seed: int, delay: float) -> tuple[np.ndarray, np.ndarray]:
    """Delta from 1e-4 to 1, beta from -delta/2 to .95 of the ceiling."""
    random = np.random.default_rng(seed)
    delta = 10 ** random.uniform(-4, 0, count)
    top = 0.95 * max_virtual_damping(1.0, delta, 1.0, delay)
    return delta, -delta / 2 + (top + delta / 2) * random.random(count) ** 3


def test_table_i_there_and_back() -> None:
    inertia, period = np.array([0.01, 2.0]), 1e-3
    there = to_dimensionless(inertia, 0.02, 30.0, -0.01, period, 2.5e-3)
    np.testing.assert_allclose(there.delta, [2e-3, 1e-5])
    np.testing.assert_allclose(there.alpha, [3e-3, 1.5e-5])
    np.testing.assert_allclose(there.beta, [-1e-3, -5e-6])
    np.testing.assert_allclose(there.delay, 2.5)
    back = to_si(*there, inertia, period)
    for found, given in zip(back, (0.02, 30.0, -0.01, 2.5e-3), strict=True):
        np.testing.assert_allclose(found, given)


def test_the_linear_forms_are_one_condition() -> None:
    beta = np.array([-0.2, 0.0, 0.3])
    np.testing.assert_allclose(linear_no_delay(0.1, beta), [0, 0.2, 0.8])  # (4)
    np.testing.assert_allclose(linear_one_sample(0.1, beta), [0, 0.2 / 3, 0.8 / 3])  # (5), (14)
    # (8): K = (b + B) / (T/2 + t_d)
    m, t = 0.02, 1e-3
    k = linear(0.1, beta, 2.25) * m / t**2
    np.testing.assert_allclose(k, linear_limit(0.1 * m / t, beta * m / t, t, 2.25 * t))


def test_equation_6_is_passivity_without_delay() -> None:
    beta = np.array([-0.2, -0.05, 0.0, 0.07, 0.1])
    np.testing.assert_allclose(
        passive_no_delay(0.1, beta), passive_limit(0.1, beta, 1.0, 0.0), rtol=1e-9, atol=1e-15
    )


def test_equation_1_is_the_boundary_without_delay() -> None:
    delta, beta = random_walls(300, 1, 0.0)
    exact = critical_stiffness(1.0, delta, beta, 1.0, 0.0)
    # what its docstring says of cancellation, for the smallest delta here a part in 10^6
    error = np.abs(no_delay_limit(delta, beta) / exact - 1)
    assert np.all(error < 1e-14 / delta**2)
    assert np.all(error[delta > 1e-2] < 1e-9)
    heavy = delta > 1e-2
    assert np.all(no_delay_condition(delta, exact * (1 - 1e-8), beta)[heavy])
    assert not np.any(no_delay_condition(delta, exact * (1 + 1e-8), beta)[heavy])


def test_equation_13_is_the_boundary_of_one_sample() -> None:
    delta, beta = random_walls(300, 2, 1.0)
    exact = critical_stiffness(1.0, delta, beta, 1.0, 1.0)
    error = np.abs(one_sample_limit(delta, beta) / exact - 1)
    assert np.all(error < 1e-14 / delta**2)
    assert np.all(error[delta > 1e-2] < 1e-9)
    heavy = delta > 1e-2
    assert np.all(one_sample_determinant(delta, exact * (1 - 1e-7), beta)[heavy] > 0)
    assert np.all(one_sample_determinant(delta, exact * (1 + 1e-7), beta)[heavy] < 0)
    assert one_sample_limit(0.1, -0.1) == 0
    assert one_sample_limit(0.1, 1.01 * max_virtual_damping(1.0, 0.1, 1.0, 1.0)) == 0


@pytest.mark.parametrize("delay", [0, 1, 2, 5, 20])
@pytest.mark.parametrize("delta", [0.0, 1e-6, 0.3])
def test_equation_11_has_the_poles_of_the_loop(delta: float, delay: int) -> None:
    alpha, beta = 0.03, 0.05
    polynomial = characteristic_polynomial(delta, alpha, beta, delay)
    assert len(polynomial) == delay + 4  # order d + 3
    # the state matrix holds one more delayed torque, which nothing depends on: a pole at 0
    poles = np.poly(state_matrix(Loop(1.0, delta, alpha, beta, 1.0, float(delay))))
    np.testing.assert_allclose(np.append(polynomial, 0.0), poles, atol=1e-10)


def test_equation_12_is_equation_11_for_one_sample() -> None:
    for delta in (1e-2, 0.1, 1.0):
        np.testing.assert_allclose(
            one_sample_polynomial(delta, 0.3, 0.2),
            delta**2 * characteristic_polynomial(delta, 0.3, 0.2, 1),
            rtol=1e-9,
        )


def test_equation_15_is_the_boundary_for_any_delay() -> None:
    random = np.random.default_rng(4)
    for delay in [0.0, 1.0, 3.0, *random.uniform(0, 12, 20)]:
        delta, beta = random_walls(3, 5, delay)
        for wall in zip(delta.tolist(), beta.tolist(), strict=True):
            exact = critical_stiffness(1.0, wall[0], wall[1], 1.0, delay)
            assert gain_margin(*wall, delay) == pytest.approx(exact, rel=1e-9)
    # where a solver for the margin nearest to 1 says 3.91
    assert gain_margin(1e-4, 0.01, 3) == pytest.approx(0.00284, abs=5e-6)


def test_points_of_figure_10() -> None:
    # delta = 0: one point each, below the line, at a damping that falls with the delay
    for delay in (0.0, 0.5, 1.0, 3.0):
        for error in (0.02, 0.05):
            (point,) = error_points(0.0, delay, error)
            assert point.error == -error
            assert linear_error(0.0, point.beta, delay) == pytest.approx(-error, rel=1e-6)
            assert point.alpha == pytest.approx(
                (1 - error) * linear(0.0, point.beta, delay), rel=1e-9
            )
    # delta = .01, d = 3: above the line first
    above, below = error_points(0.01, 3.0, 0.02)
    assert (above.error, below.error) == (0.02, -0.02)
    assert above.beta == pytest.approx(-0.0084, abs=5e-5)
    assert below.beta == pytest.approx(0.0152, abs=5e-5)
    # just above the line the loop is still stable there, and at the line unstable further on
    for point, stable in ((above, True), (below, False)):
        line = float(linear(0.01, point.beta, 3.0))
        assert (radius(Loop(1.0, 0.01, line, point.beta, 1.0, 3.0)) < 1) == stable


def test_at_delta_001_the_error_is_above_2_percent_from_the_start_for_three_samples_up() -> None:
    drawn = (0.0, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0)
    assert [d for d in drawn if start_error(0.01, d) > 0.02] == [3.0]
    for delay in (3.0, 5.0, 10.0):
        assert start_error(0.01, delay) > 0.02
    assert start_error(0.01, 2.3) < 0.02 < start_error(0.01, 2.5)  # threshold near 2.4
    assert start_error(0.0, 3.0) == pytest.approx(0.0, abs=1e-5)


def test_errors_name_the_argument() -> None:
    with pytest.raises(ValueError, match=r"delay must be a whole number >= 0, got 1\.5"):
        characteristic_polynomial(0.1, 0.1, 0.1, 1.5)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="delta must be > 0, got 0"):
        no_delay_limit(0.0, 0.1)
    with pytest.raises(ValueError, match=r"error must be > 0, got -0\.02"):
        error_points(0.01, 1.0, -0.02)
    with pytest.raises(ValueError, match="beta must be above -delta"):
        linear_error(0.01, -0.01, 1.0)
    with pytest.raises(ValueError, match="inertia must be > 0, got 0"):
        to_dimensionless(0.0, 0.1, 1.0, 0.1, 1e-3, 0.0)
