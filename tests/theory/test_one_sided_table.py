"""The looked-up limit of a wall that never pulls: safe, tight, quick, and where there is none."""

from __future__ import annotations

import numpy as np
import pytest

from haptic_wall.controller.theory import critical_stiffness, max_virtual_damping, one_sided_limit
from haptic_wall.controller.theory import one_sided_table as tables
from haptic_wall.controller.theory.one_sided_table import tabulated_share
from tests.support.one_sided_fill import computed_share, looked_up

Array = np.ndarray


def random_settings(count: int, seed: int) -> tuple[Array, ...]:
    """delta, beta, d, N as of the settings of a testbed and far beyond, and the ceiling."""
    random = np.random.default_rng(seed)
    half = random.random(count) < 0.5
    delta = np.where(half, 10 ** random.uniform(-6, -1, count), 0.1 * random.random(count))
    which = random.random(count)
    late = np.where(which < 0.6, 6 * random.random(count), 60 * random.random(count) ** 1.5)
    late = np.where(which < 0.3, np.floor(late), late)
    samples = np.ones(count)
    ceiling = max_virtual_damping(1.0, delta, 1.0, late)
    return delta, 0.95 * random.random(count) * ceiling, late, samples, ceiling


def test_looked_up_is_not_above_what_is_computed_and_hardly_below(
    thorough: bool, wholly: bool
) -> None:
    count = 10_000 if thorough else 700 if wholly else 100
    delta, beta, late, samples, ceiling = random_settings(count, 31)
    share = tabulated_share(delta, beta, late, samples, ceiling)
    known = np.isfinite(share)
    # up to the share of the ceiling that the guard allows, nearly everything is in the table
    assert np.mean(known[beta < 0.7 * ceiling]) > 0.97
    delta, beta, late, share = delta[known], beta[known], late[known], share[known]
    exact = critical_stiffness(1.0, delta, beta, 1.0, late)
    ratio = share * exact / one_sided_limit(1.0, delta, beta, 1.0, late)
    assert np.max(ratio) <= 1.005
    assert np.min(ratio) >= 0.95
    assert np.median(ratio) > 0.995
    assert np.quantile(ratio, 0.05) > 0.98


def test_nor_near_the_ceiling_where_the_share_is_scalloped_within_a_cell(thorough: bool) -> None:
    count = 5000 if thorough else 500
    random = np.random.default_rng(35)
    delta = 10 ** random.uniform(-6, -2.5, count)
    late = random.uniform(6.6, 9.0, count)
    ceiling = max_virtual_damping(1.0, delta, 1.0, late)
    beta = random.uniform(0.8, 0.92, count) * ceiling
    share = tabulated_share(delta, beta, late, np.ones(count), ceiling)
    known = np.isfinite(share)
    assert np.sum(known) >= 40  # little of it is in the table, but enough to tell
    ratio = share[known] / computed_share(delta[known], beta[known], late[known], 1)
    assert np.max(ratio) <= 1.005
    assert np.min(ratio) >= 0.95


@pytest.mark.parametrize(
    ("damping", "of_ceiling", "late", "n"),
    [
        (0.5, 0.3, 1.0, 1),
        (0.01, -0.002, 1.0, 1),
        (0.01, 0.97, 1.0, 1),
        (0.01, 0.3, 1.0, 3),
    ],
    ids=["damping", "negative", "ceiling", "samples"],
)
def test_outside_of_the_table_it_is_computed(
    damping: float, of_ceiling: float, late: float, n: int
) -> None:
    virtual = of_ceiling * max_virtual_damping(1.0, damping, 1.0, late, n)
    computed = one_sided_limit(1.0, damping, virtual, 1.0, late, n)
    assert looked_up(1.0, damping, virtual, 1.0, late, n) == computed


@pytest.mark.whole
def test_a_longer_delay_is_looked_up_with_a_longer_period() -> None:
    random, count = np.random.default_rng(36), 24
    late, n = 60 * 10 ** random.uniform(0, 0.9, count), random.choice([1, 1, 4, 32], count)
    delta = 10 ** random.uniform(-6, -1, count)
    ceiling = max_virtual_damping(1.0, delta, 1.0, late, n)
    beta = np.maximum(random.uniform(-0.3, 0.95, count) * ceiling, -0.7 * delta)
    found = looked_up(1.0, delta, beta, 1.0, late, n)
    ratio = found / one_sided_limit(1.0, delta, beta, 1.0, late, n)
    assert ratio.min() >= 0.95 and ratio.max() <= 1.01


def test_zero_where_nothing_is_stable() -> None:
    assert looked_up(1.0, 0.0, 0.0, 1.0, 1.0) == 0
    assert looked_up(1.0, 0.01, 5.0, 1.0, 1.0) == 0


def test_the_table_is_small() -> None:
    assert tables.TABLE.stat().st_size < 500e3
