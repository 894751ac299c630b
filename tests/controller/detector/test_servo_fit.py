"""The servo of a recording is found from its torques and its motion."""

import math

import numpy as np
import pytest

from haptic_wall.controller.detector.servo_fit import fitted_servo
from haptic_wall.controller.theory.checks import FloatArray
from tests.typed import not_none

T, STEP = 1e-3, math.tau / 4096
J, B, K = 2e-3, 4e-3, 8.0


def oscillation(
    damping: float = B, late: int = 1, seconds: float = 0.8, hand: float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Positions in counts and torques of a wall that feeds an inertia, computed in fine steps."""
    x, v, fine = 0.02, 0.0, 20
    positions, torques = [], []
    for k in range(round(seconds / T)):
        positions.append(round(x / STEP) * STEP)
        torques.append(-K * positions[-1])
        acting = torques[k - late] if k >= late else 0.0
        push = hand * math.sin(11.0 * k * T) + hand * math.sin(31.0 * k * T)
        for _ in range(fine):
            v += (acting + push - damping * v) / J * T / fine
            x += v * T / fine
    return np.array(positions), np.array(torques)


def test_inertia_and_delay_are_found_of_a_servo_without_friction() -> None:
    servo = not_none(fitted_servo(*oscillation(damping=0.0), T))
    assert servo.inertia == pytest.approx(J, rel=0.05)
    assert servo.balance < 0.0, "the wall feeds it"
    assert servo.lag() == pytest.approx(T, rel=0.25)


def test_of_damping_and_delay_the_one_tells_the_other() -> None:
    servo = not_none(fitted_servo(*oscillation(), T))
    assert servo.inertia == pytest.approx(J, rel=0.05)
    assert servo.lag(B) == pytest.approx(T, rel=0.25)
    assert servo.damping(T) == pytest.approx(B, rel=0.3)
    assert servo.lag() < servo.lag(B)


def test_a_motion_that_dies_out_is_not_fed() -> None:
    servo = not_none(fitted_servo(*oscillation(damping=0.02, late=0), T))
    assert servo.balance > 0.0
    assert servo.lag() == 0.0


def test_what_a_hand_moves_is_not_the_torques_doing() -> None:
    assert fitted_servo(*oscillation(damping=0.05, late=0, hand=0.3), T) is None


def test_samples_that_are_missing_are_no_obstacle_unless_they_are_many() -> None:
    positions, torques = oscillation()
    positions[100:110], torques[300] = math.nan, math.nan
    assert not_none(fitted_servo(positions, torques, T)).inertia == pytest.approx(J, rel=0.05)
    positions[100:400] = math.nan
    assert fitted_servo(positions, torques, T) is None


def test_what_does_not_oscillate_tells_nothing() -> None:
    times = np.arange(500.0) * T
    for positions in (times, 0.0 * times, np.full(500, math.nan)):
        assert fitted_servo(positions, 1.0 - 0.1 * times, T) is None
        assert fitted_servo(positions, 0.0 * times, T) is None
