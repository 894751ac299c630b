"""The exact boundary: closed-loop poles as oracle, the paper's numbers, closed forms, errors."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import ArrayLike

from haptic_wall.controller.theory import (
    critical_point,
    critical_stiffness,
    linear_limit,
    max_virtual_damping,
    peak,
)
from tests.theory.oracles import Loop, radius

TABLE_II = Path(__file__).parents[2] / "controller" / "paper" / "table2.csv"


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


def test_scaling_a_stable_wall_down_along_the_ray_keeps_it_stable() -> None:
    s = random_settings(60, seed=4)
    virtual = max_virtual_damping(**s) * np.random.default_rng(5).random(60)
    stiffness = 0.999 * critical_stiffness(virtual_damping=virtual, **s)
    for share in (0.9, 0.5, 0.1):
        assert max(radius(x) for x in loops(s, share * stiffness, share * virtual)) < 1


def test_table_ii_of_the_paper() -> None:
    # Gil et al., ICRA 2007, Table II: critical K [N/m] of the paper's simulations for m = 1 kg,
    # b = 0.1 N·s/m, T = 1 ms. The exact boundary is within 0.04 % of every cell; in each of them
    # it is below the linear condition, by 0.008 to 0.08 %.
    with TABLE_II.open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 9
    for row in rows:
        delay = float(row["delay_samples"]) * 1e-3
        for virtual in (0.1, 0.2, 0.3, 0.4):
            exact = critical_stiffness(1.0, 0.1, virtual, 1e-3, delay)
            linear = linear_limit(0.1, virtual, 1e-3, delay)
            assert exact == pytest.approx(float(row[f"B_{virtual}"]), rel=4.1e-4)
            assert 0.5e-4 < 1 - exact / linear < 9e-4
            assert radius(Loop(1.0, 0.1, float(linear), virtual, 1e-3, delay)) > 1


def test_peak_of_the_boundary() -> None:
    # Dimensionless, delta = 1e-4; four digits, the damping of a flat maximum one less.
    # Gil et al. state .686 and .144 for d = 0 and 1.
    table = {
        0: (0.6864, 0.8284, 1.144),
        0.25: (0.3964, 0.6480, 0.884),
        0.5: (0.2670, 0.5524, 0.735),
        0.75: (0.1924, 0.4819, 0.628),
        1: (0.1445, 0.4247, 0.546),
        1.5: (0.0908, 0.3451, 0.435),
        2: (0.0625, 0.2914, 0.361),
        3: (0.0348, 0.2224, 0.270),
    }
    found = peak(1.0, 1e-4, 1.0, list(table))
    expected = np.array(list(table.values()))
    np.testing.assert_allclose(found.stiffness, expected[:, 0], atol=0.6e-4)
    np.testing.assert_allclose(found.virtual_damping, expected[:, 1], atol=2e-4)
    np.testing.assert_allclose(2 * np.pi * found.frequency, expected[:, 2], atol=1e-3)


def test_exact_falls_far_below_linear_for_much_virtual_damping() -> None:
    # ratio exact/linear at delta = 1e-4, three digits
    virtual = [0.01, 0.05, 0.1, 0.2, 0.3, 0.5]
    table = {
        0: [0.990, 0.951, 0.905, 0.818, 0.739, 0.600],
        1: [0.989, 0.944, 0.888, 0.774, 0.658, 0.419],
        2: [0.986, 0.929, 0.854, 0.695, 0.520, 0.093],
        5: [0.976, 0.875, 0.731, 0.358, 0, 0],
        10: [0.959, 0.771, 0.453, 0, 0, 0],
    }
    delay = np.array(list(table))[:, None]
    ratio = critical_stiffness(1.0, 1e-4, virtual, 1.0, delay) / linear_limit(
        1e-4, virtual, 1.0, delay
    )
    np.testing.assert_allclose(ratio, list(table.values()), atol=0.6e-3)


def test_exact_is_above_linear_for_little_virtual_damping() -> None:
    ratio = critical_stiffness(1.0, [0.01, 0.1], 0.0, 1.0, 5.0) / linear_limit(
        [0.01, 0.1], 0.0, 1.0, 5.0
    )
    np.testing.assert_allclose(ratio, [1.009, 1.08], atol=0.005)


def test_ceiling_without_damping_has_a_closed_form() -> None:
    delay = np.array([0, 1, 2, 3, 5, 10])
    np.testing.assert_allclose(
        max_virtual_damping(1.0, 0.0, 1.0, delay), 2 * np.tan(np.pi / (4 * (delay + 1))), rtol=1e-9
    )
    assert max_virtual_damping(1.0, 0.1, 1.0, 5.0) == pytest.approx(0.332, abs=0.6e-3)


def test_no_delay_closed_form() -> None:
    # Gil et al., eq. (1)
    delta, beta = np.meshgrid([0.02, 0.1, 0.5], [-0.01, 0.0, 0.05, 0.5, 1.2])
    eps = np.exp(-delta)
    shared = beta * eps - beta + delta**2
    closed = (
        delta
        * (delta + beta)
        * (1 - eps)
        * (shared + beta * delta * eps)
        / ((1 - eps - delta * eps) * (shared + beta * delta))
    )
    # cancels to about 1e-16 / delta³ of its value
    np.testing.assert_allclose(critical_stiffness(1.0, delta, beta, 1.0, 0.0), closed, rtol=1e-9)


def test_one_sample_of_delay_meets_the_hurwitz_determinant() -> None:
    # Gil et al., eq. (13), a1 a2 a3 - a4 a1² - a0 a3² = 0 on the boundary
    def determinant(delta: float, alpha: float, beta: float) -> float:
        e = np.exp(-delta)
        a0 = (1 - e) * delta * alpha / 2
        a1 = (1 - e) * (delta * beta + delta**2 - alpha) + e * delta * alpha
        a2 = (1 - e) * (alpha - 2 * beta) + delta * (
            3 * delta - e * delta + 3 * beta * e - beta - alpha
        )
        a3 = (1 - e) * (alpha + 4 * beta) + delta * (
            3 * delta + e * delta - 3 * beta * e - beta - e * alpha
        )
        a4 = -(1 - e) * (alpha + 2 * beta) + delta / 2 * (1 + e) * (alpha + 2 * beta + 2 * delta)
        return float(a1 * a2 * a3 - a4 * a1**2 - a0 * a3**2)

    for delta in (0.05, 0.2):
        for beta in (0.0, 0.1, 0.4):
            critical = float(critical_stiffness(1.0, delta, beta, 1.0, 1.0))
            assert determinant(delta, critical * (1 - 1e-6), beta) > 0
            assert determinant(delta, critical * (1 + 1e-6), beta) < 0


def test_whole_delay_meets_the_characteristic_polynomial() -> None:
    # Gil et al., eq. (11) multiplied out: a double root on the circle at the exact limit
    delta, d = 0.05, 3
    eps = np.exp(-delta)
    for beta in (0.0, 0.05, 0.2):
        point = critical_point(1.0, delta, beta, 1.0, d)
        alpha = float(point.stiffness)
        c = np.zeros(d + 4)
        c[d + 3], c[d + 2], c[d + 1] = delta**2, -(1 + eps) * delta**2, eps * delta**2
        c[2] += -(1 - eps - delta) * (alpha + beta)
        c[1] += (1 - eps - delta * eps) * (alpha + beta) + (1 - eps - delta) * beta
        c[0] += -(1 - eps - delta * eps) * beta
        roots = np.roots(c[::-1])
        outermost = roots[np.argmax(np.abs(roots))]
        assert abs(outermost) == pytest.approx(1, abs=1e-9)
        assert abs(np.angle(outermost)) == pytest.approx(2 * np.pi * point.frequency, rel=1e-7)


def test_published_servos() -> None:
    # MX-64 at 1 kHz, no virtual damping: linear limits 23.4/7.79/4.68/2.13 N·m/rad
    delay = np.array([0, 1, 2, 5]) * 1e-3
    exact = critical_stiffness(0.011951, 0.011692, 0.0, 1e-3, delay)
    np.testing.assert_allclose(exact, [23.4, 7.79, 4.68, 2.13], rtol=5e-3)
    # much damping, late: XL330-M288 and XL-320, where the linear condition says 37 for both
    late = critical_stiffness([0.0018142, 0.001119], [0.0036617, 0.0033176], 0.2, 1e-3, 5e-3)
    np.testing.assert_allclose(late, [26.0, 16.9], atol=0.06)


def test_the_limit_moves_smoothly_over_whole_delays() -> None:
    late = np.array([2 - 1e-9, 2.0, 2 + 1e-9])
    k = critical_stiffness(0.01, 0.01, 0.1, 1e-3, late * 1e-3)
    np.testing.assert_allclose(k, k[1], rtol=1e-7)


def test_no_stiffness_is_stable_without_damping() -> None:
    assert critical_stiffness(1.0, 0.0, 0.0, 1.0, 0.0) == 0
    assert critical_stiffness(1.0, 0.1, -0.1, 1.0, 0.0) == 0
    assert critical_point(1.0, 0.1, -0.2, 1.0, 1.0).frequency == 0


def test_extreme_settings_give_finite_numbers() -> None:
    inertia, damping, virtual, late = np.meshgrid(
        [1e-6, 1.0, 1e3], [0.0, 1e-9, 10.0], [-1e6, -1.0, 0.0, 1e-6, 1e12], [0.0, 0.5, 55.3, 200.0]
    )
    k = critical_stiffness(inertia, damping, virtual, 1e-3, late * 1e-3, velocity_samples=4)
    assert np.all(np.isfinite(k))
    assert np.all(k >= 0)


def test_shapes_broadcast_and_scalars_stay_scalars() -> None:
    k = critical_stiffness(1.0, 0.1, np.zeros((3, 1)), 1e-3, np.zeros(4))
    assert k.shape == (3, 4)
    assert np.ndim(critical_stiffness(1.0, 0.1, 0.0, 1e-3, 0.0)) == 0


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
