"""The stiffness of no growth, from half cycles made up by a law that is known."""

from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest

from haptic_wall.controller.experiments.sweep.decrement import Growth
from haptic_wall.controller.experiments.sweep.growth_fit import Trial, balance
from tests.typed import not_none

LIMIT, KICK = 12.0, 0.1


def trial(
    stiffness: float,
    rng: np.random.Generator,
    noise: float = 0.0,
    friction: float = 0.0,
    start: float = KICK,
) -> Trial:
    """Amplitudes that follow A' = r A - f, with r and f such that LIMIT holds at KICK."""
    made = [start]
    for _ in range(12):
        ratio = np.exp(0.2 * np.log(stiffness / LIMIT)) * (1.0 + friction / KICK)
        made.append(ratio * made[-1] - friction)
    amplitude = np.maximum(made, 1e-3) + noise * rng.standard_normal(13)
    ratio = np.log(amplitude[1:] / amplitude[:-1])
    mean = np.sqrt(amplitude[1:] * amplitude[:-1])
    return Trial(stiffness, Growth(ratio, mean), 0.05, bool(ratio.mean() > 0))


def trials(rng: np.random.Generator, stiffnesses: Iterable[float], **how: Any) -> list[Trial]:
    return [trial(k, rng, **how) for k in stiffnesses]


AROUND = (11.0, 11.6, 12.3, 12.9, 11.2, 12.6)


def test_without_noise_it_is_exact() -> None:
    found = not_none(balance(trials(np.random.default_rng(0), AROUND), KICK, 13.0))
    assert found.stiffness == pytest.approx(LIMIT, rel=1e-4)
    assert found.uncertainty < 1e-3 * LIMIT
    assert found.frequency == pytest.approx(10.0)
    assert found.amplitude == pytest.approx(KICK)


@pytest.mark.parametrize("start", [0.08, 0.098, 0.104, 0.13])
def test_with_friction_it_is_that_of_the_amplitude_told(start: float) -> None:
    rng, friction = np.random.default_rng(1), 0.005
    found = not_none(balance(trials(rng, AROUND, friction=friction, start=start), KICK, 11.5))
    there = (1.0 + friction / found.amplitude) / (1.0 + friction / KICK)
    assert found.stiffness == pytest.approx(LIMIT * there**5, rel=0.01)
    if 0.09 < start < 0.11:  # as far as a kick misses
        assert found.amplitude == pytest.approx(KICK)


def test_growth_that_falls_with_stiffness_tells_nothing() -> None:
    rng = np.random.default_rng(2)
    falling = [
        Trial(LIMIT**2 / each.stiffness, each.growth, each.half_period, each.grew)
        for each in trials(rng, AROUND)
    ]
    assert balance(falling, KICK, 12.0) is None
    assert balance(falling[:1], KICK, 12.0) is None
