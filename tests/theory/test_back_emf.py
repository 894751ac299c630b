"""A current loop that takes the back-EMF away late may be counted as a delay and some inertia."""

import math

import numpy as np
import pytest
from scipy.linalg import expm

from haptic_wall.controller.theory import critical_stiffness
from haptic_wall.controller.theory.checks import FloatArray

PERIOD = 1e-3
DELAY = 1e-3


def greatest_pole(stiffness: float, damping: float, servo: FloatArray, lag: float) -> float:
    """The largest modulus of a pole of the sampled loop, one sample late.

    States: position, speed, the filtered torque, the filtered speed, the last position and torque.
    """
    inertia, viscous, motor = servo
    rates = np.zeros((5, 5))
    rates[0, 1] = 1.0
    rates[1, 1:4] = -(viscous + motor) / inertia, 1.0 / inertia, motor / inertia
    rates[2, 2], rates[2, 4] = -1.0 / lag, 1.0 / lag
    rates[3, 1], rates[3, 3] = 1.0 / lag, -1.0 / lag
    held = expm(PERIOD * rates)
    loop = np.zeros((6, 6))
    loop[:4, :4], loop[:4, 5] = held[:4, :4], held[:4, 4]
    loop[4, 0] = 1.0
    loop[5, 0], loop[5, 4] = -(stiffness + damping / PERIOD), damping / PERIOD
    return float(np.max(np.abs(np.linalg.eigvals(loop))))


@pytest.mark.parametrize("hertz", [50.0, 160.0, 1000.0])
@pytest.mark.parametrize("damping", [0.0, 0.03])
@pytest.mark.parametrize("servo", [(0.012, 0.0117, 0.85), (0.0018, 0.0037, 0.0477)])
def test_the_limit_with_that_inertia_is_not_too_high(
    servo: tuple[float, float, float], damping: float, hertz: float
) -> None:
    inertia, viscous, motor = servo
    lag = 1.0 / (math.tau * hertz)
    counted = critical_stiffness(inertia + motor * lag, viscous, damping, PERIOD, DELAY + lag)
    assert greatest_pole(float(counted), damping, np.array(servo), lag) < 1.0
    assert greatest_pole(2.0 * float(counted), damping, np.array(servo), lag) > 1.0
