"""Friction: the passive limit, and the kick from which motion grows, against exact simulation."""

from __future__ import annotations

import math

import numpy as np
import pytest

from haptic_wall.controller.theory import critical_stiffness, max_virtual_damping
from haptic_wall.controller.theory.friction import friction_limit, onset_amplitude
from tests.support.exact_servo import PlantParameters, State, step

PERIOD = 1e-3
COUNT = 2 * math.pi / 4096


def grows(plant: PlantParameters, wall: tuple[float, float, float], kick: float, w: float) -> bool:
    """Whether an oscillation at ``w``, met at a turning point of height ``kick``, gets larger.

    The wall's past is that of the oscillation: its samples, and the torques still to act.
    Decided when a turning point is 20 % off the kick.
    """
    k, big_b, delay = wall
    whole = int(delay / PERIOD)
    switch = delay - whole * PERIOD

    def torque(now: float, before: float) -> float:
        return -k * now - big_b * (now - before) / PERIOD

    past = [kick * math.cos(w * PERIOD * i) for i in range(whole + 3)]
    ring = [torque(past[i], past[i + 1]) for i in range(whole + 1, 0, -1)]  # the oldest first
    state, before = State(kick, 0.0), past[1]
    extreme = 0.0
    for _ in range(400_000):
        ring.append(torque(state.position, before))
        before = state.position
        old = ring.pop(0)
        middle = step(state, plant, old, switch) if switch > 0 else state
        after = step(middle, plant, ring[0], PERIOD - switch)
        if after.velocity * state.velocity <= 0:  # a turning point of this step or the last
            if 0 < extreme < 0.8 * kick or (after.velocity == state.velocity == 0):
                return False
            extreme = 0.0
        extreme = max(extreme, abs(after.position))
        if extreme > 1.2 * kick:
            return True
        state = after
    raise AssertionError("neither grows nor decays")


def candidates(count: int, seed: int) -> list[tuple[PlantParameters, tuple[float, float, float]]]:
    """Plants like small servos with walls above their limit, onset from 20 counts to 1 rad."""
    random = np.random.default_rng(seed)
    many = 40 * count
    m = 10 ** random.uniform(-3, -1.5, many)
    b = 10 ** random.uniform(-2.8, -1.3, many)
    c = 10 ** random.uniform(-2.2, -0.8, many)
    delay = random.uniform(0, 6, many) * PERIOD
    ceiling = max_virtual_damping(m, b, PERIOD, delay)
    big_b = np.where(random.random(many) < 0.3, 0.0, random.uniform(-0.5, 1, many))
    big_b = np.where(big_b < 0, big_b * b, 0.7 * big_b**2 * ceiling)
    k = critical_stiffness(m, b, big_b, PERIOD, delay) * 10 ** random.uniform(0.02, 1, many)
    onset = onset_amplitude(m, b, c, k, big_b, PERIOD, delay).amplitude
    chosen = np.flatnonzero((onset > 20 * COUNT) & (onset < 1.0))[:count]
    assert chosen.size == count
    return [
        (
            PlantParameters(float(m[i]), float(b[i]), float(c[i])),
            (float(k[i]), float(big_b[i]), float(delay[i])),
        )
        for i in chosen
    ]


def test_motion_dies_below_the_onset_and_grows_above_it(thorough: bool, wholly: bool) -> None:
    for plant, wall in candidates(50 if thorough else 12 if wholly else 2, 1):
        k, big_b, delay = wall
        onset = onset_amplitude(
            plant.inertia, plant.damping, plant.coulomb, k, big_b, PERIOD, delay
        )
        amplitude, w = float(onset.amplitude), 2 * math.pi * float(onset.frequency)
        assert not grows(plant, wall, 0.95 * amplitude, w), (plant, wall)
        assert grows(plant, wall, 1.05 * amplitude, w), (plant, wall)


def test_a_virtual_damping_out_of_bounds_has_an_onset_too() -> None:
    plant, delay = PlantParameters(2e-3, 4e-3, 0.1), 2.3e-3
    ceiling = float(max_virtual_damping(2e-3, 4e-3, PERIOD, delay))
    for big_b, k in ((-6e-3, 0.5), (1.02 * ceiling, 0.002 * 2e-3 / PERIOD**2)):
        assert critical_stiffness(2e-3, 4e-3, big_b, PERIOD, delay) == 0
        onset = onset_amplitude(2e-3, 4e-3, 0.1, k, big_b, PERIOD, delay)
        amplitude, w = float(onset.amplitude), 2 * math.pi * float(onset.frequency)
        assert not grows(plant, (k, big_b, delay), 0.95 * amplitude, w)
        assert grows(plant, (k, big_b, delay), 1.05 * amplitude, w)


def test_nothing_grows_below_the_limit_and_everything_above_it_without_friction() -> None:
    limit = float(critical_stiffness(0.01, 0.01, 0.02, 1e-3, 2.5e-3))
    k = limit * np.array([1e-6, 0.5, 1.0, 1.001, 1e6])
    with_friction = onset_amplitude(0.01, 0.01, 0.05, k, 0.02, 1e-3, 2.5e-3)
    without = onset_amplitude(0.01, 0.01, 0.0, k, 0.02, 1e-3, 2.5e-3)
    assert np.isinf(with_friction.amplitude).tolist() == [True, True, True, False, False]
    assert np.all(np.diff(with_friction.amplitude[2:]) < 0)
    np.testing.assert_array_equal(without.amplitude, [np.inf, np.inf, np.inf, 0, 0])
    assert np.all(with_friction.frequency > 0)


def test_the_extra_damping_puts_the_wall_on_its_boundary(wholly: bool) -> None:
    random, count = np.random.default_rng(3), 200 if wholly else 40
    b, delay = 10 ** random.uniform(-3, -1, count), random.uniform(0, 10, count) * 1e-3
    ceiling = max_virtual_damping(0.01, b, 1e-3, delay)
    big_b = np.where(random.random(count) < 0.5, -b, ceiling) * random.uniform(0, 1.5, count)
    k = 10 ** random.uniform(-1, 5, count)
    onset = onset_amplitude(0.01, b, 0.05, k, big_b, 1e-3, delay)
    above = np.isfinite(onset.amplitude)
    assert np.count_nonzero(above) > count / 2
    np.testing.assert_array_equal(~above, k <= critical_stiffness(0.01, b, big_b, 1e-3, delay))
    w = 2 * np.pi * onset.frequency[above]
    extra = 4 * 0.05 / (np.pi * onset.amplitude[above] * w)
    limit = critical_stiffness(0.01, b[above] + extra, big_b[above], 1e-3, delay[above])
    np.testing.assert_allclose(limit, k[above], rtol=1e-9)


def test_the_smaller_of_two_conditions_is_passive() -> None:
    limit = friction_limit(0.01, [0.0, 0.01, 1.0], 2 * np.pi / 4096, 1e-3)
    np.testing.assert_allclose(limit, [0.0, 0.02 * 4096 / (2 * np.pi), 20.0])
    assert friction_limit(0.01, 0.0, 0.0, 1e-3) == 20.0  # no quantisation asks for no friction


def test_below_it_a_quantised_wall_never_gives_energy() -> None:
    """The energy that the wall gives over any sampled path is paid by friction on that path."""
    random = np.random.default_rng(4)
    b, c, q = 0.01, 0.004, 0.003
    k = float(friction_limit(b, c, q, 1e-3))
    path = np.cumsum(random.normal(0, 0.004, (200, 400)), axis=1)
    torque = -k * q * np.round(path / q)
    moved = np.diff(path, axis=1)
    given = np.cumsum(torque[:, :-1] * moved, axis=1)
    paid = np.cumsum(b * moved**2 / 1e-3 + c * np.abs(moved), axis=1)
    start = 0.5 * k * (np.abs(path[:, :1]) + q) ** 2  # what the spring held to begin with
    assert np.all(given <= paid + start)


@pytest.mark.parametrize(
    ("name", "value"),
    [("inertia", 0.0), ("stiffness", 0.0), ("coulomb", -1.0), ("delay", math.nan)],
)
def test_errors_name_the_argument(name: str, value: float) -> None:
    good = {
        "inertia": 0.01,
        "damping": 0.01,
        "coulomb": 0.1,
        "stiffness": 9.0,
        "virtual_damping": 0.0,
        "period": 1e-3,
        "delay": 0.0,
    }
    with pytest.raises(ValueError, match=f"^{name} must be"):
        onset_amplitude(**good | {name: value})
