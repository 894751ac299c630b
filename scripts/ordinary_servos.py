"""Draws servos that are no ideal ones: friction that is larger at rest, cogging, a weight.

The effects are those of ``haptic_wall.hw.plant.effects``, here in proportion to a servo's own
friction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from haptic_wall.controller.settings.config import Config

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
    """Fraction of the load that the gear adds to the friction"""

    def load(self, position: float) -> float:
        """Torque against the shaft [N·m]."""
        return self.cogging * math.sin(
            self.periods * position + self.phase
        ) + self.gravity * math.sin(position - self.hanging)

    def on(self, config: Config) -> Config:
        """Return the configuration with these effects on its simulated servo."""
        raw = config.model_dump(mode="json")
        servo = raw["servo"]
        servo["static_friction"] = self.stiction * servo["coulomb"]
        servo["stribeck_speed"] = self.stribeck
        servo["damping_back"] = self.backward * servo["damping"]
        servo["load_friction"] = self.load_friction
        servo["gravity"], servo["gravity_angle"] = self.gravity, self.hanging
        servo["cogging"], servo["cogging_periods"] = self.cogging, self.periods
        servo["cogging_phase"] = self.phase
        return Config.model_validate(raw)


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
