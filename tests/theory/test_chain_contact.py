"""Contacts of a chain with a wall that never pulls: the rigid theory as oracle, energy, a bound."""

from __future__ import annotations

import numpy as np
import pytest

from haptic_wall.controller.theory import max_virtual_damping, one_sided_limit
from haptic_wall.controller.theory.boundary import chain_boundary, chain_ceiling
from haptic_wall.controller.theory.chain import Chain, two_masses
from haptic_wall.controller.theory.one_sided import one_sided_with_load
from tests.support.chain_contact import one_sided_limits, returned
from tests.support.contacts import restitution

PERIOD = 1e-3
PHASES = np.linspace(1e-9, 1.0, 33)


def one_mass(damping: float, bandwidth: float | None = None) -> Chain:
    ones = np.ones((PHASES.size, 1))
    none = np.empty((PHASES.size, 0))
    lag = None if bandwidth is None else np.full(PHASES.size, bandwidth)
    return Chain(ones, damping * ones, none, none, lag)


@pytest.mark.parametrize("late", [0.0, 1.0, 2.6])
@pytest.mark.parametrize("samples", [1, 3])
def test_one_mass_returns_what_the_rigid_theory_says(late: float, samples: int) -> None:
    damping, delay = 5.0, late * PERIOD
    virtual = 0.4 * float(max_virtual_damping(1.0, damping, PERIOD, delay, samples))
    stiffness = 0.8 * float(one_sided_limit(1.0, damping, virtual, PERIOD, delay, samples))
    every = np.ones(PHASES.size)
    found = returned(
        one_mass(damping), PERIOD, delay, stiffness * every, virtual * every, PHASES, samples
    )
    rigid = restitution(1.0, damping, stiffness, virtual, PERIOD, delay, velocity_samples=samples)
    # the rigid theory looks between the samples for the greatest speed
    assert np.max(found) == pytest.approx(float(rigid), rel=6e-3)


def test_a_lag_returns_less_than_a_delay_of_the_same_time() -> None:
    lag, damping, delay = 1.5e-3, 3.0, 1e-3
    virtual = 0.5 * float(max_virtual_damping(1.0, damping, PERIOD, delay + lag))
    stiffness = float(one_sided_limit(1.0, damping, virtual, PERIOD, delay + lag))
    every = np.ones(PHASES.size)
    found = returned(
        one_mass(damping, 1 / (2 * np.pi * lag)),
        PERIOD,
        delay,
        stiffness * every,
        virtual * every,
        PHASES,
    )
    assert 0.5 < np.max(found) < 1.0


def test_nothing_is_lost_in_a_contact_without_damping() -> None:
    """What stays in the transmission as a vibration is counted as returned."""
    every = np.ones(9)
    chain, _ = two_masses(0.012 * every, 1e-9, 0.006, 20.0, 1e-9, encoder="motor")
    phase = np.linspace(1e-9, 1.0, 9)
    found = returned(chain, 5e-5, 0.0, 30.0 * every, 0.0 * every, phase)
    np.testing.assert_allclose(found, 1.0, atol=0.02)


def test_a_wall_on_the_output_feeds_the_mode_of_the_transmission() -> None:
    every = np.ones(9)
    chain, _ = two_masses(0.012 * every, 1e-9, 0.006, 20.0, 1e-9, encoder="output")
    phase = np.linspace(1e-9, 1.0, 9)
    found = returned(chain, 5e-5, 0.0, 30.0 * every, 0.0 * every, phase)
    assert np.min(found) > 1.2


def test_a_contact_without_end_is_not_a_number() -> None:
    every = np.ones(3)
    chain, _ = two_masses(0.012 * every, 0.01, 0.006, 200.0, 0.01)
    found = returned(chain, PERIOD, 0.0, 0.001 * every, every, 0.5 * every, longest=50)
    assert np.all(np.isnan(found))


@pytest.mark.parametrize("encoder", ["output", "motor"])
def test_with_a_load_the_limit_is_below_that_of_simulated_contacts(
    encoder: str, thorough: bool
) -> None:
    random = np.random.default_rng(6)
    for _ in range(200 if thorough else 4):
        motor, load = 0.012, 0.012 * 10 ** random.uniform(-1.3, 0.5)
        rate = 2.0 * np.pi * 10 ** random.uniform(1.0, 2.1)
        moving = motor * load / (motor + load)
        masses = motor, 0.0117, load, moving * rate**2, 0.06 * moving * rate
        servo, shape = two_masses(*masses, encoder=encoder)
        loop = PERIOD, random.uniform(0.0, 3e-3)
        virtual = float(chain_ceiling(servo, shape, *loop)) * np.array([0.0, 0.3, 0.7])
        exact = chain_boundary(servo, shape, virtual, *loop).stiffness
        found = one_sided_with_load(servo, exact, virtual, *loop)
        assert np.all(found <= one_sided_limits(servo, *loop, exact, virtual))
