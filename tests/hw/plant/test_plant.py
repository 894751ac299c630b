"""The step of a servo, rigid or of two masses, against an integrator; promises of its physics."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_wall.hw.plant.step import NOBODY, Hand
from haptic_wall.hw.truth import TrueServo
from tests.cases import sampled
from tests.hw.oracles import Body, Stretch, integrate
from tests.support.exact_servo import State, step, step_masses

PERIOD = 1e-3
MX64 = TrueServo(inertia=0.011951, damping=0.011692, coulomb=0.09039)
FREE = TrueServo(inertia=0.01)
EFFECTS = ("static", "stribeck", "back", "load", "gravity", "cogging")
GROUPS = {
    **{name: (("coulomb", name), 5e-5) for name in EFFECTS},
    "static": (("coulomb", "static"), 1e-11),  # solved exactly
    "back": (("coulomb", "back"), 1e-11),
    "all": (("coulomb", *EFFECTS), 1e-4),
    "masses": (("masses",), 1e-11),
    "masses, friction": (("masses", "coulomb"), 1e-7),
    "masses, gap": (("masses", "coulomb", "gap"), 1e-6),
    "masses, effects": (("masses", "coulomb", *EFFECTS), 5e-5),
    "masses, all": (("masses", "coulomb", "gap", *EFFECTS), 3e-4),
}
"""Parts of each kind of servo, and the largest error that the page on the plant states [rad]"""


def drawn(random: np.random.Generator, on: Collection[str]) -> TrueServo:
    """Draw a servo from half an XL330's inertia to twice an MX-64's; torques scale with it."""

    def between(low: float, high: float) -> float:
        return float(np.exp(random.uniform(math.log(low), math.log(high))))

    inertia = between(5e-4, 3e-2)
    scale = inertia / 0.012
    true = TrueServo(inertia, 0.012 * scale * random.uniform(0.2, 5.0), counts_per_rev=0)
    if "masses" in on:
        load = inertia * between(0.05, 3.0)
        moving = inertia * load / (inertia + load)
        rate = math.tau * between(8.0, 120.0)
        true = replace(
            true,
            load_inertia=load,
            transmission_stiffness=moving * rate**2,
            transmission_damping=2.0 * random.uniform(0.002, 0.2) * moving * rate,
        )
    if "coulomb" in on:
        true = replace(true, coulomb=0.09 * scale * random.uniform(0.2, 2.0))
    if "gap" in on:
        true = replace(true, backlash=random.uniform(0.0005, 0.01))
    if "static" in on or "stribeck" in on:
        true = replace(true, static_friction=true.coulomb * random.uniform(1.0, 3.0))
    if "stribeck" in on:
        true = replace(true, stribeck_speed=between(0.01, 3.0))
    if "back" in on:
        true = replace(true, damping_back=true.damping * between(0.2, 5.0))
    if "load" in on:
        true = replace(true, load_friction=random.uniform(0.0, 0.5))
    if "gravity" in on:
        gravity, angle = scale * random.uniform(0.0, 1.0), random.uniform(-3.0, 3.0)
        true = replace(true, gravity=gravity, gravity_angle=angle)
    if "cogging" in on:
        true = replace(
            true,
            cogging=true.coulomb * random.uniform(0.0, 1.0),
            cogging_periods=float(random.integers(1, 100)),
            cogging_phase=random.uniform(-3.0, 3.0),
        )
    return true


def error(
    random: np.random.Generator, true: TrueServo, periods: int, *, hand: bool
) -> tuple[float, int]:
    """Play a random torque.

    Returns:
        The largest error of a position at the ends of periods [rad], and how often it rests.
    """
    scale = true.inertia / 0.012
    grip = (4.0 * scale, 0.2 * scale) if hand else (0.0, 0.0)
    amplitude = scale * float(np.exp(random.uniform(*np.log((0.05, 2.0)))))
    rate, reference = random.uniform(5.0, 60.0), 0.0
    stretches = []
    for k in range(periods):
        slope = 3.0 * math.sin(k / 70) if hand else 0.0
        torque = amplitude * (math.sin(k * PERIOD * rate) + 0.3 * random.normal())
        stretches.append(Stretch(PERIOD, torque, reference, slope))
        reference += slope * PERIOD
    masses = State(0.1, 0.4), State(0.1, 0.4)
    begin = [*masses[0], *masses[1]] if true.flexible else masses[0]
    expected = integrate(Body(true, *grip), begin, stretches)
    largest, resting = 0.0, 0
    for stretch, right in zip(stretches, expected, strict=True):
        pull = Hand(*grip, stretch.reference, stretch.slope) if hand else NOBODY
        if true.flexible:
            masses = step_masses(masses, true, stretch.torque, PERIOD, pull)
        else:
            masses = step(masses[0], true, stretch.torque, PERIOD, pull), masses[1]
        errors = (abs(one.position - x) for one, x in zip(masses, right[::2], strict=False))
        largest = max(largest, *errors)
        resting += masses[0].velocity == 0.0
    return largest, resting


@pytest.mark.parametrize("hand", sampled([True, False], 2), ids=["hand", "alone"])
@pytest.mark.parametrize("group", GROUPS)
def test_random_motion_agrees_with_an_integrator(group: str, hand: bool, thorough: bool) -> None:
    on, stated = GROUPS[group]
    count, periods = (2, 40 if "masses" in on else 60)
    if thorough:
        count, periods = (20, 200) if "masses" in on else (100, 300)
    random = np.random.default_rng(5)
    found = [error(random, drawn(random, on), periods, hand=hand) for _ in range(count)]
    assert max(largest for largest, _ in found) < stated
    assert not thorough or "coulomb" not in on or sum(resting for _, resting in found) > 100


def test_it_breaks_away_exactly_when_the_hand_pulls_harder_than_friction() -> None:
    # The hand's spring passes the friction of 0.1 N·m after 0.1 / (4 · 0.5) = 50 ms.
    true = TrueServo(0.012, 0.01, 0.1)
    pull = Hand(4.0, 0.0, 0.0, 0.5)
    assert step(State(0.0, 0.0), true, 0.0, 0.04999999, pull) == State(0.0, 0.0)
    moved = step(State(0.0, 0.0), true, 0.0, 0.051, pull)
    # Just after it the push grows by k_h r1, so x = k_h r1 t³ / 6 m.
    assert moved.position == pytest.approx(4.0 * 0.5 * 0.001**3 / (6 * 0.012), rel=0.01)


@given(
    position=st.floats(-3.0, 3.0),
    velocity=st.floats(-20.0, 20.0) | st.just(0.0),
    true=st.builds(
        TrueServo,
        inertia=st.floats(1e-3, 1.0),
        damping=st.floats(0.0, 1.0) | st.just(0.0),
        coulomb=st.floats(1e-3, 0.3) | st.just(0.0),
    ),
    duration=st.floats(1e-6, 0.5),
    stiffness=st.floats(0.01, 50.0),
    damping=st.floats(0.0, 2.0),
)
def test_energy_never_grows_on_a_hand_at_rest(
    position: float,
    velocity: float,
    true: TrueServo,
    duration: float,
    stiffness: float,
    damping: float,
) -> None:
    def energy(state: State) -> float:
        return 0.5 * true.inertia * state.velocity**2 + 0.5 * stiffness * state.position**2

    start = State(position, velocity)
    end = step(start, true, 0.0, duration, Hand(stiffness, damping))
    # Rounding grows with the number of radians swung, below 100 here.
    assert energy(end) <= energy(start) * (1.0 + 1e-13) + 1e-300


def test_a_small_swing_in_a_cog_has_the_frequency_of_its_stiffness() -> None:
    # A sin(N x) has the stiffness A N at 0.
    true = replace(FREE, cogging=0.03, cogging_periods=24.0)
    half = math.pi / math.sqrt(true.cogging * true.cogging_periods / true.inertia)
    for turns in (1.0, 10.0):
        state = step(State(1e-5, 0.0), true, 0.0, turns * half)
        assert state.position == pytest.approx(math.cos(math.pi * turns) * 1e-5, rel=1e-4)


def energy_of(true: TrueServo, state: State) -> float:
    """Kinetic energy, and that of the weight and the cogging [J]."""
    phase = true.cogging_periods * state.position + true.cogging_phase
    return (
        0.5 * true.inertia * state.velocity**2
        - true.gravity * math.cos(state.position - true.gravity_angle)
        - true.cogging / true.cogging_periods * math.cos(phase)
    )


def test_energy_stays_the_same_over_a_minute_without_friction_and_input() -> None:
    true = replace(FREE, gravity=0.6, cogging=0.05, cogging_phase=1.0)
    state = State(1.5, 0.0)
    begun, seen = energy_of(true, state), []
    for _ in range(120):
        state = step(state, true, 0.0, 0.05)
        seen.append(energy_of(true, state) - begun)
    assert max(map(abs, seen)) < 1e-5
    assert abs(np.mean(seen[60:]) - np.mean(seen[:60])) < 1e-6  # it does not drift


def test_energy_never_grows_without_input() -> None:
    random = np.random.default_rng(4)
    for _ in range(20):
        true = drawn(random, ("coulomb", *EFFECTS))
        state = State(random.uniform(-3.0, 3.0), random.uniform(-10.0, 10.0))
        for _ in range(200):
            after = step(state, true, 0.0, 2e-3)
            assert energy_of(true, after) <= energy_of(true, state) + 1e-7 * true.inertia / 0.012
            state = after


def test_a_stuck_shaft_stays_stuck_for_ever_and_breaks_away_at_the_static_friction() -> None:
    true = replace(
        MX64,
        static_friction=0.15,
        stribeck_speed=0.2,
        load_friction=0.2,
        gravity=0.1,
        gravity_angle=0.7,
        cogging=0.02,
    )
    state = State(0.3, 0.0)
    outside = -0.1 * math.sin(0.3 - 0.7)
    rest = outside - 0.02 * math.sin(24.0 * 0.3)
    # torque + rest = static + load |torque - outside|, with the torque above what is outside
    edge = (0.15 - rest - 0.2 * outside) / (1.0 - 0.2)
    assert edge > outside
    assert step(state, true, edge * (1.0 - 1e-12), 1000.0) == state
    assert step(state, true, edge * (1.0 + 1e-12), 1.0).position > 0.3
    plain = replace(MX64, static_friction=0.15)
    assert step(state, plain, -0.15, 1000.0) == state
    assert step(state, plain, math.nextafter(-0.15, -1.0), 1.0).position < 0.3
