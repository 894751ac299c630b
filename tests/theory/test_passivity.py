"""Passivity: closed forms, and hands that the wall must be stable with."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from haptic_wall.controller.theory import passive_limit
from haptic_wall.controller.theory.passivity import passive_slope
from tests.theory.passive_loads import Wall, adverse_load, distance, random_load
from tests.theory.passive_loads import radius as loaded_radius

FloatArray = NDArray[np.float64]


def greatest(function: Callable[[np.ndarray], np.ndarray], low: float, high: float) -> float:
    """The greatest value between ``low`` and ``high``, looked for in ever smaller steps."""
    for _ in range(5):
        points = np.linspace(low, high, 4001)
        values = function(points)
        best = int(np.argmax(values))
        low, high = points[max(best - 1, 0)], points[min(best + 1, 4000)]
    return float(np.max(values))


@pytest.mark.parametrize("late", [0, 1, 2, 3, 5, 12])
@pytest.mark.parametrize("ratio", [-0.8, -0.1, 0.0, 0.2, 0.7, 0.95])
def test_whole_delays_meet_the_closed_formula(late: int, ratio: float) -> None:
    k = float(passive_limit(1.0, ratio, 1.0, late))

    def needed(theta: FloatArray) -> FloatArray:
        by_spring = k / 2 * np.sin((late + 0.5) * theta) / np.sin(theta / 2)
        left: FloatArray = by_spring - ratio * np.cos((late + 1) * theta)
        return left

    assert greatest(needed, 1e-6, np.pi) == pytest.approx(1, abs=1e-9)


def test_any_delay_meets_the_condition_angle_by_angle(wholly: bool) -> None:
    random = np.random.default_rng(1)
    theta = np.linspace(1e-4, np.pi, 20_001)
    back = np.exp(-1j * theta)
    for _ in range(40 if wholly else 15):
        late, ratio = random.uniform(0, 8), random.uniform(-0.9, 0.9)
        n = int(random.integers(1, 4))
        f = late % 1
        c = np.exp(1j * theta * f) * ((1 - f) + f * back)

        def holds(
            k: float, late: float = late, ratio: float = ratio, n: int = n, c: np.ndarray = c
        ) -> bool:
            h = k + ratio / n * (1 - back**n)
            loop = -h * (1 - back) * back**late / (8 * np.sin(theta / 2) ** 2)
            left = 1 + 2 * (loop * c).real - np.abs(loop) ** 2 * (1 - np.abs(c) ** 2)
            return bool(np.min(left) > 0)

        k = float(passive_limit(1.0, ratio, 1.0, late, n))
        assert k > 0
        assert holds(k * (1 - 1e-5))
        assert not holds(k * (1 + 1e-4))


FRACTIONS = [(0.25, 0.0), (0.25, 0.7), (0.5, -0.5), (0.75, 0.4), (1.3, 0.0), (2.6, 0.7), (3.0, 0.4)]


def directed(wall: Wall, seed: int) -> Iterator[float]:
    """Pole radii of passive loads made for this wall: adverse where it is nearest to the edge."""
    theta = np.concatenate([np.geomspace(0.03, 0.3, 8), np.linspace(0.35, np.pi - 1e-3, 30)])
    random = np.random.default_rng(seed)
    for x in theta[np.argsort(distance(wall, theta))[:3]].tolist():
        for modes in (4, 2, 1, 6):
            load = adverse_load(wall, x, modes, random.uniform(0.01, 0.03), 0.1)
            yield loaded_radius(wall, load)
            yield loaded_radius(
                wall, load._replace(masses=load.masses * random.uniform(0.99, 1.01))
            )


@pytest.mark.parametrize(("late", "ratio"), FRACTIONS)
def test_no_passive_load_is_unstable_below_it(late: float, ratio: float, thorough: bool) -> None:
    k = float(passive_limit(1.0, ratio, 1.0, late))
    random = np.random.default_rng(5)
    for _ in range(1000 if thorough else 100):
        wall = Wall(1.0, random.uniform(0.5, 0.999) * k, ratio, late)
        # bodies that nothing holds have poles at 1, which rounding spreads
        assert loaded_radius(wall, random_load(random)) < 1 + 1e-6
    assert max(directed(Wall(1.0, 0.999 * k, ratio, late), 6)) < 1 + 1e-7


@pytest.mark.parametrize(("late", "ratio"), FRACTIONS)
def test_a_passive_load_is_unstable_ten_percent_above_it(late: float, ratio: float) -> None:
    k = float(passive_limit(1.0, ratio, 1.0, late))
    radii = directed(Wall(1.0, 1.1 * k, ratio, late), 7)
    assert any(radius > 1 + 1e-5 for radius in radii)


def test_no_stiffness_is_passive_without_damping_to_pay_for_it() -> None:
    assert passive_limit(0.0, 0.0, 1e-3, 0.0) == 0
    assert passive_limit(0.01, 0.011, 1e-3, 2e-3) == 0
    assert passive_limit(0.01, -0.011, 1e-3, 2e-3) == 0


@pytest.mark.parametrize("virtual", [0.0, 0.3, -0.2])
def test_a_law_of_any_slope_is_passive_below_its_limit(virtual: float) -> None:
    # The linear wall has one of the slopes, so that its own limit is never the lower one.
    b, t = 1.0, 1e-3
    for delay in (0.0, 0.4e-3, 1e-3, 2.7e-3):
        assert passive_slope(b, virtual, t, delay) <= passive_limit(b, virtual, t, delay)


def test_a_sampled_law_gives_back_no_more_than_friction_takes() -> None:
    """Motions that are imposed: the work of a law's delayed torque, beyond its potential."""
    t, delay, b = 1.0, 1.3, 1.0
    slope = float(passive_slope(b, 0.0, t, delay))
    random = np.random.default_rng(4)
    fine = 50
    steps = np.arange(400 * fine) / fine
    for _ in range(20):
        waves = random.uniform(0.05, 3.0, 6), random.uniform(0, 6.3, 6), random.normal(0, 1, 6)
        x = sum(a * np.sin(w * steps + p) for w, p, a in zip(*waves, strict=True))
        wave = random.uniform(0.3, 3.0)
        sampled = np.floor(steps - delay).astype(int) * fine
        torque = np.where(sampled >= 0, -slope * np.sin(wave * x[sampled]) / wave, 0.0)
        begin = 5 * fine
        moved = np.diff(x[begin:])
        given = float(np.sum(torque[begin:-1] * moved))
        potential = -slope * np.cos(wave * x) / wave**2
        given -= float(potential[begin] - potential[-1])
        assert given < b * float(np.sum(moved**2)) * fine
