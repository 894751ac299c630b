"""Turning points and growth, against motions whose growth is known."""

import numpy as np
import pytest

from haptic_wall.controller.experiments.sweep.decrement import Growth, Turns, growth, turning_points
from haptic_wall.controller.theory.checks import FloatArray
from tests.cases import sampled

COUNT = 2 * np.pi / 4096


def swing(
    rate: float, hertz: float, seconds: float = 2.0, size: float = 0.1, period: float = 1e-3
) -> tuple[FloatArray, FloatArray]:
    time = np.arange(0.0, seconds, period)
    return time, size * np.exp(rate * time) * np.cos(2 * np.pi * hertz * time)


def grown(time: FloatArray, position: FloatArray, least: float) -> tuple[Turns, Growth]:
    turns = turning_points(time, position, least)
    return turns, growth(turns, np.ones(turns.time.size - 1, dtype=bool))


@pytest.mark.parametrize("rate", [-2.0, 0.0, 3.0])
@pytest.mark.parametrize("hertz", sampled([3.0, 11.0, 47.0, 160.0], 4))
def test_growth_of_a_damped_sinusoid(rate: float, hertz: float) -> None:
    turns, found = grown(*swing(rate, hertz), 1e-4)
    assert turns.half_period == pytest.approx(0.5 / hertz, rel=1e-3)
    assert np.mean(found.log_ratio) == pytest.approx(rate * 0.5 / hertz, abs=2e-4)
    if rate == 0.0:
        assert found.amplitude == pytest.approx(0.1, rel=1e-3)


def test_what_the_oscillation_rides_on_does_not_count() -> None:
    time, position = swing(-0.5, 8.0)
    position += 0.03 + 0.08 * np.exp(-time / 0.6)
    _, found = grown(time, position, 1e-3)
    assert np.mean(found.log_ratio) == pytest.approx(-0.5 / 16.0, abs=3e-3)


def test_between_encoder_counts() -> None:
    # 30 counts, each turning point known to a small part of one: growth to a few thousandths.
    time, position = swing(0.4, 6.0, size=30 * COUNT)
    _, found = grown(time, np.round(position / COUNT) * COUNT, 2.5 * COUNT)
    assert np.mean(found.log_ratio) == pytest.approx(0.4 / 12.0, abs=4e-3)
