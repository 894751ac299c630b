"""A wall that never pulls, with counts, friction and a torque limit: which speeds come back."""

from __future__ import annotations

import numpy as np
import pytest

from haptic_wall.controller.theory import max_virtual_damping, one_sided_limit, restitution
from haptic_wall.controller.theory.rebound import (
    OneSidedWall,
    Servos,
    highest_speed,
    lowest_speed,
    never_faster,
)
from haptic_wall.controller.theory.rounded_contact import RoundedContacts, returned_speed
from tests.cases import sampled

T, M, STEP = 1e-3, 0.01, 2 * np.pi / 4096
UNIT = STEP / T


def one(delta: float = 0.001, delay: float = 1.0, gain: float = 1.0) -> Servos:
    return Servos(np.array([M]), np.array([delta * M / T]), np.array([gain]), np.array([delay * T]))


def wall(
    servos: Servos, share: float = 0.1, of_limit: float = 0.8, position_step: float = STEP
) -> OneSidedWall:
    b, t_d = float(servos.damping[0]), float(servos.delay[0])
    damping = share * float(max_virtual_damping(M, b, T, t_d))
    stiffness = of_limit * float(one_sided_limit(M, b, damping, T, t_d))
    return OneSidedWall(stiffness, damping, T, position_step=position_step, torque_limit=1e9)


def returned(
    wall: OneSidedWall, servos: Servos, speeds: np.ndarray, friction: float = 0.0
) -> np.ndarray:
    """Greatest ratio at each entry speed [rad/s] over 21 phases and 6 places in the count."""
    phase, first, speed = (
        each.ravel()
        for each in np.meshgrid(
            np.linspace(0, 1, 21), [0.001, 0.2, 0.4, 0.6, 0.8, 1.0], speeds, indexing="ij"
        )
    )
    s, one = servos, np.ones_like(phase)
    unit = T * T / M
    ratio = returned_speed(
        RoundedContacts(
            delta=s.damping[0] * T / M * one,
            alpha=s.gain[0] * wall.stiffness * unit * one,
            beta=s.gain[0] * wall.damping * T / M * one,
            delay=s.delay[0] / T * one,
            samples=one.astype(np.int64),
            friction=friction * unit / STEP * one,
            limit=s.gain[0] * wall.torque_limit * unit / STEP * one,
            first=first,
            speed=speed / UNIT,
            phase=phase,
        )
    )
    worst: np.ndarray = ratio.reshape(-1, speeds.size).max(axis=0)
    return worst


def test_fast_contacts_are_those_of_the_ideal_wall() -> None:
    random = np.random.default_rng(0)
    for _ in range(6):
        servos = one(10 ** random.uniform(-3, -1), random.uniform(0, 4))
        stiff = wall(servos, random.uniform(0, 0.7))
        ideal = restitution(
            M, servos.damping, stiff.stiffness, stiff.damping, T, servos.delay, phases=21
        )
        # a million counts a period: one more or less is a millionth
        fast = returned(stiff, servos, np.array([1e6 * UNIT]))
        np.testing.assert_allclose(fast, ideal, atol=1e-5)


@pytest.mark.parametrize("friction", sampled([0.2, 0.0, 0.6], 3))
@pytest.mark.parametrize(("share", "delay"), [(0.02, 1.0), (0.1, 0.0), (0.1, 2.5), (0.7, 1.0)])
def test_above_the_lowest_speed_none_comes_back_faster_and_below_some_do(
    share: float, delay: float, friction: float
) -> None:
    servos = one(delay=delay)
    stiff = wall(servos, share)
    coulomb = friction * stiff.count_torque
    low = lowest_speed(stiff, servos, coulomb)
    assert low is not None
    assert np.max(returned(stiff, servos, low * np.geomspace(1.0, 100, 50), coulomb)) <= 1.0
    assert np.max(returned(stiff, servos, low * np.geomspace(0.003, 1.0, 40), coulomb)) > 1.0


def test_friction_above_one_counts_torque_leaves_no_lowest_speed() -> None:
    servos = one()
    stiff = wall(servos)
    coulomb = 1.1 * stiff.count_torque
    assert lowest_speed(stiff, servos, coulomb) is None
    slow = np.geomspace(1e-4, 10.0, 40) * UNIT
    assert np.max(returned(stiff, servos, slow, coulomb)) <= 1.0


def test_friction_that_stops_a_device_within_the_difference_keeps_a_lowest_speed() -> None:
    """The damper sees how fast it was two samples ago; found by search, 15 times its speed."""
    m, gain = 0.0026583237816646343, 1.642
    servos = Servos(np.array([m]), np.array([0.153]), np.array([gain]), np.array([0.0]))
    stiff = OneSidedWall(86.82, 0.9658, T, STEP, 1e9, velocity_samples=2)
    coulomb = 2.1526
    assert coulomb > gain * stiff.count_torque
    assert lowest_speed(stiff, servos, coulomb) is not None


def test_without_counts_there_is_no_lowest_speed() -> None:
    servos = one()
    assert lowest_speed(wall(servos, position_step=0.0), servos, 0.0) is None


@pytest.mark.whole
def test_up_to_the_highest_speed_the_torque_stays_within_its_limit() -> None:
    """A limit there changes no contact: with it and without it they return the same."""
    random = np.random.default_rng(1)
    for _ in range(12):
        servos = one(10 ** random.uniform(-3, -0.5), random.uniform(0, 4), random.uniform(0.5, 2))
        stiff = wall(servos, random.uniform(0, 0.7), of_limit=0.4)
        limit = stiff.count_torque * 10 ** random.uniform(0.3, 2)
        cut = OneSidedWall(stiff.stiffness, stiff.damping, T, STEP, limit)
        high = highest_speed(cut, servos, 0.0)
        speeds = high * np.array([0.3, 0.7, 1.0])
        np.testing.assert_array_equal(
            returned(cut, servos, speeds), returned(stiff, servos, speeds)
        )
        # and it is not far off: at some three times it the limit cuts
        assert np.any(returned(cut, servos, 4 * speeds) != returned(stiff, servos, 4 * speeds))


def test_saturation_returns_a_device_faster() -> None:
    """The limit holds here, and the torque limit alone undoes it."""
    servos = one(delta=1e-4, delay=0.0245)
    stiff = wall(servos, 0.05)
    speed = np.array([1e5 * UNIT])  # where counts do not matter
    assert returned(stiff, servos, speed) < 1.0
    peak = speed[0] * (np.sqrt(stiff.stiffness * M) + stiff.damping)
    cut = OneSidedWall(stiff.stiffness, stiff.damping, T, STEP, 0.17 * peak)
    assert highest_speed(cut, servos, 0.0) < speed[0]
    assert returned(cut, servos, speed) > 1.02


def test_one_count_that_saturates_leaves_no_speed() -> None:
    servos = one()
    stiff = wall(servos)
    cut = OneSidedWall(stiff.stiffness, stiff.damping, T, STEP, 0.9 * stiff.count_torque)
    assert highest_speed(cut, servos, 0.0) == 0.0


def test_above_the_limit_it_is_said_to_be_faster() -> None:
    servos = one()
    assert never_faster(wall(servos), servos)
    assert not never_faster(wall(servos, of_limit=1.2), servos)


@pytest.mark.parametrize("stiffness", [0.0, 1e-9, 1e-4])
def test_hardly_any_spring_ends_too(stiffness: float) -> None:
    """No contact of a hundred thousand periods is simulated."""
    soft = OneSidedWall(stiffness, 0.01, T, STEP, 1.0)
    low = lowest_speed(soft, one(), 0.0)
    assert low is not None
    assert low > 0
    assert highest_speed(soft, one(), 0.0) > 0
