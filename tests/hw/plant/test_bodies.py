"""Many bodies at once move to the last bit as each would alone."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest
from numpy.typing import NDArray

from haptic_wall.hw.plant.bodies import Bodies
from haptic_wall.hw.plant.body import PlantParameters, State, step
from haptic_wall.hw.plant.effects import Effects
from haptic_wall.hw.plant.many_substeps import ManyEffects
from haptic_wall.hw.plant.substeps import Substeps
from tests.cases import sampled


def random_bodies(
    seed: int, n: int, fastest: float
) -> tuple[np.random.Generator, NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Bodies with and without friction of either kind; ``fastest`` decay as a power of ten."""
    rng = np.random.default_rng(seed)
    inertia = 10 ** rng.uniform(-3, 0, n)
    damping = inertia * 10 ** rng.uniform(-2, fastest, n) * (rng.random(n) > 0.2)
    coulomb = rng.uniform(0, 0.2, n) * (rng.random(n) > 0.3)
    return rng, inertia, damping, coulomb


@pytest.mark.parametrize("turning", [False, True], ids=["step", "step_turning"])
@pytest.mark.parametrize("fastest", sampled([4.0, 1.5], 2), ids=["heavy", "light"])
def test_every_body_moves_as_the_scalar_plant_to_the_last_bit(
    turning: bool, fastest: float, thorough: bool
) -> None:
    n, steps = 200, 2000 if thorough else 200
    rng, inertia, damping, coulomb = random_bodies(1, n, fastest)
    position, velocity = rng.normal(size=(2, n))
    bodies = Bodies(inertia, damping, coulomb, position, velocity)
    duration = rng.choice([1e-3, 2.5e-4, 7.5e-4], n)
    held = bodies.held(duration)
    parameters = [
        PlantParameters(*row) for row in np.stack([inertia, damping, coulomb], 1).tolist()
    ]
    states = [State(x, v) for x, v in zip(position.tolist(), velocity.tolist(), strict=True)]
    stopped = stuck = 0
    for _ in range(steps):
        torque = 0.3 * rng.normal(size=n)
        seen: list[list[float]] = [[] for _ in range(n)]
        states = [
            step(state, body, u, t, turns=turns if turning else None)
            for state, body, u, t, turns in zip(
                states, parameters, torque.tolist(), duration.tolist(), seen, strict=True
            )
        ]
        if turning:
            (turned,) = bodies.step_turning(torque, held)
            found = dict(zip(turned.bodies.tolist(), turned.position.tolist(), strict=True))
            assert found == {i: turns[0] for i, turns in enumerate(seen) if turns}
            stopped += len(found)
        else:
            bodies.step(torque, held)
        np.testing.assert_array_equal(bodies.position, [state.position for state in states])
        np.testing.assert_array_equal(bodies.velocity, [state.velocity for state in states])
        stuck += int(np.count_nonzero(bodies.velocity == 0.0))
    assert stuck > 100  # so that the rest, too, was compared
    assert stopped > 100 or not turning


def test_positions_can_go_to_another_array_and_the_old_ones_stay() -> None:
    _, inertia, damping, coulomb = random_bodies(2, 50, 1.0)
    bodies = Bodies(inertia, damping, coulomb, np.zeros(50), np.ones(50))
    held = bodies.held(np.full(50, 1e-3))
    before, after = bodies.position, np.empty(50)
    bodies.step(np.zeros(50), held, after)
    assert bodies.position is after
    assert np.all(before == 0.0)
    assert np.all(after > 0.0)


def test_bodies_that_cannot_be_are_refused() -> None:
    one = np.ones(2)
    with pytest.raises(ValueError, match="inertia"):
        Bodies(np.array([1.0, 0.0]), one, one, one, one)
    with pytest.raises(ValueError, match="coulomb"):
        Bodies(one, one, np.array([0.1, -1.0]), one, one)


@pytest.mark.parametrize("turning", sampled([True, False], 2), ids=["step_turning", "step"])
def test_bodies_with_effects_move_as_each_would_alone(turning: bool, thorough: bool) -> None:
    n, steps = 60, 1000 if thorough else 60
    rng, inertia, damping, coulomb = random_bodies(3, n, 1.5)
    inertia = np.maximum(inertia, 0.005)
    loaded, rippled = rng.integers(0, 2, (2, n)).astype(np.float64)
    many = ManyEffects(
        static_friction=coulomb * rng.uniform(1.0, 2.0, n),
        stribeck_speed=rng.choice([0.0, 0.1, 1.0], n),
        damping_back=damping * rng.uniform(0.3, 3.0, n),
        load_friction=loaded * 0.2,
        gravity=rng.choice([0.0, 0.2], n),
        gravity_angle=rng.uniform(-3.0, 3.0, n),
        cogging=rng.choice([0.0, 0.05], n),
        cogging_periods=rng.integers(1, 60, n).astype(np.float64),
        cogging_phase=rng.uniform(-3.0, 3.0, n),
        stribeck_exponent=rng.choice([0.76, 1.0, 3.0], n),
        load_friction_external=loaded * rng.uniform(0.0, 0.3, n),
        load_friction_at_rest=loaded * rng.choice([0.0, 0.2], n),
        load_friction_at_rest_external=loaded * rng.choice([0.0, 0.1], n),
        load_friction_square=loaded * 0.01,
        load_friction_square_external=loaded * 0.02,
        torque_ripple=rippled * 0.1,
        torque_ripple_periods=rng.integers(1, 60, n).astype(np.float64),
        torque_ripple_phase=rng.uniform(-3.0, 3.0, n),
    )
    position, velocity = rng.normal(size=(2, n))
    bodies = Bodies(inertia, damping, coulomb, position, velocity, many)
    duration = rng.choice([1e-3, 2.5e-4, 7.5e-4], n)
    held = bodies.held(duration)
    alone = []
    for row in range(n):
        parameters = PlantParameters(inertia[row], damping[row], coulomb[row])
        effects = Effects(**{f.name: getattr(many, f.name)[row] for f in fields(Effects)})
        alone.append((parameters, Substeps(parameters, effects)))
    states = [State(x, v) for x, v in zip(position.tolist(), velocity.tolist(), strict=True)]
    stopped = stuck = 0
    for _ in range(steps):
        torque, outside = 0.3 * rng.normal(size=(2, n))
        outside = 0.0 * outside if turning else outside * (loaded + rippled == 0.0)
        seen: list[list[float]] = [[] for _ in range(n)]
        states = [
            body.step(state, parameters, u, t, turns=turns)
            for (parameters, body), state, u, t, turns in zip(
                alone, states, (torque + outside).tolist(), duration.tolist(), seen, strict=True
            )
        ]
        if turning:
            found: list[list[float]] = [[] for _ in range(n)]
            for index, turn in bodies.step_turning(torque, held):
                for body, place in zip(index.tolist(), turn.tolist(), strict=True):
                    found[body].append(place)
            assert [len(turns) for turns in found] == [len(turns) for turns in seen]
            for mine, theirs in zip(found, seen, strict=True):
                assert mine == pytest.approx(theirs, abs=1e-11)
            stopped += sum(map(len, seen))
        else:
            bodies.step(torque, held, None, outside)
        np.testing.assert_allclose(
            bodies.position, [state.position for state in states], rtol=0.0, atol=1e-11
        )
        np.testing.assert_allclose(
            bodies.velocity, [state.velocity for state in states], rtol=0.0, atol=1e-9
        )
        stuck += int(np.count_nonzero(bodies.velocity == 0.0))
    assert stuck > 20  # so that the rest, too, was compared
    assert stopped > 20 or not turning


def test_the_load_of_many_is_the_difference_of_motor_and_operator() -> None:
    """0.2 of |u - e| beside a Coulomb friction of 0.1: 0.3 more the two against each other."""
    one = np.ones(3)
    effects = ManyEffects.alike(Effects(load_friction=0.2), 0.0, 0.1, 3)
    bodies = Bodies(0.01 * one, 0.0 * one, 0.1 * one, 0.0 * one, 0.0 * one, effects)
    motor, operator = np.array([0.5, 0.5, 0.5]), np.array([-0.3, -0.2, 0.0])
    bodies.step(motor, bodies.held(1e-3 * one), None, operator)
    friction = 0.1 + 0.2 * np.abs(motor - operator)
    net = np.maximum(motor + operator - friction, 0.0)
    np.testing.assert_allclose(bodies.velocity, net / 0.01 * 1e-3, rtol=1e-12)
    assert bodies.velocity[0] == 0.0
    assert bodies.velocity[1] > 0.0


def test_static_friction_of_many_below_the_kinetic_one_is_refused() -> None:
    effects = ManyEffects.alike(Effects(), 0.0, 0.1, 2)
    one = np.ones(2)
    with pytest.raises(ValueError, match="static_friction lies below coulomb"):
        Bodies(one, one, 0.2 * one, one, one, effects)
