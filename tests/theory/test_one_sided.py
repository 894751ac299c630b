"""A wall that never pulls: restitution against an independent contact, and the limit from it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from haptic_wall.controller.theory import (
    critical_stiffness,
    max_virtual_damping,
    one_sided_limit,
)
from tests.support.contacts import restitution
from tests.support.one_sided_fill import looked_up
from tests.theory.oracles import Loop, bounce, radius


def random_walls(count: int, seed: int) -> tuple[np.ndarray, ...]:
    """Inertia, damping, virtual damping (negative for one in five), period, delay, N."""
    random = np.random.default_rng(seed)
    inertia = 10 ** random.uniform(-3, -1, count)
    period = 10 ** random.uniform(-3.3, -2.5, count)
    damping = 10 ** random.uniform(-3, -1, count) * inertia / period
    late = np.where(
        random.random(count) < 0.4, random.integers(0, 6, count), random.uniform(0, 6, count)
    )
    n = random.choice([1, 1, 1, 2, 4], count)
    ceiling = max_virtual_damping(inertia, damping, period, late * period, n)
    virtual = np.where(
        random.random(count) < 0.2,
        -damping * random.random(count),
        0.8 * ceiling * random.random(count),
    )
    return inertia, damping, virtual, period, late * period, n


def test_restitution_equals_an_independent_contact() -> None:
    m, b, virtual, t, delay, n = random_walls(40, seed=1)
    stiffness = 0.9 * critical_stiffness(m, b, virtual, t, delay, n)
    loops = [
        Loop.of(row[:6], row[6]) for row in zip(m, b, stiffness, virtual, t, delay, n, strict=True)
    ]
    # the oracle looks at the speed at samples and switches only: a device that leaves freely has
    # lost up to b T / m of its speed since the wall
    simulated = np.max(bounce(loops, np.linspace(1e-9, 1, 33)), axis=1)
    found = restitution(m, b, stiffness, virtual, t, delay, 33, n)
    fast = simulated > 0.3
    assert np.count_nonzero(fast) > 25
    difference = (found - simulated)[fast]
    assert np.all(difference > -1e-6)
    assert np.all(difference < (found * b * t / m)[fast] + 1e-6)


def test_the_limit_is_where_the_device_comes_back_as_fast(wholly: bool) -> None:
    m, b, virtual, t, delay, n = random_walls(150 if wholly else 60, seed=2)
    limit = one_sided_limit(m, b, virtual, t, delay, n)
    exact = critical_stiffness(m, b, virtual, t, delay, n)
    assert np.all(limit <= exact * (1 + 1e-9))
    below = restitution(m, b, limit * (1 - 2e-4), virtual, t, delay, 201, n)
    above = restitution(m, b, limit * (1 + 2e-4), virtual, t, delay, 201, n)
    assert np.all(below < 1 + 1e-6)
    lower = limit < exact * (1 - 1e-6)
    assert np.count_nonzero(lower) > 0.5 * lower.size
    assert np.all(above[lower] > 1 - 1e-6)


@pytest.mark.parametrize("limit", [one_sided_limit, looked_up])
def test_at_the_limit_no_device_comes_back_faster_and_a_tenth_above_it_some_do(
    limit: Callable[..., np.ndarray], thorough: bool, wholly: bool
) -> None:
    m, b, virtual, t, delay, n = random_walls(1000 if thorough else 250 if wholly else 60, seed=3)
    stiffness = limit(m, b, virtual, t, delay, n)
    assert np.all(stiffness > 0)

    def loops(factor: float) -> list[Loop]:
        rows = zip(m, b, factor * stiffness, virtual, t, delay, n, strict=True)
        return [Loop.of(row[:6], row[6]) for row in rows]

    phases = np.array([1e-9, 0.2, 0.4, 0.6, 0.8, 0.9, 0.97, 1.0])
    # the computed limit is within 1e-4, and a ratio grows less than its stiffness does
    assert np.max(bounce(loops(1.0), phases)) <= 1 + 2e-4
    above = loops(1.1)
    returned = np.max(bounce(above, phases), axis=1)
    # where it is the exact limit that binds, a stiffer wall need not throw: it is unstable
    unstable = np.array([radius(loop) for loop in above]) > 1
    # the oracle sees the speed up to a period late, and the device has slowed down since
    assert np.all((returned * np.exp(b * t / m) > 1) | unstable)
    throws = stiffness < 0.95 * critical_stiffness(m, b, virtual, t, delay, n)
    assert np.count_nonzero(throws) > 0.5 * throws.size
    assert np.mean(returned[throws] > 1) > 0.98


def test_a_device_that_slows_down_outside_was_fast_when_it_left() -> None:
    """Much friction and a long delay: it is slow again before the last torque has ended."""
    random = np.random.default_rng(4)
    damping = 10 ** random.uniform(-0.3, 0.4, 40)
    late, n = random.uniform(5.0, 20.0, 40), random.choice([1, 1, 2, 4], 40)
    ceiling = max_virtual_damping(1.0, damping, 1.0, late, n)
    virtual = random.uniform(0.1, 0.95, 40) * ceiling
    limit = one_sided_limit(1.0, damping, virtual, 1.0, late, n)
    exact = critical_stiffness(1.0, damping, virtual, 1.0, late, n)
    stiffness = np.where(limit > 0, limit * (1 - 1e-3), 0.01 * exact)
    loops = [
        Loop.of((1.0, *row[:5]), row[5])
        for row in zip(damping, stiffness, virtual, np.ones(40), late, n, strict=True)
    ]
    # what the oracle sees of the speed is less than it was at the wall
    returned = np.max(bounce(loops, np.linspace(1e-9, 1, 33)), axis=1)
    assert np.all(returned[limit > 0] < 1)
    assert np.count_nonzero(limit > 0) > 10
    assert np.count_nonzero(returned[limit == 0] > 1) > 10


def test_next_to_the_ends_of_the_damping_range_it_is_a_number_without_a_warning() -> None:
    share = np.array([1e-3, 1e-6, 1e-9, 1e-12, 1e-15])
    for damping in (1e-9, 1e-3, 0.1, 1.0):
        for delay in (0.0, 1.0 - 1e-12, 2.5):
            top = max_virtual_damping(1.0, damping, 1.0, delay)
            for virtual in (-damping * (1 - share), top * (1 - share)):
                found = one_sided_limit(1.0, damping, virtual, 1.0, delay, tolerance=0.01)
                exact = critical_stiffness(1.0, damping, virtual, 1.0, delay)
                assert np.all(found <= exact)
                assert np.all(found >= 0)
    # next to -b a contact creeps: what is exact holds
    creeping = -0.1 * (1 - share[1:])
    np.testing.assert_allclose(
        one_sided_limit(1.0, 0.1, creeping, 1.0, 1.0),
        critical_stiffness(1.0, 0.1, creeping, 1.0, 1.0),
    )


def test_hardly_any_damping_and_a_long_difference_end_too() -> None:
    assert one_sided_limit(1.0, 0.0, 1e-300, 1.0, 0.0, 3) == pytest.approx(2e-300, rel=1e-3)


def test_what_would_never_end_is_refused() -> None:
    with pytest.raises(ValueError, match="period is too small"):
        one_sided_limit(1.0, 0.1, 0.0, 1.0, 1e5)
    with pytest.raises(ValueError, match="tolerance must be a number"):
        one_sided_limit(1.0, 0.1, 0.0, 1.0, 0.0, tolerance="small")  # type: ignore[arg-type]


def test_zero_where_nothing_is_stable() -> None:
    assert one_sided_limit(1.0, 0.0, 0.0, 1.0, 1.0) == 0
    assert one_sided_limit(1.0, 0.01, 5.0, 1.0, 1.0) == 0


def test_errors_name_the_argument() -> None:
    with pytest.raises(ValueError, match="inertia must be > 0, got -1"):
        one_sided_limit(-1.0, 0.1, 0.0, 1.0, 0.0)
