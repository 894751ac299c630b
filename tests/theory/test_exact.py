"""The exact boundary: closed-loop poles as oracle, the paper's numbers, closed forms, errors."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import ArrayLike

from haptic_wall.controller.theory import (
    critical_stiffness,
    linear_limit,
    max_virtual_damping,
)
from haptic_wall.controller.theory.boundary import chain_boundary
from haptic_wall.controller.theory.chain import one_mass
from tests.theory.oracles import Loop, radius


def random_settings(count: int, seed: int) -> dict[str, np.ndarray]:
    """Inertia, damping, period, delay (whole for two in five) and N, over the useful range."""
    random = np.random.default_rng(seed)
    inertia = 10 ** random.uniform(-3.5, 0, count)
    period = 10 ** random.uniform(-3.5, -2, count)
    late = np.where(
        random.random(count) < 0.4, random.integers(0, 9, count), random.uniform(0, 15, count)
    )
    return {
        "inertia": inertia,
        "damping": 10 ** random.uniform(-5, -0.5, count) * inertia / period,
        "period": period,
        "delay": late * period,
        "velocity_samples": random.choice([1, 1, 1, 2, 3, 8], count),
    }


def loops(s: dict[str, np.ndarray], stiffness: np.ndarray, virtual: np.ndarray) -> list[Loop]:
    columns = (s["inertia"], s["damping"], stiffness, virtual, s["period"], s["delay"])
    return [Loop.of(row, n) for *row, n in zip(*columns, s["velocity_samples"], strict=True)]


def test_poles_leave_the_circle_exactly_at_the_critical_stiffness() -> None:
    s = random_settings(200, seed=1)
    random = np.random.default_rng(2)
    ceiling = max_virtual_damping(**s)
    virtual = np.where(
        random.random(200) < 0.2, -s["damping"] * random.random(200), ceiling * random.random(200)
    )
    critical = critical_stiffness(virtual_damping=virtual, **s)
    assert np.all(critical > 0)
    below, half, above = (
        np.array([radius(loop) for loop in loops(s, share * critical, virtual)])
        for share in (1 - 1e-4, 0.5, 1 + 1e-4)
    )
    assert np.all(below < 1)
    assert np.all(half < 1)
    assert np.all(above > 1)


def test_above_the_damping_ceiling_no_stiffness_is_stable_and_just_below_some_is() -> None:
    s = random_settings(100, seed=3)
    ceiling = max_virtual_damping(**s)
    tiny = 1e-6 * linear_limit(s["damping"], ceiling, s["period"], s["delay"])
    above = np.array([radius(loop) for loop in loops(s, tiny, 1.001 * ceiling)])
    below = np.array([radius(loop) for loop in loops(s, tiny, 0.999 * ceiling)])
    assert np.all(above > 1)
    # with K near 0 one pole is next to 1 from inside
    assert np.all(below < 1)
    assert np.all(critical_stiffness(virtual_damping=1.001 * ceiling, **s) == 0)
    assert np.all(critical_stiffness(virtual_damping=0.999 * ceiling, **s) > 0)


def test_the_limit_moves_smoothly_over_whole_delays() -> None:
    late = np.array([2 - 1e-9, 2.0, 2 + 1e-9])
    k = critical_stiffness(0.01, 0.01, 0.1, 1e-3, late * 1e-3)
    np.testing.assert_allclose(k, k[1], rtol=1e-7)


def test_no_stiffness_is_stable_without_damping() -> None:
    assert critical_stiffness(1.0, 0.0, 0.0, 1.0, 0.0) == 0
    assert critical_stiffness(1.0, 0.1, -0.1, 1.0, 0.0) == 0
    assert chain_boundary(*one_mass(1.0, 0.1), -0.2, 1.0, 1.0).frequency == 0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"inertia": 0.0}, "inertia must be > 0, got 0"),
        ({"damping": -1.0}, "damping must be >= 0, got -1"),
        ({"virtual_damping": np.nan}, "virtual_damping must be finite, got nan"),
        ({"period": -1e-3}, "period must be > 0, got -0.001"),
        ({"delay": [0.0, -1.0]}, "delay must be >= 0, got -1"),
        ({"velocity_samples": 1.5}, "velocity_samples must be a whole number >= 1, got 1.5"),
        ({"velocity_samples": 2**70}, "velocity_samples must be at most 10000"),
        ({"inertia": "much"}, "inertia must be a number, got 'much'"),
        ({"inertia": "1"}, "inertia must be a number, got '1'"),
        ({"inertia": 10**400}, "inertia must be a number"),
        ({"delay": [1j]}, "delay must be a number"),
        ({"inertia": np.ones(2), "damping": np.ones(3)}, "the shapes must broadcast"),
    ],
)
def test_errors_name_the_argument(change: dict[str, ArrayLike], message: str) -> None:
    good: dict[str, ArrayLike] = {"inertia": 1.0, "damping": 0.1, "virtual_damping": 0.0}
    good |= {"period": 1e-3, "delay": 0.0}
    with pytest.raises(ValueError, match=message):
        critical_stiffness(**{**good, **change})
