"""A servo with friction at rest, loads and cogging: against an integrator, and its limits."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

from haptic_wall.hw.truth import TrueServo
from tests.cases import sampled
from tests.hw.oracles import Stretch, Uneven, integrate_uneven
from tests.support.exact_servo import Effects, PlantParameters, Pull, State, Substeps

PERIOD = 1e-3
MX64 = PlantParameters(inertia=0.011951, damping=0.011692, coulomb=0.09039)
FREE = PlantParameters(inertia=0.01)
ALONE = ("static", "stribeck", "back", "load", "gravity", "cogging")
GROUPS = {
    **{name: (name,) for name in ALONE},
    "all": ALONE,
}
EXACT = ("static", "back")
"""Solved exactly"""
STATED = {**dict.fromkeys(GROUPS, 5e-5), "all": 1e-4}
"""Bounds of the error that the page on the plant states [rad]"""


def drawn(
    random: np.random.Generator, on: Sequence[str], *, hand: bool
) -> tuple[PlantParameters, TrueServo, Uneven, float]:
    """Draw a servo from half an XL330's inertia to twice an MX-64's; torques scale with it."""
    inertia = float(np.exp(random.uniform(*np.log((5e-4, 3e-2)))))
    scale = inertia / 0.012
    damping = 0.012 * scale * random.uniform(0.2, 5.0)
    coulomb = 0.09 * scale * random.uniform(0.2, 2.0)
    static, stribeck, back = coulomb, 0.0, damping
    gravity = angle = cogging = phase = 0.0
    periods = 24.0
    if "static" in on or "stribeck" in on:
        static *= random.uniform(1.0, 3.0)
    if "stribeck" in on:
        stribeck = float(np.exp(random.uniform(*np.log((0.01, 3.0)))))
    if "back" in on:
        back *= float(np.exp(random.uniform(-1.6, 1.6)))
    load = random.uniform(0.0, 0.5) if "load" in on else 0.0
    if "gravity" in on:
        gravity, angle = scale * random.uniform(0.0, 1.0), random.uniform(-3.0, 3.0)
    if "cogging" in on:
        cogging, phase = coulomb * random.uniform(0.0, 1.0), random.uniform(-3.0, 3.0)
        periods = float(random.integers(1, 100))
    effects = Effects(
        static_friction=static,
        stribeck_speed=stribeck,
        damping_back=back,
        load_friction=load,
        gravity=gravity,
        gravity_angle=angle,
        cogging=cogging,
        cogging_periods=periods,
        cogging_phase=phase,
    )
    grip = (4.0 * scale, 0.2 * scale) if hand else (0.0, 0.0)
    body = Uneven(
        *(inertia, damping, back, coulomb, static, stribeck, load),
        *(gravity, angle, cogging, periods, phase, *grip),
    )
    return PlantParameters(inertia, damping, coulomb), effects, body, scale


def errors(
    random: np.random.Generator, on: Sequence[str], *, hand: bool, periods: int
) -> tuple[float, int]:
    """Return the error of position [rad], and how often it rests."""
    parameters, effects, body, scale = drawn(random, on, hand=hand)
    amplitude = scale * float(np.exp(random.uniform(*np.log((0.05, 2.0)))))
    rate, reference = random.uniform(5.0, 60.0), 0.0
    stretches = []
    for k in range(periods):
        slope = 3.0 * math.sin(k / 70) if hand else 0.0
        torque = amplitude * (math.sin(k * PERIOD * rate) + 0.3 * random.normal())
        stretches.append(Stretch(PERIOD, torque, reference, slope))
        reference += slope * PERIOD
    expected = integrate_uneven(body, 0.1, 0.4, stretches)
    move = Substeps(parameters, effects).step
    state, largest, resting = State(0.1, 0.4), 0.0, 0
    for stretch, (position, _) in zip(stretches, expected, strict=True):
        pull = None
        if hand:
            pull = Pull(body.hand_stiffness, body.hand_damping, stretch.reference, stretch.slope)
        state = move(state, parameters, stretch.torque, PERIOD, pull)
        largest = max(largest, abs(state.position - position))
        resting += state.velocity == 0.0
    return largest, resting


@pytest.mark.parametrize("hand", sampled([True, False], 2), ids=["hand", "alone"])
@pytest.mark.parametrize("group", GROUPS)
def test_random_motion_agrees_with_an_integrator(group: str, hand: bool, thorough: bool) -> None:
    random = np.random.default_rng(5)
    count, periods = (100, 300) if thorough else (2, 60)
    found = [errors(random, GROUPS[group], hand=hand, periods=periods) for _ in range(count)]
    assert max(error for error, _ in found) < (1e-11 if group in EXACT else STATED[group])
    assert not thorough or sum(resting for _, resting in found) > 100


def test_a_small_swing_in_a_cog_has_the_frequency_of_its_stiffness() -> None:
    # A sin(N x) has the stiffness A N at 0.
    cogging, periods = 0.03, 24.0
    move = Substeps(FREE, Effects(cogging=cogging, cogging_periods=periods)).step
    half = math.pi / math.sqrt(cogging * periods / FREE.inertia)
    for turns in (1.0, 10.0):
        state = move(State(1e-5, 0.0), FREE, 0.0, turns * half)
        assert state.position == pytest.approx(math.cos(math.pi * turns) * 1e-5, rel=1e-4)


def test_energy_stays_the_same_over_a_minute_without_friction_and_input() -> None:
    effects = Effects(gravity=0.6, cogging=0.05, cogging_periods=24.0, cogging_phase=1.0)
    move = Substeps(FREE, effects).step

    def energy(state: State) -> float:
        height = -0.6 * math.cos(state.position)
        cogs = -0.05 / 24.0 * math.cos(24.0 * state.position + 1.0)
        return 0.5 * FREE.inertia * state.velocity**2 + height + cogs

    state = State(1.5, 0.0)
    begun, seen = energy(state), []
    for _ in range(120):
        state = move(state, FREE, 0.0, 0.05)
        seen.append(energy(state) - begun)
    assert max(map(abs, seen)) < 1e-5
    assert abs(np.mean(seen[60:]) - np.mean(seen[:60])) < 1e-6  # it does not drift


def test_energy_never_grows_without_input() -> None:
    random = np.random.default_rng(4)
    for _ in range(20):
        parameters, effects, _, scale = drawn(random, ALONE, hand=False)
        move = Substeps(parameters, effects).step
        state = State(random.uniform(-3.0, 3.0), random.uniform(-10.0, 10.0))

        def energy(
            state: State, inertia: float = parameters.inertia, effects: TrueServo = effects
        ) -> float:
            phase = effects.cogging_periods * state.position + effects.cogging_phase
            return (
                0.5 * inertia * state.velocity**2
                - effects.gravity * math.cos(state.position - effects.gravity_angle)
                - effects.cogging / effects.cogging_periods * math.cos(phase)
            )

        for _ in range(200):
            after = move(state, parameters, 0.0, 2e-3)
            assert energy(after) <= energy(state) + 1e-7 * scale
            state = after


STUCK = Effects(
    static_friction=0.15,
    stribeck_speed=0.2,
    load_friction=0.2,
    gravity=0.1,
    gravity_angle=0.7,
    cogging=0.02,
)


def test_a_stuck_shaft_stays_stuck_for_ever_and_breaks_away_at_the_static_friction() -> None:
    move = Substeps(MX64, STUCK).step
    state = State(0.3, 0.0)
    outside = -0.1 * math.sin(0.3 - 0.7)
    rest = outside - 0.02 * math.sin(24.0 * 0.3)
    # torque + rest = static + load |torque - outside|, with the torque above what is outside
    edge = (0.15 - rest - 0.2 * outside) / (1.0 - 0.2)
    assert edge > outside
    assert move(state, MX64, edge * (1.0 - 1e-12), 1000.0) == state
    assert move(state, MX64, edge * (1.0 + 1e-12), 1.0).position > 0.3
    plain = Substeps(MX64, Effects(static_friction=0.15)).step
    assert plain(state, MX64, -0.15, 1000.0) == state
    assert plain(state, MX64, math.nextafter(-0.15, -1.0), 1.0).position < 0.3
