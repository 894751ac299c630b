"""The simulated critical stiffness against theory that knows nothing of simulation."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
import pytest

from haptic_wall.controller.theory import critical_stiffness, max_virtual_damping, one_sided_limit
from haptic_wall.controller.theory.checks import FloatArray, IntArray
from haptic_wall.controller.theory.harmonic import Lossy, kick_limit
from tests.support.simulated_limits import simulated_critical_stiffness

T = TypeVar("T")
FiveOf = tuple[T, T, T, T, T]
SMALL = (0.011951, 0.011692)
"""Inertia and damping of an MX-64"""


def random_loops(seed: int, n: int) -> tuple[FiveOf[FloatArray], IntArray]:
    """Inertia, damping, B, T, delay and N at random, up to 0.9 of the damping ceiling."""
    rng = np.random.default_rng(seed)
    inertia, period = 10 ** rng.uniform(-3, 0, n), 10 ** rng.uniform(-3.5, -2, n)
    delta = 10 ** rng.uniform(-4, -1, n)
    damping = delta * inertia / period
    delay = period * np.where(rng.random(n) < 0.5, rng.integers(0, 6, n), rng.uniform(0, 6, n))
    samples = rng.integers(1, 4, n)
    ceiling = max_virtual_damping(inertia, damping, period, delay, samples)
    virtual = np.where(rng.random(n) < 0.1, -0.3 * damping, rng.uniform(0, 0.9, n) * ceiling)
    return (inertia, damping, virtual, period, delay), samples


def test_random_two_sided_walls_are_on_the_exact_boundary(thorough: bool) -> None:
    loop, samples = random_loops(3, 400 if thorough else 6)
    found = simulated_critical_stiffness(*loop, velocity_samples=samples)
    # Turning points are taken from the speeds at the samples, which is not exact under friction.
    np.testing.assert_allclose(found, critical_stiffness(*loop, samples), rtol=2e-4)


def test_random_one_sided_walls_return_the_speed_at_the_theorys_limit(thorough: bool) -> None:
    loop, samples = random_loops(4, 200 if thorough else 30)
    found = simulated_critical_stiffness(
        *loop, velocity_samples=samples, one_sided=True, tolerance=1e-3
    )
    # The theory's limit is capped by the two-sided one, and within three times 1e-4.
    limit = one_sided_limit(*loop, samples)
    capped = limit >= 0.999 * critical_stiffness(*loop, samples)
    np.testing.assert_allclose(found[~capped], limit[~capped], rtol=3e-4)
    assert np.count_nonzero(~capped) > 20


@pytest.mark.parametrize("kick", [0.3, 0.074, 0.023])
def test_with_friction_a_larger_kick_needs_less_stiffness_as_the_harmonic_balance_says(
    kick: float,
) -> None:
    found = simulated_critical_stiffness(
        *SMALL, 0.0, 1e-3, 2e-3, coulomb=0.09039, kick=kick, tolerance=1e-3
    )
    balance = kick_limit(Lossy(*SMALL, 0.09039), 0.0, 1e-3, 2e-3, kick)
    assert found == pytest.approx(balance, rel=0.02)


def test_above_the_damping_ceiling_no_stiffness_is_stable_and_the_answer_is_zero() -> None:
    ceiling = max_virtual_damping(*SMALL, 1e-3, 2e-3)
    assert simulated_critical_stiffness(*SMALL, 1.2 * ceiling, 1e-3, 2e-3) == 0.0
    assert simulated_critical_stiffness(*SMALL, -1.2 * SMALL[1], 1e-3, 2e-3) == 0.0
