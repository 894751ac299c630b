"""What repeats as evenly as a machine: counted; what a hand makes: not."""

import math
from collections.abc import Iterable
from types import SimpleNamespace

import numpy as np
import pytest

from haptic_wall.controller.detector.half_cycles import HalfCycles
from haptic_wall.controller.detector.steady import Steadiness
from haptic_wall.controller.detector.tuning import TUNING

STEADY = TUNING.steadiness.half_cycles
PERIOD = 1e-3
COUNT = math.tau / 4096


def counted(rows: Iterable[tuple[float, float]], count: float = COUNT) -> list[int]:
    """Take rows of (amplitude, duration); the counts after each."""
    steady = Steadiness(PERIOD, count, TUNING.steadiness)
    counts = []
    for known, (amplitude, duration) in enumerate(rows, 1):
        steady.take(SimpleNamespace(known=known, amplitude=amplitude, duration=duration))
        counts.append(steady.count)
    return counts


def of_motion(positions: Iterable[float], count: float = COUNT) -> int:
    """The largest count in a motion."""
    steady, most = Steadiness(PERIOD, count, TUNING.steadiness), 0
    seen = HalfCycles(PERIOD, count, TUNING.half_cycles)
    for position in positions:
        if seen.update(position, 0.0, PERIOD):
            steady.take(seen)
            most = max(most, steady.count)
    return most


def test_what_repeats_exactly_is_counted_without_end() -> None:
    assert counted([(0.1, 0.05)] * 50) == list(range(1, 51))


@pytest.mark.parametrize("one", [(0.12, 0.05), (0.1, 0.07), (0.08, 0.05), (0.1, 0.035)])
def test_one_that_is_unlike_begins_the_count_anew(one: tuple[float, float]) -> None:
    counts = counted([(0.1, 0.05)] * 20 + [one] + [(0.1, 0.05)] * 20)
    assert counts[19] == 20
    assert counts[20] == 1
    assert counts[-1] <= 20


def test_a_slow_drift_is_not_steady_however_even_each_step_is() -> None:
    """Compared to the first one, not to the one before."""
    assert max(counted([(0.1 * 1.005**k, 0.05) for k in range(200)])) < STEADY


def test_rounding_of_the_encoder_and_of_the_period_is_forgiven() -> None:
    random = np.random.default_rng(1)
    rows = [
        (4 * COUNT + 0.5 * COUNT * random.integers(2), 0.02 + PERIOD * random.integers(2))
        for _ in range(60)
    ]
    assert counted(rows)[-1] == 60


@pytest.mark.parametrize("hertz", [3.0, 10.8, 26.3])
@pytest.mark.parametrize("counts", [4.2, 8.0, 100.0])
def test_a_limit_cycle_on_the_encoder_is_steady(hertz: float, counts: float) -> None:
    time = np.arange(round(1e3 * (STEADY + 5) / (2 * hertz))) * PERIOD
    wave = counts * COUNT * np.cos(math.tau * hertz * time)
    assert of_motion(np.round(wave / COUNT) * COUNT) >= STEADY


@pytest.mark.parametrize("seed", range(8))
def test_a_rhythm_whose_periods_vary_by_three_percent_is_not(seed: int) -> None:
    """The most even hands: 3 to 5 %."""
    random = np.random.default_rng(seed)
    lengths = np.maximum(1.0 + 0.03 * random.standard_normal(200), 0.5) / 4.0
    time = np.arange(round(1e3 * lengths.sum())) * PERIOD
    phase = np.interp(time, np.concatenate([[0.0], np.cumsum(lengths)]), np.arange(201))
    wave = 0.1 * np.cos(math.tau * phase)
    assert of_motion(np.round(wave / COUNT) * COUNT) < STEADY
