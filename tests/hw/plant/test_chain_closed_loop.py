"""A virtual wall on a simulated chain of masses: it decays and grows where theory says."""

from __future__ import annotations

import math

import numpy as np
import pytest

from haptic_wall.controller.theory.boundary import chain_boundary, chain_ceiling
from haptic_wall.controller.theory.chain import Chain
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.hw.truth import EncoderSide, Link, TrueServo
from tests.cases import sampled
from tests.hw.plant.test_plant_closed_loop import PERIOD, growth_per_second, wall_motion
from tests.support.exact_servo import Masses, PlantParameters, State


def chain_of(true: TrueServo) -> Chain:
    """The same servo for the theory."""
    links = np.array(true.links)
    friction = np.zeros((1, len(links) + 1))
    friction[0, 0] = true.damping
    return Chain(
        np.array([[true.inertia, *links[:, 0]]]),
        friction,
        links[None, :, 1],
        links[None, :, 2],
        encoder=0 if true.encoder == "motor" else 1,
    )


def drawn(random: np.random.Generator, masses: int, encoder: EncoderSide) -> TrueServo:
    """Draw masses of 0.001 to 100 times the motor's, on joints of 10 to 1e5 N·m/rad."""
    inertia = float(10 ** random.uniform(-3.0, -1.5))
    links = []
    for _ in range(masses - 1):
        mass = inertia * float(10 ** random.uniform(-3.0, 2.0))
        stiffness = float(10 ** random.uniform(1.0, 5.0))
        ratio = float(10 ** random.uniform(-4.0, -0.7))
        links.append(Link(mass, stiffness, 2.0 * ratio * math.sqrt(stiffness * mass)))
    return TrueServo(
        inertia=inertia,
        damping=inertia * float(10 ** random.uniform(-2.0, 1.0)),
        counts_per_rev=0,
        load_inertia=links[0].inertia,
        transmission_stiffness=links[0].stiffness,
        transmission_damping=links[0].damping,
        chain=tuple(links[1:]),
        encoder=encoder,
    )


def simulated_radius(true: TrueServo, stiffness: float, big_b: float, late: float) -> float:
    """Largest modulus of the poles of one simulated period, by its answers to unit states.

    A state is positions and speeds of the masses, the sample before, and the torques on their way.
    """
    plant, friction = Masses(true), PlantParameters(true.inertia, true.damping, 0.0)
    count, whole = len(true.links) + 1, math.floor(late)
    measured = 0 if true.encoder == "motor" else 1
    parts = [round((late - whole) * 1e6), 0]
    parts[1] = 1_000_000 - parts[0]

    def period(state: FloatArray) -> FloatArray:
        masses = tuple(State(*pair) for pair in state[: 2 * count].reshape(-1, 2).tolist())
        sample = masses[measured].position
        torque = -stiffness * sample - big_b * (sample - state[2 * count]) / PERIOD
        waiting = [float(torque), *state[2 * count + 1 :].tolist()]
        for length, acting in zip(parts, (waiting[whole + 1], waiting[whole]), strict=True):
            masses = plant.step(masses, friction, acting, length)
        return np.array([*np.ravel(masses), sample, *waiting[:-1]])

    size = 2 * count + 2 + whole
    return float(np.abs(np.linalg.eigvals(np.array([*map(period, np.eye(size))]).T)).max())


@pytest.mark.parametrize("encoder", ["output", "motor"])
@pytest.mark.parametrize("masses", sampled([3, 2, 5, 4], 2))
def test_the_simulated_wall_turns_unstable_at_the_boundary(
    masses: int, encoder: EncoderSide, thorough: bool
) -> None:
    """From 1e-4 below the critical stiffness to 1e-4 above it."""
    random = np.random.default_rng(masses)
    found = 0
    while found < (200 if thorough else 5):
        true, late = (
            drawn(random, masses, encoder),
            random.integers(0, 4) + random.integers(10) / 10,
        )
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


@pytest.mark.parametrize("late", sampled([1.4, 0.0], 2))
def test_a_wall_on_a_horn_a_link_and_a_tool_grows_as_its_pole(late: float) -> None:
    true = TrueServo(
        inertia=0.011951,
        damping=0.011692,
        delay=late * PERIOD,
        counts_per_rev=0,
        torque_limit=1e300,
        position=0.01,
        load_inertia=1e-4,
        transmission_stiffness=200.0,
        transmission_damping=0.01,
        chain=(Link(0.002, 300.0, 0.03), Link(5e-4, 80.0, 0.01)),
    )
    chain = chain_of(true)
    big_b = 0.5 * float(chain_ceiling(chain, (), PERIOD, true.delay))
    limit = float(chain_boundary(chain, (), big_b, PERIOD, true.delay).stiffness)
    for share in (0.97, 1.03):
        growth = math.log(simulated_radius(true, share * limit, big_b, late)) / PERIOD
        assert (growth > 0.0) == (share > 1.0)
        motion = wall_motion(true, share * limit, big_b, 6000)
        assert growth_per_second(motion[-2000:]) == pytest.approx(growth, rel=0.02)
