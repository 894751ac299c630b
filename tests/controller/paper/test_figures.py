"""The figures' data hold what theory says of them, by closed-loop poles and by known values."""

from typing import Any

import numpy as np
import pytest

from haptic_wall.controller.paper import boundaries, linear_error, lwr3
from haptic_wall.controller.paper.curves import Curve, FigureData
from haptic_wall.controller.settings.load import load_config
from tests.theory.oracles import Loop, radius


@pytest.fixture(scope="module")
def fig10(
    whole_experiment: None,  # noqa: ARG001 - leaves it out
) -> FigureData:
    return linear_error.figure_10()


@pytest.fixture(scope="module")
def fig5() -> FigureData:
    return boundaries.figure_5()


def one(data: FigureData, kind: str, **settings: Any) -> Curve:
    (curve,) = data.of_kind(kind, **settings)
    return curve


def on_the_edge(inertia: float, damping: float, period: float, delay: float, curve: Curve) -> None:
    """A few drawn points, not at the ends: stable a little below, unstable a little above."""
    for index in np.linspace(0.05, 0.95, 7) * (curve.x.size - 1):
        virtual, stiffness = curve.x[int(index)], curve.y[int(index)]
        below, above = (
            radius(Loop(inertia, damping, share * stiffness, virtual, period, delay))
            for share in (0.999, 1.001)
        )
        assert below < 1 < above


def test_peaks(fig5: FigureData) -> None:
    # delta = 1e-4, four digits; the paper states .686 and .144 for d = 0 and 1
    table = {0: 0.6864, 0.25: 0.3964, 0.5: 0.2670, 0.75: 0.1924, 1: 0.1445}
    table |= {1.5: 0.0908, 2: 0.0625, 3: 0.0348}
    for data in (boundaries.figure_3(), fig5):
        peaks = {c.settings["delay_periods"]: c.y[0] for c in data.of_kind("peak")}
        assert set(peaks) == {c.settings["delay_periods"] for c in data.of_kind("exact")}
        for delay, height in peaks.items():
            assert height == pytest.approx(table[delay], abs=0.6e-4)
            # the curve as it is drawn reaches it: its points are dense enough
            top = one(data, "exact", delay_periods=delay).y.max()
            assert top == pytest.approx(height, rel=1e-4)


def test_figure_5_draws_the_eight_delays_from_the_origin_to_the_ceiling(fig5: FigureData) -> None:
    delays = [c.settings["delay_periods"] for c in fig5.of_kind("exact")]
    assert delays == [0, 0.25, 0.5, 0.75, 1, 1.5, 2, 3]
    for curve in fig5.of_kind("exact"):
        delay = curve.settings["delay_periods"]
        assert curve.y[[0, -1]] == pytest.approx([0, 0], abs=1e-6)
        assert curve.x[0] == pytest.approx(-1e-4)
        if delay == int(delay):  # the closed form is for delta -> 0; it moves by about delta
            ceiling = 2 * np.tan(np.pi / (4 * (delay + 1)))
            assert curve.x[-1] == pytest.approx(ceiling, abs=1.5e-4)
        on_the_edge(1.0, 1e-4, 1.0, delay, curve)


def test_figure_9_is_the_edge_of_stability_of_the_axis() -> None:
    data = lwr3.figure_9()
    assert [c.settings["delay_s"] for c in data.of_kind("exact")] == [0.010, 0.055]
    for curve in data.of_kind("exact"):
        delay = curve.settings["delay_s"]
        on_the_edge(0.8, 0.1, 1e-3, delay, curve)
        assert one(data, "peak", delay_s=delay).y[0] == pytest.approx(curve.y.max(), rel=1e-4)


def test_the_axis_is_that_of_the_preset() -> None:
    servo = load_config("lwr3").config.servo
    assert (servo.inertia, servo.damping) == (lwr3.INERTIA, lwr3.DAMPING)
    assert servo.delay == lwr3.SHORT_DELAYS[0]


def test_figure_10_marks_where_the_line_is_off(fig10: FigureData) -> None:
    points = fig10.of_kind("error point")
    for point in points:
        delta, delay = point.settings["delta"], point.settings["delay_periods"]
        line = 2 * (delta + point.x[0]) / (1 + 2 * delay)
        off = 100 * (point.y[0] / line - 1)
        assert off == pytest.approx(point.settings["error_percent"], abs=1e-6)
        below, above = (
            radius(Loop(1.0, delta, share * point.y[0], point.x[0], 1.0, delay))
            for share in (1 - 1e-6, 1 + 1e-6)
        )
        assert below < 1 < above
