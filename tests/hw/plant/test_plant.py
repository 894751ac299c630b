"""The plant against an independent integrator, and the promises of its physics."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.exact_servo import PlantParameters, Pull, State, step

# Agreement over a second of motion [rad]: 1e-9 is promised; the integrator is good to 1e-12.


def test_it_coasts_to_rest_where_the_energy_is_used_up() -> None:
    # Without damping and torque: v²/2 m = c x, and it stays there.
    parameters = PlantParameters(0.012, 0.0, 0.09)
    end = step(State(0.0, 2.0), parameters, 0.0, 10.0)
    assert end.velocity == 0.0
    assert end.position == pytest.approx(0.012 * 2.0**2 / (2 * 0.09), rel=1e-14)


def test_it_breaks_away_exactly_when_the_hand_pulls_harder_than_friction() -> None:
    # The hand's spring passes the friction of 0.1 N·m after 0.1 / (4 · 0.5) = 50 ms.
    parameters = PlantParameters(0.012, 0.01, 0.1)
    pull = Pull(4.0, 0.0, 0.0, 0.5)
    assert step(State(0.0, 0.0), parameters, 0.0, 0.04999999, pull) == State(0.0, 0.0)
    moved = step(State(0.0, 0.0), parameters, 0.0, 0.051, pull)
    # Just after it the push grows by k_h r1, so x = k_h r1 t³ / 6 m.
    assert moved.position == pytest.approx(4.0 * 0.5 * 0.001**3 / (6 * 0.012), rel=0.01)


# A busy machine must not fail a promise of the physics.

positions = st.floats(-3.0, 3.0)
velocities = st.floats(-20.0, 20.0) | st.just(0.0)
torques = st.floats(-4.0, 4.0) | st.just(0.0)
durations = st.floats(1e-6, 0.5)
parameter_sets = st.builds(
    PlantParameters,
    inertia=st.floats(1e-3, 1.0),
    damping=st.floats(0.0, 1.0) | st.just(0.0),
    coulomb=st.floats(1e-3, 0.3) | st.just(0.0),
)
pulls = st.none() | st.builds(
    Pull,
    stiffness=st.floats(0.01, 50.0),
    damping=st.floats(0.0, 2.0),
    reference=st.floats(-2.0, 2.0),
    slope=st.floats(-10.0, 10.0) | st.just(0.0),
)


@given(positions, velocities, parameter_sets, durations, st.floats(0.01, 50.0), st.floats(0.0, 2.0))
def test_energy_never_grows_on_a_hand_at_rest(
    position: float,
    velocity: float,
    parameters: PlantParameters,
    duration: float,
    stiffness: float,
    damping: float,
) -> None:
    def energy(state: State) -> float:
        return 0.5 * parameters.inertia * state.velocity**2 + 0.5 * stiffness * state.position**2

    start = State(position, velocity)
    end = step(start, parameters, 0.0, duration, Pull(stiffness, damping, 0.0, 0.0))
    # Rounding grows with the number of radians swung, below 100 here.
    assert energy(end) <= energy(start) * (1.0 + 1e-13) + 1e-300
