"""The trial's servo against the product's own, exact solutions, and a general solver."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from haptic_wall.hw.clock import SimulatedClock
from haptic_wall.hw.simulated import SimulatedServo
from haptic_wall.hw.truth import TrueServo
from tests.support.exact_servo import PlantParameters, Pull, State, step
from tests.support.operators import NOBODY, Operator, operator_of
from tests.support.trial_servo import TrialServo
from tests.support.truth import COUNT, Truth

SERVO = Truth(0.012, 0.012, 0.09, counts_per_rev=0, torque_limit=100.0)
Torque = Callable[[float], float]


def run(
    truth: Truth, torque: Torque, ticks: int, operator: Operator = NOBODY, **start: float
) -> NDArray[np.float64]:
    """Output after each millisecond, under a torque of time held for it."""
    clock = SimulatedClock()
    servo = TrialServo(truth, clock, operator, **start)
    for i in range(ticks):
        servo.request()
        servo.write(torque(i * 1e-3))
        clock.wait_until((i + 1) * 1_000_000)
    servo.request()
    return np.array(servo.outputs)


def wave(time: float) -> float:
    return 1.2 * math.sin(20.0 * time) + 0.5 * math.sin(171.0 * time)


@pytest.mark.parametrize("held", [False, True])
def test_a_rigid_servo_moves_as_the_exact_solution_within_a_hundredth_of_a_count(
    held: bool,
) -> None:
    wanted = 0.3 * np.sin(np.arange(1001) * 1e-3 * 15.0)
    speed = np.diff(wanted) / 1e-3
    parameters = PlantParameters(SERVO.inertia, SERVO.damping, SERVO.coulomb)
    state, exact = State(0.0, 0.0), [0.0]
    for i in range(1000):
        pull = Pull(15.0, 0.4, float(wanted[i]), float(speed[i])) if held else None
        state = step(state, parameters, wave(i * 1e-3), 1e-3, pull)
        exact.append(state.position)
    found = run(SERVO, wave, 1000, operator_of(15.0, 0.4, wanted) if held else NOBODY)
    assert np.ptp(exact) > 100 * COUNT
    assert np.max(np.abs(found - exact)) < 0.01 * COUNT


def test_a_lag_is_kept_to_the_nanosecond() -> None:
    """Beside the simulated servo of the product, closed loop, with a fraction of a period."""
    lag = 3.3e-3
    clock = SimulatedClock()
    other = SimulatedServo(TrueServo(0.012, 0.012, 0.09, delay=lag, position=0.05), clock)
    servo = TrialServo(Truth(0.012, 0.012, 0.09, delay=lag), clock, position=0.05)
    other.start()
    apart = []
    for i in range(400):
        clock.wait_until(i * 1_000_000)
        positions = []
        for one in (servo, other):
            one.request()
            position = one.collect(0).position
            positions.append(position)
            one.write(-5.0 * position)
        apart.append(abs(positions[0] - positions[1]))
    assert max(apart) <= COUNT * 1.001  # the two round at another count now and then
    assert np.mean(np.array(apart) > 0.1 * COUNT) < 0.02


def test_with_every_effect_it_is_the_same_servo_where_they_are_nothing() -> None:
    truth = Truth(0.011, 0.012, 0.06, torque_gain=1.2, delay=2.3e-3, counts_per_rev=0)
    real = replace(truth, real={"current_bandwidth": 5000.0})
    hand = operator_of(6.0, 0.1, 0.3 * np.sin(np.arange(400) * 0.03), push=0.2)
    ends = [
        run(one, lambda time: 0.5 * math.sin(50.0 * time), 600, hand, position=0.1)
        for one in (truth, real)
    ]
    assert np.ptp(ends[0]) > 0.3
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-3)


def solved(truth: Truth, torque: Torque, ticks: int) -> np.ndarray:
    """Two masses by a general solver; the friction's jump is a steep slope."""
    motor, load = truth.inertia - truth.load_inertia, truth.load_inertia
    k, c = truth.transmission_stiffness, truth.transmission_damping
    gap = 0.5 * truth.transmission_backlash

    def slope(_: float, s: np.ndarray, drive: float) -> list[float]:
        x, v, y, w = s
        d = x - y
        e = math.copysign(max(abs(d) - gap, 0.0), d)
        passed = k * e + (c * (v - w) if not gap or e else 0.0)
        if gap and passed * e < 0.0:
            passed = 0.0
        rub = truth.coulomb * math.tanh(v / 1e-4) + truth.damping * v
        return [v, (drive - passed - rub) / motor, w, passed / load]

    state, found = np.zeros(4), [0.0]
    for i in range(ticks):
        done = solve_ivp(
            slope, (0.0, 1e-3), state, "LSODA", args=(torque(i * 1e-3),), rtol=1e-8, atol=1e-10
        )
        state = done.y[:, -1]
        found.append(state[2])
    return np.array(found)


@pytest.mark.whole
@pytest.mark.parametrize("gap", [0.0, math.radians(0.5)])
def test_two_masses_with_friction_and_backlash_move_as_a_solver_says(gap: float) -> None:
    truth = replace(SERVO.with_mode(30.0, 0.02, 0.5), transmission_backlash=gap)
    wanted = solved(truth, wave, 400)
    assert np.ptp(wanted) > 100 * COUNT
    assert np.max(np.abs(run(truth, wave, 400) - wanted)) < 0.5 * COUNT
    assert np.max(np.abs(run(truth, wave, 400, step_s=2.5e-5) - wanted)) < 0.05 * COUNT
