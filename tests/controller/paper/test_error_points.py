"""The points of figure 10, held against the linear limit and the poles."""

from __future__ import annotations

import pytest

from haptic_wall.controller.paper.error_points import error_points
from haptic_wall.controller.theory import linear_limit
from tests.theory.oracles import Loop, radius


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


def test_an_error_names_the_argument() -> None:
    with pytest.raises(ValueError, match=r"error must be > 0, got -0\.02"):
        error_points(0.01, 1.0, -0.02)
