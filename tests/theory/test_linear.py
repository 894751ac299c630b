"""The linear condition: sum of damping over sum of delay."""

from __future__ import annotations

import pytest

from haptic_wall.controller.theory import linear_limit


def test_sum_of_damping_over_sum_of_delay() -> None:
    assert linear_limit(0.1, 0.4, 1e-3, 0.0) == pytest.approx(1000.0)
    # d = 1: alpha < (2/3)(delta + beta), Gil et al., eq. (5)
    assert linear_limit(0.1, 0.2, 1.0, 1.0) == pytest.approx(0.2)


def test_never_below_zero() -> None:
    assert linear_limit(0.1, -0.2, 1e-3, 0.0) == 0


def test_errors_name_the_argument() -> None:
    with pytest.raises(ValueError, match="period must be > 0, got 0"):
        linear_limit(0.1, 0.0, 0.0, 0.0)
