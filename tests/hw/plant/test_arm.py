"""Servos whose shafts are the joints of an arm move as the equations of the arm say."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from haptic_wall.hw.clock import SimulatedClock
from haptic_wall.hw.errors import SpecError
from haptic_wall.hw.plant.arm import Arm, bias_of, couple, inertia_of
from haptic_wall.hw.plant.mechanism import Mechanism
from haptic_wall.hw.plant.operator_model import operator_of
from haptic_wall.hw.simulated import SimulatedBus
from haptic_wall.hw.truth import TrueArm, TrueServo

LINKS = TrueArm("planar", 0.15, 0.2, 0.1, 0.15)
NONE = replace(LINKS, mass_1=0.0, mass_2=0.0)
FREE = TrueServo(inertia=0.002, damping=0.0, coulomb=0.0, counts_per_rev=0)
MS = 1_000_000


def state(mechanisms: Sequence[Mechanism]) -> list[float]:
    return [each.position for each in mechanisms] + [each.velocity for each in mechanisms]


def mass(positions: Sequence[float]) -> NDArray[np.float64]:
    return np.array(inertia_of(LINKS, positions[1])) + FREE.inertia * np.eye(2)


def test_torque_at_one_joint_moves_both_as_the_equations_say() -> None:
    true = TrueServo(inertia=0.002, damping=0.01, coulomb=0.0, counts_per_rev=0, position=0.4)
    arm = [Mechanism(true, 0) for _ in range(2)]
    Arm(LINKS, arm)

    def motion(_: float, y: Sequence[float]) -> list[float]:
        x, v = list(y[:2]), list(y[2:])
        first, second = bias_of(LINKS, x[1], v)
        torque = [-true.damping * v[0] - first, 0.3 - true.damping * v[1] - second]
        return [*v, *np.linalg.solve(mass(x), torque)]

    arm[1].command(0.3, 0)
    arm[0].advance(500 * MS)
    exact = solve_ivp(motion, (0.0, 0.5), [0.4, 0.4, 0.0, 0.0], rtol=1e-10, atol=1e-12).y[:, -1]
    assert abs(exact[2]) > 1.0
    assert state(arm) == pytest.approx(exact, abs=1e-5)


def test_links_without_inertia_change_nothing() -> None:
    """Friction, weight, the loop of current, a hand and backlash act as on each servo alone."""
    uneven = TrueServo(
        inertia=0.012,
        damping=0.012,
        coulomb=0.09,
        static_friction=0.12,
        stribeck_speed=1.0,
        load_friction=0.1,
        gravity=0.2,
        cogging=0.01,
        backlash=0.002,
    )
    quick = TrueServo(
        inertia=0.002,
        damping=0.0,
        coulomb=0.03,
        current_bandwidth=200.0,
        back_emf=True,
        delay=0.0007,
    )
    held = TrueServo(inertia=0.01, damping=0.0, coulomb=0.05, hand="tap", hand_origin=0.3)
    trues = [uneven, quick, quick, held]
    alone, joined = (
        [Mechanism(true, 0, operator=operator_of(true)) for true in trues] for _ in range(2)
    )
    Arm(NONE, joined[:2])
    Arm(NONE, joined[2:])
    for step in range(500):
        for group in alone, joined:
            for number, each in enumerate(group):
                each.command(0.4 * math.sin(0.02 * step + number), step * MS)
        for one, other in zip(alone, joined, strict=True):
            one.advance((step + 1) * MS)
            other.advance((step + 1) * MS)
            assert other.measured()[0] == pytest.approx(one.measured()[0], abs=2e-3)
            # A joint of an arm that friction stops waits for the end of the step.
            assert other.position == pytest.approx(one.position, abs=5e-4)


def test_joint_that_friction_holds_stays_exactly_at_rest() -> None:
    stiff = TrueServo(inertia=0.002, damping=0.0, coulomb=0.2, counts_per_rev=0)
    arm = [Mechanism(stiff, 0), Mechanism(FREE, 0)]
    Arm(LINKS, arm)
    arm[1].command(0.1, 0)
    arm[0].advance(100 * MS)
    assert arm[0].position == 0.0
    assert arm[0].velocity == 0.0
    assert arm[1].velocity > 1.0
    arm[1].command(3.0, 100 * MS)
    arm[0].advance(200 * MS)
    assert abs(arm[0].velocity) > 0.0


def test_impossible_arm_is_refused() -> None:
    with pytest.raises(SpecError, match=r"arm\.shape.*found 1 servo, wanted two"):
        couple(TrueArm("planar"), [Mechanism(FREE, 0)])
    flexible = replace(FREE, load_inertia=0.01, transmission_stiffness=100.0)
    with pytest.raises(SpecError, match=r"servo\.load_inertia.*flexible"):
        couple(TrueArm("planar"), [Mechanism(FREE, 0), Mechanism(flexible, 0)])
    with pytest.raises(SpecError, match=r"arm\.length_1: found 0"):
        TrueArm("planar", length_1=0.0)


def test_simulated_servos_can_be_an_arm() -> None:
    clock = SimulatedClock()
    bus = SimulatedBus([FREE, FREE], clock, TrueArm("planar"))
    bus.start()
    bus.write([0.0, 0.2])
    clock.wait_until(50 * MS)
    bus.request()
    first, second = bus.collect(0)
    assert first.position < -0.01 < 0.01 < second.position
