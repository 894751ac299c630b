"""One step of a servo in few words, for tests."""

from __future__ import annotations

from typing import NamedTuple

from haptic_wall.hw.plant.mechanics import mechanics_of
from haptic_wall.hw.plant.step import NOBODY, Hand, kept_for, move
from haptic_wall.hw.plant.two_masses import ROOM, swing
from haptic_wall.hw.truth import TrueServo


class State(NamedTuple):
    """Position [rad] and velocity [rad/s]."""

    position: float
    velocity: float


def step(
    state: State, true: TrueServo, torque: float, duration: float, hand: Hand = NOBODY
) -> State:
    """The state of a rigid servo after ``duration`` [s] under a held torque."""
    p = mechanics_of(true)
    kept = kept_for(p, hand, 0.0, duration)
    x, v, _ = move(p, kept, hand, *state, state.position, torque, 0.0, duration)
    return State(x, v)


def step_masses(
    masses: tuple[State, State],
    true: TrueServo,
    torque: float,
    duration: float,
    hand: Hand = NOBODY,
) -> tuple[State, State]:
    """The states of a motor and its load after ``duration`` [s] under a held torque."""
    motor, output = masses
    z = [motor.velocity, motor.position - output.position, output.velocity]
    z += [0.0] * (ROOM - len(z))
    at = swing(mechanics_of(true), hand, z, output.position, torque, 0.0, duration)
    return State(at + z[1], z[0]), State(at, z[2])
