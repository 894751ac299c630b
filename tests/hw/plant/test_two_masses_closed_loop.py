"""A virtual wall on two simulated masses: it decays and grows where theory says."""

from __future__ import annotations

import math

import numpy as np
import pytest

from haptic_wall.controller.theory.boundary import chain_boundary, chain_ceiling
from haptic_wall.controller.theory.chain import Chain
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.hw.truth import EncoderSide, TrueServo
from tests.hw.plant.test_plant_closed_loop import PERIOD
from tests.support.exact_servo import Masses, PlantParameters, State


def chain_of(true: TrueServo) -> Chain:
    """The same servo for the theory."""
    return Chain(
        np.array([[true.inertia, true.load_inertia]]),
        np.array([[true.damping, 0.0]]),
        np.array([[true.transmission_stiffness]]),
        np.array([[true.transmission_damping]]),
        encoder=0 if true.encoder == "motor" else 1,
    )


def drawn(random: np.random.Generator, encoder: EncoderSide) -> TrueServo:
    """Draw a load of 0.001 to 100 times the motor's inertia, on a joint of 10 to 1e5 N·m/rad."""
    inertia = float(10 ** random.uniform(-3.0, -1.5))
    load = inertia * float(10 ** random.uniform(-3.0, 2.0))
    stiffness = float(10 ** random.uniform(1.0, 5.0))
    ratio = float(10 ** random.uniform(-4.0, -0.7))
    return TrueServo(
        inertia=inertia,
        damping=inertia * float(10 ** random.uniform(-2.0, 1.0)),
        counts_per_rev=0,
        load_inertia=load,
        transmission_stiffness=stiffness,
        transmission_damping=2.0 * ratio * math.sqrt(stiffness * load),
        encoder=encoder,
    )


def simulated_radius(true: TrueServo, stiffness: float, big_b: float, late: float) -> float:
    """Largest modulus of the poles of one simulated period, by its answers to unit states.

    A state is positions and speeds of the masses, the sample before, and the torques on their way.
    """
    plant, friction = Masses(true), PlantParameters(true.inertia, true.damping, 0.0)
    whole = math.floor(late)
    measured = 0 if true.encoder == "motor" else 1
    parts = [round((late - whole) * 1e6), 0]
    parts[1] = 1_000_000 - parts[0]

    def period(state: FloatArray) -> FloatArray:
        masses = tuple(State(*pair) for pair in state[:4].reshape(-1, 2).tolist())
        sample = masses[measured].position
        torque = -stiffness * sample - big_b * (sample - state[4]) / PERIOD
        waiting = [float(torque), *state[5:].tolist()]
        for length, acting in zip(parts, (waiting[whole + 1], waiting[whole]), strict=True):
            masses = plant.step(masses, friction, acting, length)
        return np.array([*np.ravel(masses), sample, *waiting[:-1]])

    size = 6 + whole
    return float(np.abs(np.linalg.eigvals(np.array([*map(period, np.eye(size))]).T)).max())


@pytest.mark.parametrize("encoder", ["output", "motor"])
def test_the_simulated_wall_turns_unstable_at_the_boundary(
    encoder: EncoderSide, thorough: bool
) -> None:
    """From 1e-4 below the critical stiffness to 1e-4 above it."""
    random = np.random.default_rng(2)
    found = 0
    while found < (200 if thorough else 5):
        true, late = drawn(random, encoder), random.integers(0, 4) + random.integers(10) / 10
        chain = chain_of(true)
        big_b = random.uniform(0.0, 0.9) * float(chain_ceiling(chain, (), PERIOD, late * PERIOD))
        limit = float(chain_boundary(chain, (), big_b, PERIOD, late * PERIOD).stiffness)
        if limit == 0.0:
            continue  # an undamped vibration that even the softest wall feeds
        found += 1
        for share in (0.97, 1.0 - 1e-4):
            assert simulated_radius(true, share * limit, big_b, late) < 1.0
        for share in (1.0 + 1e-4, 1.03):
            assert simulated_radius(true, share * limit, big_b, late) > 1.0
