"""Transfer functions and state matrices, as scipy and python-control read them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from haptic_wall.controller.theory import critical_point
from haptic_wall.controller.theory.realisation import (
    closed_loop,
    plant,
    pulse_transfer,
    wall_transfer,
)
from tests.theory.oracles import Loop, state_matrix

INERTIA, DAMPING, PERIOD = 0.01, 0.02, 1e-3
DELAYS = [0.0, 0.3e-3, 1e-3, 2.75e-3]


@pytest.mark.parametrize("delay", DELAYS)
def test_the_step_of_the_plant_is_that_of_the_device(delay: float) -> None:
    # constant torque from t_d on: x = (m/b²) (b t/m - 1 + exp(-b t/m))
    t = np.arange(200) * PERIOD
    rate = DAMPING / INERTIA * np.maximum(t - delay, 0.0)
    motion = INERTIA / DAMPING**2 * (rate + np.expm1(-rate))
    device = plant(INERTIA, DAMPING, PERIOD, delay)
    _, (by_states,) = signal.dstep((*device, PERIOD), n=200)
    _, (by_transfer,) = signal.dstep(
        signal.dlti(*pulse_transfer(INERTIA, DAMPING, PERIOD, delay), dt=PERIOD), n=200
    )
    np.testing.assert_allclose(by_states[:, 0], motion, atol=1e-12)
    np.testing.assert_allclose(by_transfer[:, 0], motion, atol=1e-9)


@pytest.mark.parametrize("delay", DELAYS)
@pytest.mark.parametrize("samples", [1, 3])
def test_poles_by_states_by_transfer_and_by_matrix_exponential(delay: float, samples: int) -> None:
    stiffness, virtual = 3.0, 0.05
    a, *_ = closed_loop(INERTIA, DAMPING, stiffness, virtual, PERIOD, delay, samples)
    g = pulse_transfer(INERTIA, DAMPING, PERIOD, delay)
    h = wall_transfer(stiffness, virtual, PERIOD, samples)
    polynomial = np.polyadd(np.polymul(g.den, h.den), np.polymul(g.num, h.num))
    np.testing.assert_allclose(np.poly(a), polynomial, atol=1e-10)
    loop = Loop(INERTIA, DAMPING, stiffness, virtual, PERIOD, delay, samples)
    oracle = np.poly(state_matrix(loop))
    np.testing.assert_allclose(np.append(polynomial, np.zeros(9))[: len(oracle)], oracle, atol=1e-9)


@pytest.mark.parametrize("delay", DELAYS)
def test_at_the_critical_stiffness_it_oscillates_at_the_frequency_given(delay: float) -> None:
    point = critical_point(INERTIA, DAMPING, 0.1, PERIOD, delay)
    system = closed_loop(INERTIA, DAMPING, float(point.stiffness), 0.1, PERIOD, delay)
    poles = np.linalg.eigvals(system.a)
    outermost = poles[np.argmax(np.abs(poles))]
    assert abs(outermost) == pytest.approx(1.0, abs=1e-9)
    assert abs(np.angle(outermost)) / (2 * np.pi * PERIOD) == pytest.approx(
        point.frequency, rel=1e-7
    )


def test_errors_name_the_argument() -> None:
    with pytest.raises(ValueError, match="period must be > 0, got 0"):
        pulse_transfer(1.0, 0.1, 0.0, 0.0)
    with pytest.raises(ValueError, match="delay must be >= 0, got -1"):
        plant(1.0, 0.1, 1e-3, -1.0)
    with pytest.raises(ValueError, match="velocity_samples must be a whole number >= 1, got 0"):
        wall_transfer(1.0, 0.1, 1e-3, 0)
