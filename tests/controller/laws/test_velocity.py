"""Velocity estimates: what they are, and what lost readings do to them."""

import numpy as np
import pytest
from scipy.signal import lfilter

from haptic_wall.controller.laws.velocity import Biquad, SampleDifference, velocity_estimator
from haptic_wall.controller.theory.velocity_filter import VelocityFilter

T = 0.001


@pytest.mark.parametrize("samples", [1, 4])
@pytest.mark.parametrize("periods", [1, 3])
def test_the_difference_is_divided_by_the_periods_that_passed(samples: int, periods: int) -> None:
    estimator = velocity_estimator(T, samples)
    assert estimator.update(123.0, 1) == 0.0, "the first value, whatever the position"
    assert estimator.update(123.0 + 2.0 * periods * T, periods) == pytest.approx(2.0)


@pytest.mark.parametrize("samples", [1, 3])
def test_a_short_interval_counts_with_the_one_before(samples: int) -> None:
    estimator = velocity_estimator(T, samples)
    x = 0.0
    velocities = []
    for periods in (1.0, 1.98, 0.02, 1.7, 0.3, 1.0, 1.49, 1.49, 0.02, 1.98):
        x += 5.0 * periods * T
        velocities.append(estimator.update(x, periods))
    assert velocities[1:] == pytest.approx([5.0] * 9)


@pytest.mark.parametrize("samples", [1, 3])
def test_a_count_after_hardly_any_time_gives_no_high_speed(samples: int) -> None:
    estimator = velocity_estimator(T, samples)
    estimator.update(0.0, 1.0)
    assert estimator.update(0.001, 0.01) <= 2.0, "not the 100 rad/s of a hundredth of a period"
    assert estimator.update(0.002, 1.0) == pytest.approx(
        0.001 / T if samples == 1 else 2.0, rel=0.1
    )


@pytest.mark.parametrize("samples", [2, 3, 8])
def test_sample_difference_spans_n_periods(samples: int) -> None:
    estimator = SampleDifference(T, samples)
    positions = [0.5 * (k * T) ** 2 * 100 for k in range(30)]
    for k, position in enumerate(positions):
        velocity = estimator.update(position, 1)
        if k >= samples:
            expected = (position - positions[k - samples]) / (samples * T)
            assert velocity == pytest.approx(expected)


def test_sample_difference_counts_lost_periods() -> None:
    estimator = SampleDifference(T, 3)
    x = 0.0
    for periods in (1, 1, 1, 2, 1, 4, 1, 1, 1):
        x += 5.0 * periods * T
        velocity = estimator.update(x, periods)
    assert velocity == pytest.approx(5.0)


def test_a_biquad_is_the_filter_of_its_taps() -> None:
    taps = VelocityFilter("notch", 0.3, 0.7).taps()
    filtered = Biquad(taps)
    given = np.random.default_rng(1).normal(size=50)
    expected = lfilter(taps[:3], [1.0, *taps[3:]], given)
    assert [filtered.update(v) for v in given.tolist()] == pytest.approx(expected)
