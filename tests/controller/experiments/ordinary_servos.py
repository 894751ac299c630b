"""Effects that an ordinary servo has: friction that is larger at rest, cogging, a weight.

The effects are those of ``haptic_wall.hw.plant.mechanics``, here in proportion to a servo's own
friction.
"""

from __future__ import annotations

from dataclasses import dataclass

from haptic_wall.controller.settings.config import Config


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
    """Periods of the cogging in a turn"""
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
