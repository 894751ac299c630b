"""The plant against an independent integrator, and the promises of its physics."""

import math
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.cases import sampled
from tests.hw.oracles import Body, Stretch, integrate
from tests.support.exact_servo import PlantParameters, Pull, State, step

PERIOD = 1e-3
MX64 = PlantParameters(inertia=0.011951, damping=0.011692, coulomb=0.09039)
# Agreement over a second of motion [rad]: 1e-9 is promised; the integrator is good to 1e-12.
AGREED = 1e-11


def body_of(parameters: PlantParameters, pull: Pull | None = None) -> Body:
    hand = (pull.stiffness, pull.damping) if pull else (0.0, 0.0)
    return Body(parameters.inertia, parameters.damping, parameters.coulomb, *hand)


def test_a_second_with_a_moving_hand_and_friction_agrees_with_an_integrator() -> None:
    rng = random.Random(2)
    stretches, reference = [], 0.0
    for k in range(1000):
        slope = 3.0 * math.sin(k / 70)
        stretches.append(Stretch(PERIOD, rng.gauss(0.0, 0.1), reference, slope))
        reference += slope * PERIOD
    pull = Pull(4.0, 0.2, 0.0, 0.0)
    expected = integrate(body_of(MX64, pull), 0.0, 0.0, stretches)
    state = State(0.0, 0.0)
    stuck = 0
    for stretch, (position, velocity) in zip(stretches, expected, strict=True):
        hand = pull._replace(reference=stretch.reference, slope=stretch.slope)
        state = step(state, MX64, stretch.torque, PERIOD, hand)
        assert state.position == pytest.approx(position, abs=AGREED)
        assert state.velocity == pytest.approx(velocity, abs=1e-10)
        stuck += state.velocity == 0.0
    assert stuck > 3


@pytest.mark.parametrize(
    ("damping", "hand_stiffness", "hand_damping", "slope"),
    sampled(
        [
            (0.0, 40.0, 0.0, 0.3),  # undamped: stick and slip for ever
            (0.01, 40.0, 0.05, 0.3),  # underdamped
            (0.0, 40.0, 2.0 * math.sqrt(40.0 * 0.01), 0.3),  # critically damped
            (0.5, 4.0, 0.7, -2.0),  # overdamped
            (0.01, 40.0, 0.0, 0.0),  # a spring at rest: swings until it sticks
            (0.3, 0.0, 0.0, 0.0),  # no hand
            (0.0, 0.0, 0.0, 0.0),  # no hand, no damping
        ],
        3,
    ),
)
def test_many_events_in_one_long_step_agree_with_an_integrator(
    damping: float, hand_stiffness: float, hand_damping: float, slope: float
) -> None:
    parameters = PlantParameters(0.01, damping, 0.2)
    pull = Pull(hand_stiffness, hand_damping, 0.4, slope)
    for start in (State(0.0, 0.0), State(-0.3, 5.0), State(0.5, -3.0)):
        stretch = Stretch(2.0, 0.05, 0.4, slope)
        [(position, velocity)] = integrate(body_of(parameters, pull), *start, [stretch])
        end = step(start, parameters, 0.05, 2.0, pull)
        assert end.position == pytest.approx(position, abs=AGREED)
        assert end.velocity == pytest.approx(velocity, abs=1e-8)


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
