"""One step of a servo in few words, for tests."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from haptic_wall.hw.plant.mechanics import mechanics_of
from haptic_wall.hw.plant.step import NOBODY, Hand, kept_for, move
from haptic_wall.hw.plant.two_masses import ROOM, swing
from haptic_wall.hw.truth import TrueServo

Pull = Hand


class PlantParameters(NamedTuple):
    """A rigid servo with friction."""

    inertia: float
    damping: float = 0.0
    coulomb: float = 0.0


class State(NamedTuple):
    """Position [rad] and velocity [rad/s]."""

    position: float
    velocity: float


def Effects(**given: Any) -> TrueServo:  # noqa: N802 - as a class
    """What a servo has beside inertia, viscous and Coulomb friction."""
    return TrueServo(1.0, **given)


def step(
    state: State,
    parameters: PlantParameters,
    torque: float,
    duration: float,
    pull: Hand | None = None,
) -> State:
    """The state after ``duration`` [s] under a held torque."""
    return Substeps(parameters).step(state, parameters, torque, duration, pull)


class Substeps:
    """Moves a rigid servo with effects."""

    def __init__(self, parameters: PlantParameters, effects: TrueServo | None = None) -> None:
        self.p = mechanics_of(replace(effects or Effects(), **parameters._asdict()))

    def step(
        self,
        state: State,
        parameters: PlantParameters,
        torque: float,
        duration: float,
        pull: Hand | None = None,
    ) -> State:
        """The state; more damping than at first is the motor's braking."""
        hand, braking = pull or NOBODY, parameters.damping - self.p.forth
        kept = kept_for(self.p, hand, braking, duration)
        x, v, _ = move(self.p, kept, hand, *state, state.position, torque, braking, duration)
        return State(x, v)


class Masses:
    """Moves a servo with a load behind a transmission."""

    def __init__(self, true: TrueServo) -> None:
        self.p = mechanics_of(true)

    def step(
        self,
        masses: Sequence[State],
        parameters: PlantParameters,
        torque: float,
        length_ns: int,
        pull: Hand | None = None,
    ) -> tuple[State, ...]:
        """The states of motor and output."""
        motor, output = masses
        z = [motor.velocity, motor.position - output.position, output.velocity]
        z += [0.0] * (ROOM - len(z))
        braking = parameters.damping - self.p.forth
        at = swing(*(self.p, pull or NOBODY, z, output.position, torque, braking, length_ns * 1e-9))
        return State(at + z[1], z[0]), State(at, z[2])
