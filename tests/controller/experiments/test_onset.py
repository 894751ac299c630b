"""The simulated critical stiffness against theory that knows nothing of simulation."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
import pytest

from haptic_wall.controller.experiments.maps.walls import Loop, wall_of
from haptic_wall.controller.theory import critical_stiffness, max_virtual_damping, one_sided_limit
from haptic_wall.controller.theory.checks import FloatArray, IntArray
from haptic_wall.controller.theory.harmonic import Lossy, kick_limit
from haptic_wall.hw.truth import TrueServo
from tests.support.simulated_limits import simulated_critical_stiffness

T = TypeVar("T")
FiveOf = tuple[T, T, T, T, T]
COUNT = 2 * np.pi / 4096
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
    loop, samples = random_loops(3, 400 if thorough else 15)
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


def test_an_encoder_hardly_changes_the_limit_of_motion_over_many_counts() -> None:
    found = simulated_critical_stiffness(
        *SMALL, [0.0, 0.02], 1e-3, 2e-3, position_step=COUNT, kick=0.3, tolerance=1e-3
    )
    np.testing.assert_allclose(
        found, critical_stiffness(*SMALL, [0.0, 0.02], 1e-3, 2e-3), rtol=5e-3
    )


def test_play_costs_stiffness_and_small_motion_most() -> None:
    """Play adds lag, the more the smaller the motion (its describing function)."""
    free = critical_stiffness(*SMALL, 0.05, 1e-3, 2e-3)
    found = simulated_critical_stiffness(
        *SMALL, 0.05, 1e-3, 2e-3, backlash=0.002, kick=[0.004, 0.05, 0.5], tolerance=1e-3
    )
    assert found[0] < found[1] < found[2] < free


def after_long(
    loop: FiveOf[FloatArray | float],
    stiffness: FloatArray,
    kick: FloatArray | float,
    coulomb: FloatArray | float,
    play: FloatArray | float,
    turns: int = 80,
) -> FloatArray:
    """Amplitude that the motion after a kick has come to, in kicks; two-sided walls."""
    found = []
    for m, b, virtual, period, delay, k, start, c, slack in zip(
        *(each.tolist() for each in np.broadcast_arrays(*loop, stiffness, kick, coulomb, play)),
        strict=True,
    ):
        servo = TrueServo(m, b, c, backlash=slack, torque_limit=np.inf)
        wall = wall_of(servo, period=period, delay=delay, virtual_damping=virtual)
        turn = int(2 * np.pi * np.sqrt(m / k) / period)
        long = Loop(wall, k, start)
        course: list[float] = []
        for _ in range(turns):
            course = long.run(turn)[:, 0].tolist() + course[: 10 * turn]
            if max(map(abs, course)) > 1e3 * start:
                break
        found.append(max(map(abs, course[: 10 * turn])) / start)
    return np.array(found)


def both_sides(
    loop: FiveOf[FloatArray | float],
    share: float,
    found: FloatArray,
    kick: FloatArray,
    coulomb: FloatArray | float,
    play: FloatArray | float,
) -> list[FloatArray]:
    """The amplitudes this share below and above the critical stiffness, of one simulation."""

    def twice(value: FloatArray | float) -> FloatArray:
        return np.tile(np.broadcast_to(value, found.shape), 2)

    stiffness = np.concatenate([(1.0 - share) * found, (1.0 + share) * found])
    m, b, virtual, period, delay = map(twice, loop)
    return np.split(
        after_long(
            (m, b, virtual, period, delay), stiffness, twice(kick), twice(coulomb), twice(play)
        ),
        2,
    )


@pytest.mark.whole
def test_with_play_motion_comes_to_less_than_the_kick_below_and_to_more_above(
    thorough: bool,
) -> None:
    rng = np.random.default_rng(11)
    n = 60 if thorough else 3
    m = 10 ** rng.uniform(-3, -1.7, n)
    b, delay = m * rng.uniform(0.5, 4, n), rng.uniform(0.5, 7, n) * 1e-3
    virtual = rng.uniform(0.02, 0.4, n) * max_virtual_damping(m, b, 1e-3, delay)
    # Blocks hold walls that all have friction, or all have none.
    coulomb = 10 ** rng.uniform(-4, -3, n)
    play = rng.choice([0.002, 0.004, 0.008], n)
    kick = play * 10 ** rng.uniform(0.5, 1.4, n)
    loop = (m, b, virtual, 1e-3, delay)
    found = [
        simulated_critical_stiffness(
            *loop, coulomb=friction, position_step=COUNT, backlash=play, kick=kick, tolerance=1e-3
        )
        for friction in (0.0, coulomb)
    ]
    m, b, virtual, delay, kick, play = (np.tile(a, 2) for a in (m, b, virtual, delay, kick, play))
    frictions = np.concatenate([0.0 * coulomb, coulomb])
    loop = (m, b, virtual, 1e-3, delay)
    below, above = both_sides(loop, 0.07, np.concatenate(found), kick, frictions, play)
    assert np.all(below < 1.02)
    assert np.all(above > 0.98)


def test_above_the_damping_ceiling_no_stiffness_is_stable_and_the_answer_is_zero() -> None:
    ceiling = max_virtual_damping(*SMALL, 1e-3, 2e-3)
    assert simulated_critical_stiffness(*SMALL, 1.2 * ceiling, 1e-3, 2e-3) == 0.0
    assert simulated_critical_stiffness(*SMALL, -1.2 * SMALL[1], 1e-3, 2e-3) == 0.0
