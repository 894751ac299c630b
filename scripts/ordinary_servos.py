"""Servos that are no ideal ones: friction that is larger at rest, cogging, a weight on the shaft.

    m x'' = u - b x' - c sign(x') - A sin(N x + phase) - G sin(x - hanging)

At rest the body breaks away where the torque on it exceeds the static friction. The loads are held
over steps of ``GRAIN_S``, at the position in the middle of each: their error is of second order.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from unittest.mock import patch

import numpy as np

from haptic_wall.hw.plant.body import PlantParameters, Pull, State
from haptic_wall.hw.plant.response import Slide, response, time_to_rest

GRAIN_S = 2.5e-4
SPREAD = 0.2
"""Share by which a servo's friction may lie below its model's"""


@dataclass(frozen=True, slots=True)
class Effects:
    """Effects that an ordinary servo has and an ideal one has not."""

    stiction: float = 1.0
    """Static over kinetic friction"""
    stribeck: float = 0.0
    """Speed at which that excess has fallen to a third [rad/s]; 0: there is none in motion"""
    cogging: float = 0.0
    """Amplitude [N·m]"""
    periods: int = 24
    """Of the cogging in a turn"""
    phase: float = 0.0
    """[rad]"""
    gravity: float = 0.0
    """Largest torque of the weight [N·m]"""
    hanging: float = 0.0
    """Position where the weight hangs [rad]"""
    backward: float = 1.0
    """Viscous damping at negative over that at positive speeds"""
    load_friction: float = 0.0
    """Fraction of the motor's torque that the gear adds to the friction"""

    def load(self, position: float) -> float:
        """Torque against the shaft [N·m]."""
        return self.cogging * math.sin(
            self.periods * position + self.phase
        ) + self.gravity * math.sin(position - self.hanging)

    def step(
        self,
        state: State,
        parameters: PlantParameters,
        torque: float,
        duration: float,
        pull: Pull | None = None,
        *,
        turns: list[float] | None = None,
    ) -> State:
        """As ``haptic_wall.hw.plant.body.step``; no hand."""
        assert pull is None
        if self.load_friction:
            grown = parameters.coulomb + self.load_friction * abs(torque)
            parameters = replace(parameters, coulomb=grown)
        count = max(1, math.ceil(duration / GRAIN_S - 1e-9))
        length = duration / count
        for _ in range(count):
            ahead = state.position + 0.5 * length * state.velocity
            state = self._slid(state, parameters, torque - self.load(ahead), length, turns)
        return state

    def _slid(
        self,
        state: State,
        parameters: PlantParameters,
        torque: float,
        left: float,
        turns: list[float] | None,
    ) -> State:
        position, velocity = state
        inertia, coulomb = parameters.inertia, parameters.coulomb
        static = self.stiction * coulomb
        if self.stribeck > 0.0:
            fading = math.exp(-abs(state.velocity) / self.stribeck)
            coulomb += (static - coulomb) * fading
        while True:
            if velocity == 0.0 and abs(torque) <= static:
                return State(position, 0.0)
            direction = math.copysign(1.0, velocity or torque)
            decay = parameters.damping * (self.backward if direction < 0.0 else 1.0) / inertia
            slide = Slide(velocity, (torque - direction * coulomb) / inertia, 0.0, decay, 0.0)
            rest = time_to_rest(slide, left)
            if rest is None:
                distance, velocity = slide.moved(response(decay, 0.0, left))
                return State(position + distance, velocity if velocity * direction > 0.0 else 0.0)
            position += slide.moved(response(decay, 0.0, rest))[0]
            velocity = 0.0
            left -= rest
            if turns is not None:
                turns.append(position)


@contextmanager
def ordinary(effects: Effects) -> Iterator[None]:
    """Every servo simulated in this process meanwhile has these effects."""
    with patch("haptic_wall.hw.plant.mechanism.step", effects.step):
        yield


COGGING, GRAVITY = 0.33, 1.11
"""Of an XM430's Coulomb friction: 0.03 and 0.1 N·m"""
STICTION = (1.25, 2.0)
PERIODS = (4, 96)
FADING = (0.03, 1.0)
"""Of half of those that stick the friction falls from that at rest over such a speed [rad/s]"""
GROUPS = ("stiction", "cogging", "gravity", "together")


def drawn_effects(group: str, coulomb: float, seed: int) -> Effects:
    """Effects of a seed's servo, which stays where it is without torque.

    Args:
        group: One of ``GROUPS``.
        coulomb: Of its model, which the loads are scaled to [N·m].
        seed: Decides on all of it.
    """
    random = np.random.default_rng((GROUPS.index(group), seed))
    while True:
        stiction = float(random.uniform(*STICTION))
        cogging, gravity = random.uniform(0.0, (COGGING * coulomb, GRAVITY * coulomb)).tolist()
        phase, hanging = random.uniform(-math.pi, math.pi, 2).tolist()
        periods = int(random.integers(*PERIODS, endpoint=True))
        stribeck = float(np.exp(random.uniform(*np.log(FADING)))) if random.random() < 0.5 else 0.0
        everything = group == "together"
        effects = Effects(
            stiction=stiction if everything or group == "stiction" else 1.0,
            stribeck=stribeck,
            cogging=cogging if everything or group == "cogging" else 0.0,
            periods=periods,
            phase=phase,
            gravity=gravity if everything or group == "gravity" else 0.0,
            hanging=hanging,
        )
        if abs(effects.load(0.0)) <= (1.0 - SPREAD) * effects.stiction * coulomb:
            return effects


BACKWARD = (0.5, 2.0)
LOAD_FRICTION = (0.05, 0.3)
FEW_PERIODS = (2, 9)
MISFITS = ("direction", "load", "few periods")
"""Effects that no model of the identification has: another damping in each direction, friction that
grows with the motor's torque, cogging with less than a period within the motion"""


def drawn_misfit(misfit: str, coulomb: float, seed: int) -> Effects:
    """Draw the one effect of a seed's servo.

    Args:
        misfit: One of ``MISFITS``.
        coulomb: Of its model, which the cogging is scaled to [N·m].
        seed: Decides on all of it.
    """
    random = np.random.default_rng((100 + MISFITS.index(misfit), seed))
    if misfit == "direction":
        return Effects(backward=float(np.exp(random.uniform(*np.log(BACKWARD)))))
    if misfit == "load":
        return Effects(load_friction=float(random.uniform(*LOAD_FRICTION)))
    return Effects(
        cogging=COGGING * coulomb,
        periods=int(random.integers(*FEW_PERIODS, endpoint=True)),
        phase=float(random.uniform(-math.pi, math.pi)),
    )
