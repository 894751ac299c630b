"""The linear condition: sum of damping over sum of delay."""

from __future__ import annotations

import numpy as np
import pytest

from haptic_wall.controller.theory import critical_stiffness, linear_limit


def test_sum_of_damping_over_sum_of_delay() -> None:
    assert linear_limit(0.1, 0.4, 1e-3, 0.0) == pytest.approx(1000.0)
    # d = 1: alpha < (2/3)(delta + beta), Gil et al., eq. (5)
    assert linear_limit(0.1, 0.2, 1.0, 1.0) == pytest.approx(0.2)


def test_it_is_the_tangent_of_the_exact_boundary_at_the_origin() -> None:
    late = np.array([0.0, 0.3, 1.0, 4.7])
    # both dampings small: the difference is of their order
    ratio = critical_stiffness(1.0, 1e-6, 1e-6, 1.0, late) / linear_limit(1e-6, 1e-6, 1.0, late)
    np.testing.assert_allclose(ratio, 1, atol=1e-5)


def test_never_below_zero() -> None:
    assert linear_limit(0.1, -0.2, 1e-3, 0.0) == 0


def test_errors_name_the_argument() -> None:
    with pytest.raises(ValueError, match="period must be > 0, got 0"):
        linear_limit(0.1, 0.0, 0.0, 0.0)
