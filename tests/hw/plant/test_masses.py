"""A servo with a load behind a transmission: its limits, and where its parts act."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from haptic_wall.hw.plant.mechanism import Mechanism
from haptic_wall.hw.truth import TrueServo
from tests.support.exact_servo import State, step, step_masses

MS = 1_000_000
LINEAR = TrueServo(
    inertia=0.012,
    damping=0.012,
    counts_per_rev=0,
    load_inertia=0.003,
    transmission_stiffness=200.0,
    transmission_damping=0.03,
)


def test_a_linear_step_of_any_length_is_the_matrix_exponential() -> None:
    m, load, k, c, b = 0.012, 0.003, 200.0, 0.03, 0.012
    rates = np.array(
        [
            [0.0, 1.0, 0.0, 0.0, 0.0],
            [-k / m, -(b + c) / m, k / m, c / m, 1.0 / m],
            [0.0, 0.0, 0.0, 1.0, 0.0],
            [k / load, c / load, -k / load, -c / load, 0.0],
            [0.0, 0.0, 0.0, 0.0, 0.0],
        ]
    )
    start = (State(0.1, -0.3), State(0.12, 0.5))
    for length_ns in (1, 123_456_789, MS, 3 * MS // 7):
        motor, output = step_masses(start, LINEAR, 0.2, length_ns * 1e-9)
        expected = expm(rates * length_ns * 1e-9) @ [*start[0], *start[1], 0.2]
        assert [*motor, *output] == pytest.approx(expected[:4].tolist(), rel=1e-11, abs=1e-12)


@pytest.mark.parametrize(("load", "stiffness", "damping"), [(1e-7, 1e5, 0.0), (1e-6, 1e3, 1.0)])
def test_events_are_found_beside_a_motion_that_is_over_within_a_substep(
    load: float, stiffness: float, damping: float
) -> None:
    """A feather on a stiff joint vibrates with 1e6 rad/s, or creeps within 1 µs."""
    true = TrueServo(
        inertia=0.01,
        damping=0.01,
        coulomb=0.05,
        load_inertia=load,
        transmission_stiffness=stiffness,
        transmission_damping=damping,
    )
    rigid = State(0.0, 0.0)
    masses = rigid, rigid
    one = TrueServo(0.01 + load, 0.01, 0.05)
    for k in range(20):
        torque = 0.4 * math.sin(0.2 * k)
        masses = step_masses(masses, true, torque, 1e-3)
        rigid = step(rigid, one, torque, 1e-3)
        assert masses[0].position == pytest.approx(rigid.position, abs=1e-7)


@pytest.mark.parametrize("side", ["output", "motor"])
def test_the_encoder_sees_its_side(side: Any) -> None:
    mechanism = Mechanism(replace(LINEAR, encoder=side), 0)
    mechanism.command(1.0, 0)
    mechanism.advance(4 * MS)
    rigid = TrueServo(inertia=0.015, damping=0.012, counts_per_rev=0)
    stiff = Mechanism(rigid, 0)
    stiff.command(1.0, 0)
    stiff.advance(4 * MS)
    output, seen = mechanism.position, mechanism.measured()[0]
    assert output < stiff.position  # the load lags at first
    assert seen == output if side == "output" else seen > stiff.position
