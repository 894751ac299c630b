"""The boundary held against poles in extended precision, and its domain."""

from __future__ import annotations

import cmath

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike

from haptic_wall.controller.theory import (
    critical_stiffness,
    max_virtual_damping,
)
from haptic_wall.controller.theory.boundary import chain_boundary, chain_peak
from haptic_wall.controller.theory.chain import one_mass
from tests.theory.extended import DIGITS, Wall, all_inside, characteristic, pole_near


def light_settings(count: int, seed: int, heaviest: float = 0.1) -> tuple[np.ndarray, ...]:
    """Delta from 1e-6, d to 60 (often whole), beta from -delta/2 to .95 of the ceiling."""
    random = np.random.default_rng(seed)
    delta = 10 ** random.uniform(-6, np.log10(heaviest), count)
    delay = np.where(
        random.random(count) < 0.3, random.integers(0, 61, count), random.uniform(0, 60, count)
    )
    top = 0.95 * max_virtual_damping(1.0, delta, 1.0, delay)
    small = np.where(random.random(count) < 0.5, -0.5 * delta, 0.0)
    share = np.where(small < 0, random.random(count) ** 4, random.random(count))
    return delta, small + (top - small) * share, delay


def test_poles_in_extended_precision_leave_the_circle_within_a_billionth(
    thorough: bool, wholly: bool
) -> None:
    delta, beta, delay = light_settings(10_000 if thorough else 400 if wholly else 80, seed=1)
    found = chain_boundary(*one_mass(1.0, delta), beta, 1.0, delay)
    part = mpmath.mpf(10) ** -9
    with mpmath.workdps(DIGITS):
        rows = zip(delta, beta, delay, found.stiffness, found.frequency, strict=True)
        for d, b, late, alpha, frequency in rows:
            setting = Wall(float(d), float(b), float(late))
            below = characteristic(setting, mpmath.mpf(float(alpha)) * (1 - part))
            above = characteristic(setting, mpmath.mpf(float(alpha)) * (1 + part))
            on_circle = cmath.exp(2j * np.pi * float(frequency))
            inside, outside = pole_near(below, on_circle), pole_near(above, on_circle)
            assert abs(inside) < 1 < abs(outside), setting
            # it is the pole at this frequency that leaves, and before it does all are inside
            nearness = 1e-8 * 2 * np.pi * float(frequency)
            assert abs(inside - on_circle) < nearness, setting
            assert abs(outside - on_circle) < nearness, setting
            assert all_inside(below), setting
            assert not all_inside(above), setting


def test_long_differences_and_heavy_damping_do_too(thorough: bool) -> None:
    """Of any inertia and period; the poles are those of inertia and period 1."""
    count = 1_000 if thorough else 60
    random = np.random.default_rng(2)
    samples = random.choice([1, 2, 3, 5, 8, 20], count)
    delta = 10 ** random.uniform(-5, 1.5, count)
    delay = random.uniform(0, 20, count) * random.integers(0, 2, count)
    inertia, period = 10 ** random.uniform(-3.5, 0, count), 10 ** random.uniform(-3.5, -2, count)
    damped = inertia / period
    top = max_virtual_damping(inertia, delta * damped, period, delay * period, samples) / damped
    beta = -0.5 * delta + (0.95 * top + 0.5 * delta) * random.random(count) ** 2
    stiffness = critical_stiffness(
        inertia, delta * damped, beta * damped, period, delay * period, samples
    )
    alpha = stiffness * period**2 / inertia
    part = mpmath.mpf(10) ** -9
    with mpmath.workdps(DIGITS):
        for d, b, late, n, limit in zip(delta, beta, delay, samples, alpha, strict=True):
            setting = Wall(float(d), float(b), float(late), int(n))
            exact = mpmath.mpf(float(limit))
            assert all_inside(characteristic(setting, exact * (1 - part))), setting
            assert not all_inside(characteristic(setting, exact * (1 + part))), setting


@pytest.mark.parametrize(
    "wall",
    [
        # the lowest crossing is the ninth by frequency, or the second of two close ones
        Wall(30.267, 456.043, 0.0, samples=16),
        Wall(16.963, 0.9 * 244.5, 0.0, samples=16),
        Wall(1.0768, 5.52, 2.62147, samples=40),
    ],
)
def test_a_late_crossing_can_be_the_lowest(wall: Wall) -> None:
    delta, beta, delay, samples = wall
    alpha = mpmath.mpf(float(critical_stiffness(1.0, delta, beta, 1.0, delay, samples)))
    part = mpmath.mpf(10) ** -9
    with mpmath.workdps(DIGITS):
        assert all_inside(characteristic(wall, alpha * (1 - part)))
        assert not all_inside(characteristic(wall, alpha * (1 + part)))


def test_any_corner_next_to_the_ceiling_is_safe(thorough: bool, wholly: bool) -> None:
    random = np.random.default_rng(8)
    for _ in range(3_000 if thorough else 60 if wholly else 15):
        samples = int(random.choice([1, 1, 1, 2, 3, 4, 8, 20]))
        delta = 10 ** random.uniform(-3, 1.5)
        delay = random.uniform(0, 60) if random.random() < 0.6 else float(random.integers(0, 61))
        if random.random() < 0.4:  # a long delay beside the damping: a flat curve
            samples, delay = 1, min(10 ** random.uniform(0.8, 2.2) / delta, 150.0)
        gap = 10 ** random.uniform(-8.5, -1)
        top = float(max_virtual_damping(1.0, delta, 1.0, delay, samples))
        assert_limit(Wall(delta, (1 - gap) * top, delay, samples), gap)
        with mpmath.workdps(DIGITS):  # and the ceiling is one
            for side in (-1, 1):
                wall = Wall(delta, (1 + side * 1e-8) * top, delay, samples)
                softest = characteristic(wall, mpmath.mpf(10) ** -14 * min(1.0, delta))
                assert all_inside(softest) == (side < 0), wall


def assert_limit(wall: Wall, gap: float) -> None:
    """Every stiffness below the limit is stable, above it is not; ``gap`` to the ceiling."""
    delta, beta, delay, samples = wall
    limit = mpmath.mpf(float(critical_stiffness(1.0, delta, beta, 1.0, delay, samples)))
    # the limit goes with the gap, which is the difference of two doubles
    part = mpmath.mpf(1e-9 + 1e-14 / gap)
    with mpmath.workdps(DIGITS):
        for share in (1e-3, 0.03, 0.3, 0.7, 0.97, 0.999, 1 - part):
            assert all_inside(characteristic(wall, limit * share)), (wall, share)
        assert not all_inside(characteristic(wall, limit * (1 + part))), wall


extreme = st.one_of(st.just(0.0), st.floats(1e-12, 100.0), st.floats(1e-3, 1.0))


def test_extreme_settings_give_numbers_and_zero_outside_of_the_damping_range(
    thorough: bool, wholly: bool
) -> None:
    @settings(max_examples=400 if thorough else 15 if wholly else 2, derandomize=True)
    @given(
        delta=extreme,
        beta=st.one_of(st.floats(-200.0, 200.0), st.floats(-1e-3, 1.0), st.floats(-1e250, 1e250)),
        delay=st.one_of(st.floats(0.0, 1000.0), st.integers(0, 1000).map(float)),
        samples=st.integers(1, 50),
        inertia=st.floats(1e-30, 1e30),
        period=st.floats(1e-9, 1e3),
    )
    def check(
        delta: float, beta: float, delay: float, samples: int, inertia: float, period: float
    ) -> None:
        damping, virtual = delta * inertia / period, beta * inertia / period
        device = (inertia, damping, period, delay * period, samples)
        limit = chain_boundary(
            *one_mass(inertia, damping), virtual, period, delay * period, samples
        )
        top = max_virtual_damping(*device)
        best = chain_peak(one_mass(inertia, damping)[0], *device[2:])
        for value in (limit.stiffness, limit.frequency, top, best.stiffness[0], best.frequency[0]):
            assert np.isfinite(value)
            assert value >= 0
        if virtual <= -damping or virtual >= top:
            assert limit.stiffness == 0
            assert limit.frequency == 0
        assert limit.stiffness <= best.stiffness * (1 + 1e-6)
        assert limit.frequency <= 0.5 / period * (1 + 1e-12)

    check()


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
        ({"inertia": 1e-300, "damping": 1e10}, "inertia .* too small"),
        ({"period": 1e-300, "delay": 1e10}, "period .* too small"),
        ({"inertia": np.ones(2), "damping": np.ones(3)}, "the shapes must broadcast"),
    ],
)
def test_errors_name_the_argument(change: dict[str, ArrayLike], message: str) -> None:
    good: dict[str, ArrayLike] = {"inertia": 1.0, "damping": 0.1, "virtual_damping": 0.0}
    good |= {"period": 1e-3, "delay": 0.0}
    with pytest.raises(ValueError, match=message):
        critical_stiffness(**{**good, **change})
