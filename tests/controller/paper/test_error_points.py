"""The points of figure 10, held against the linear limit and the poles."""

from __future__ import annotations

import pytest

from haptic_wall.controller.paper.linear_error import error_points
from haptic_wall.controller.theory import linear_limit
from tests.theory.oracles import Loop, radius


@pytest.mark.whole
def test_points_of_figure_10() -> None:
    # delta = 0: one point each, below the line, at a damping that falls with the delay
    for delay in (0.0, 0.5, 1.0, 3.0):
        for percent in (2.0, 5.0):
            (point,) = error_points(0.0, delay, percent)
            assert point.settings["error_percent"] == -percent
            line = linear_limit(0.0, point.x, 1.0, delay)
            assert point.y == pytest.approx((1 - percent / 100) * line, rel=1e-9)
    # delta = .01, d = 3: above the line first
    above, below = error_points(0.01, 3.0, 2.0)
    assert [each.settings["error_percent"] for each in (above, below)] == [2.0, -2.0]
    assert above.x == pytest.approx(-0.0084, abs=5e-5)
    assert below.x == pytest.approx(0.0152, abs=5e-5)
    # just above the line the loop is still stable there, and at the line unstable further on
    for point, stable in ((above, True), (below, False)):
        beta = float(point.x[0])
        limit = float(linear_limit(0.01, beta, 1.0, 3.0))
        assert (radius(Loop(1.0, 0.01, limit, beta, 1.0, 3.0)) < 1) == stable
