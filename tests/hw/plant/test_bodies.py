"""Many bodies at once move to the last bit as each would alone."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from haptic_wall.hw.plant.bodies import Bodies
from haptic_wall.hw.plant.body import PlantParameters, State, step


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
@pytest.mark.parametrize("fastest", [1.5, 4.0], ids=["light", "heavy"])
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
            turned = bodies.step_turning(torque, held)
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
