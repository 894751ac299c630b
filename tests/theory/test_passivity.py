"""Passivity: closed forms, and hands that the wall must be stable with."""

from __future__ import annotations

import numpy as np
import pytest

from controller.theory import linear_limit, passive_limit
from tests.theory.oracles import Loop, radius


def test_without_delay_it_is_the_condition_of_colgate() -> None:
    virtual = np.array([0.0, 0.003, -0.003, 0.009, 0.02])
    np.testing.assert_allclose(
        passive_limit(0.01, virtual, 1e-3, 0.0),
        np.maximum(2 * (0.01 - np.abs(virtual)) / 1e-3, 0),
        rtol=1e-9,
    )


def test_without_virtual_damping_whole_delays_give_the_linear_condition() -> None:
    delay = np.arange(8) * 1e-3
    np.testing.assert_allclose(
        passive_limit(0.01, 0.0, 1e-3, delay), linear_limit(0.01, 0.0, 1e-3, delay), rtol=1e-8
    )


def test_a_quarter_of_a_period_costs_seven_percent() -> None:
    # at low frequency 1 - k (d + 1/2) - k² f (1 - f) / 4 = 0, k = K T / b
    f = 0.25
    a, b = f * (1 - f) / 4, f + 0.5
    k = (-b + np.sqrt(b * b + 4 * a)) / (2 * a)
    assert passive_limit(1.0, 0.0, 1.0, f) == pytest.approx(k, rel=1e-8)
    assert passive_limit(1.0, 0.0, 1.0, f) / linear_limit(1.0, 0.0, 1.0, f) == pytest.approx(
        0.93, abs=0.005
    )


def test_whole_delays_meet_the_condition_angle_by_angle() -> None:
    theta = np.linspace(1e-4, np.pi, 20_001)
    for late in (1, 2, 5):
        for ratio in (-0.8, 0.2, 0.7):
            k = float(passive_limit(1.0, ratio, 1.0, late))
            needed = k / 2 * np.sin((late + 0.5) * theta) / np.sin(theta / 2) - ratio * np.cos(
                (late + 1) * theta
            )
            assert np.max(needed) == pytest.approx(1, abs=1e-6)


def test_any_delay_meets_the_condition_angle_by_angle() -> None:
    random = np.random.default_rng(1)
    theta = np.linspace(1e-4, np.pi, 20_001)
    back = np.exp(-1j * theta)
    for _ in range(40):
        late, ratio, n = random.uniform(0, 8), random.uniform(-0.9, 0.9), random.integers(1, 4)
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


def test_stable_with_every_spring_and_mass_below_it() -> None:
    random = np.random.default_rng(2)
    for _ in range(25):
        period, damping = 1e-3, 0.01
        delay = random.uniform(0, 4) * period
        virtual = random.uniform(-0.8, 0.8) * damping
        k = 0.999 * float(passive_limit(damping, virtual, period, delay))
        for inertia in (3e-4, 0.01, 1.0):
            for spring in (0.0, 0.1, 10.0, 1e3):
                loop = Loop(inertia, damping, k, virtual, period, delay, 1, spring)
                assert radius(loop) < 1


def test_a_heavy_hand_destabilises_just_above_it() -> None:
    loop = Loop(10.0, 0.01, 0.0, 0.0, 1e-3, 2e-3)
    k = float(passive_limit(0.01, 0.0, 1e-3, 2e-3))
    assert radius(loop._replace(stiffness=1.01 * k)) > 1


def test_no_stiffness_is_passive_without_damping_to_pay_for_it() -> None:
    assert passive_limit(0.0, 0.0, 1e-3, 0.0) == 0
    assert passive_limit(0.01, 0.011, 1e-3, 2e-3) == 0
    assert passive_limit(0.01, -0.011, 1e-3, 2e-3) == 0


def test_errors_name_the_argument() -> None:
    with pytest.raises(ValueError, match="damping must be >= 0, got -1"):
        passive_limit(-1.0, 0.0, 1e-3, 0.0)
