"""A servo with a load behind a transmission: against an integrator, and its limits."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from haptic_wall.hw.plant.mechanism import Mechanism
from haptic_wall.hw.truth import TrueServo
from tests.cases import sampled
from tests.hw.oracles import Coupled, Stretch, integrate_coupled
from tests.support.exact_servo import Masses, PlantParameters, Pull, State, step

MS = 1_000_000
LINEAR = TrueServo(
    inertia=0.012,
    damping=0.012,
    counts_per_rev=0,
    load_inertia=0.003,
    transmission_stiffness=200.0,
    transmission_damping=0.03,
)
GROUPS = {
    "linear": (),
    "friction": ("coulomb",),
    "gap": ("coulomb", "gap"),
    "effects": ("coulomb", "effects"),
    "all": ("coulomb", "gap", "effects"),
}
STATED = {"linear": 1e-11, "friction": 1e-7, "gap": 1e-6, "effects": 5e-5, "all": 3e-4}
"""Bounds of the error that the page on the plant states [rad]"""


def drawn(random: np.random.Generator, on: tuple[str, ...]) -> TrueServo:
    """Draw a servo from half an XL330's inertia to twice an MX-64's; torques scale with it."""

    def between(low: float, high: float) -> float:
        return float(np.exp(random.uniform(math.log(low), math.log(high))))

    inertia = between(5e-4, 3e-2)
    scale = inertia / 0.012
    load = inertia * between(0.05, 3.0)
    moving = inertia * load / (inertia + load)
    rate = math.tau * between(8.0, 120.0)
    true = TrueServo(
        inertia=inertia,
        damping=0.012 * scale * random.uniform(0.2, 5.0),
        counts_per_rev=0,
        load_inertia=load,
        transmission_stiffness=moving * rate**2,
        transmission_damping=2.0 * random.uniform(0.002, 0.2) * moving * rate,
    )
    if "coulomb" in on:
        true = replace(true, coulomb=0.09 * scale * random.uniform(0.2, 2.0))
    if "gap" in on:
        true = replace(true, backlash=random.uniform(0.0005, 0.01))
    if "effects" in on:
        true = replace(
            true,
            static_friction=true.coulomb * random.uniform(1.0, 3.0),
            stribeck_speed=between(0.01, 3.0),
            damping_back=true.damping * between(0.2, 5.0),
            load_friction=random.uniform(0.0, 0.5),
            gravity=scale * random.uniform(0.0, 1.0),
            gravity_angle=random.uniform(-3.0, 3.0),
            cogging=true.coulomb * random.uniform(0.0, 1.0),
            cogging_periods=float(random.integers(1, 100)),
        )
    return true


def friction(true: TrueServo) -> PlantParameters:
    return PlantParameters(true.inertia, true.damping, true.coulomb)


def error(random: np.random.Generator, on: tuple[str, ...], *, hand: bool, periods: int) -> float:
    """Return the largest error of a position at the ends of periods [rad].

    Args:
        random: Draws servo and torques.
        on: What the servo has.
        hand: A hand moves the output.
        periods: Periods of 1 ms.
    """
    true = drawn(random, on)
    scale = true.inertia / 0.012
    grip = (4.0 * scale, 0.2 * scale) if hand else (0.0, 0.0)
    body = Coupled(
        true.inertia,
        true.damping,
        true.damping if true.damping_back is None else true.damping_back,
        true.coulomb,
        true.static_friction or true.coulomb,
        true.stribeck_speed,
        true.load_friction,
        true.gravity,
        true.gravity_angle,
        true.cogging,
        true.cogging_periods,
        true.cogging_phase,
        true.load_inertia,
        true.transmission_stiffness,
        true.transmission_damping,
        true.backlash,
        *grip,
    )
    amplitude = scale * float(np.exp(random.uniform(*np.log((0.05, 2.0)))))
    rate, reference = random.uniform(5.0, 60.0), 0.0
    stretches = []
    for k in range(periods):
        slope = 3.0 * math.sin(k / 70) if hand else 0.0
        torque = amplitude * (math.sin(k * 1e-3 * rate) + 0.3 * random.normal())
        stretches.append(Stretch(1e-3, torque, reference, slope))
        reference += slope * 1e-3
    expected = integrate_coupled(body, [0.1, 0.4] * 2, stretches, 1e-11)
    masses, largest = Masses(true), 0.0
    states: tuple[State, ...] = (State(0.1, 0.4),) * 2
    for stretch, right in zip(stretches, expected, strict=True):
        pull = Pull(*grip, stretch.reference, stretch.slope) if hand else None
        states = masses.step(states, friction(true), stretch.torque, MS, pull)
        errors = (abs(a.position - b) for a, b in zip(states, right[::2], strict=True))
        largest = max(largest, *errors)
    return largest


@pytest.mark.parametrize("hand", sampled([True, False], 2), ids=["hand", "alone"])
@pytest.mark.parametrize("group", GROUPS)
def test_random_motion_agrees_with_an_integrator(group: str, hand: bool, thorough: bool) -> None:
    count, periods = (20, 200) if thorough else (2, 40)
    random = np.random.default_rng(6)
    found = [error(random, GROUPS[group], hand=hand, periods=periods) for _ in range(count)]
    assert max(found) < STATED[group]


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
        motor, output = Masses(LINEAR).step(start, friction(LINEAR), 0.2, length_ns)
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
    masses: tuple[State, ...] = (rigid, rigid)
    plant, one = Masses(true), PlantParameters(0.01 + load, 0.01, 0.05)
    for k in range(40):
        torque = 0.4 * math.sin(0.1 * k)
        masses = plant.step(masses, friction(true), torque, MS)
        rigid = step(rigid, one, torque, 1e-3)
        assert masses[0].position == pytest.approx(rigid.position, abs=1e-7)


def test_without_friction_a_vibration_keeps_its_energy() -> None:
    true = replace(LINEAR, damping=0.0, transmission_damping=0.0)
    two, motor, output = Masses(true), State(0.0, 1.0), State(0.0, -1.0)

    def energy(motor: State, output: State) -> float:
        twist = motor.position - output.position
        moving = 0.012 * motor.velocity**2 + 0.003 * output.velocity**2
        return 0.5 * (moving + 200.0 * twist**2)

    begin = energy(motor, output)
    for _ in range(5_000):
        motor, output = two.step((motor, output), friction(true), 0.0, MS)
    assert energy(motor, output) == pytest.approx(begin, rel=1e-9)


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


def test_a_weight_hangs_on_the_output_and_friction_holds_the_motor() -> None:
    """With a stuck motor the output rests where the transmission carries the weight."""
    true = replace(LINEAR, transmission_damping=0.2, coulomb=0.5, gravity=0.2, gravity_angle=-1.57)
    mechanism = Mechanism(true, 0)
    mechanism.advance(500 * MS)
    twist = mechanism.measured()[0]
    assert mechanism.motor_velocity == 0.0
    assert 200.0 * twist == pytest.approx(-0.2 * math.sin(twist + 1.57), rel=1e-4)


def test_backlash_is_between_the_masses() -> None:
    """The output does not move before the motor has gone through half of it."""
    mechanism = Mechanism(replace(LINEAR, damping=0.0, backlash=0.02), 0)
    mechanism.command(0.12, 0)  # 10 rad/s²: half of the backlash takes sqrt(2 * 0.01 / 10) s
    mechanism.advance(44 * MS)
    assert mechanism.measured()[0] == 0.0
    assert mechanism.motor_velocity == pytest.approx(0.44, rel=1e-9)
    mechanism.advance(46 * MS)
    assert mechanism.measured()[0] > 0.0
