"""The picture of a map shows the theory beside every point, also where there is only one."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from haptic_wall.controller.experiments.maps.maps import MapQuestion, critical_map
from haptic_wall.controller.experiments.maps.servo import MapSettings
from haptic_wall.controller.milliseconds import ms
from haptic_wall.controller.report import maps as map_plot
from haptic_wall.controller.report import style
from haptic_wall.controller.settings.load import load_config
from tests.support.executors import AtOnce


def drawn(monkeypatch: pytest.MonkeyPatch, dampings: list[float]) -> Axes:
    """The axes over the damping, of a servo without friction at one delay."""
    figure = Figure()

    @contextmanager
    def picture(*_: object) -> Iterator[Figure]:
        yield figure

    setting = MapSettings.of(load_config("paper-table2", ()).config)
    found = critical_map(MapQuestion(setting, dampings, [1], [0.01], 0.1), executor=AtOnce())
    monkeypatch.setattr(style, "picture", picture)
    map_plot.plot_map(found, "test", Path("unused"))
    return figure.axes[0]


def test_the_theory_reaches_from_the_first_damping_to_the_last(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    dampings = [0.1, 200.0]
    assert np.square(np.sqrt(200.0)) > 200.0  # as the axis computes it
    linear, exact, *_ = drawn(monkeypatch, dampings).lines
    for line in (linear, exact):
        assert np.asarray(line.get_xdata())[[0, -1]].tolist() == dampings


@pytest.mark.parametrize(
    ("seconds", "said"),
    [(1.45e-7, "0 ms"), (0.0, "0 ms"), (2.5e-4, "0.25 ms"), (0.0012, "1.2 ms"), (0.01, "10 ms")],
)
def test_a_delay_that_is_none_is_labelled_none(seconds: float, said: str) -> None:
    assert ms(seconds) == said
