"""Positive roots of polynomials, against roots that were chosen."""

from __future__ import annotations

import numpy as np
import pytest

from haptic_wall.controller.theory.real_roots import positive_roots


def found(*coefficients: float) -> list[float]:
    return sorted(positive_roots(np.array([coefficients])).at.tolist())


@pytest.mark.parametrize("degree", [1, 2, 5, 9])
def test_every_positive_root_is_found_among_negative_and_complex_ones(degree: int) -> None:
    random = np.random.default_rng(degree)
    expected, polynomials = [], []
    for _ in range(300):
        # neighbours are at least a tenth apart, or double precision does not hold them
        positive = np.cumprod(1.1 + 10 ** random.uniform(-2, 1, random.integers(0, degree + 1)))
        positive *= 10 ** random.uniform(-4, 0)
        others = [*positive]
        while len(others) + 2 <= degree and random.random() < 0.5:
            one = complex(*random.normal(size=2)) * 10 ** random.uniform(-2, 2)
            others += [one, one.conjugate()]
        others += [-(10 ** random.uniform(-4, 4)) for _ in range(degree - len(others))]
        polynomials.append(random.choice([-1, 1]) * np.poly(others).real[::-1])
        expected.append(positive)
    roots = positive_roots(np.array(polynomials))
    for i, positive in enumerate(expected):
        np.testing.assert_allclose(np.sort(roots.at[roots.row == i]), positive, rtol=1e-4)


def test_roots_of_simple_polynomials() -> None:
    assert found(-2.0, 1.0) == pytest.approx([2.0], rel=1e-8)
    assert found(2.0, 1.0) == []
    assert found(2.0, -3.0, 1.0) == pytest.approx([1.0, 2.0], rel=1e-8)
    assert found(1.0, 0.0, 1.0) == []
    assert found(1e-9, -1.0, 1e-9) == pytest.approx([1e-9, 1e9], rel=1e-8)


def test_a_double_root_is_none() -> None:
    """The sign does not change there."""
    assert found(1.0, -2.0, 1.0) == []
    assert found(-3.0, 7.0, -5.0, 1.0) == pytest.approx([3.0], rel=1e-8)


def test_two_roots_side_by_side_are_two() -> None:
    assert found(1.0 + 1e-7, -2.0 - 1e-7, 1.0) == pytest.approx([1.0, 1.0 + 1e-7], rel=1e-8)
