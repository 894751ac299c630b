"""Effects of a real servo's mechanics that the ideal body lacks: friction at rest, loads, cogging.

The whole equation of motion is ::

    m x'' = u + e - b x' - A sin(N x + phase) - F sign(x')
    e     = hand - G sin(x - angle)                                     external torque
    F     = c + (s - c) exp(-|x'| / v_s) + l |u - e|                    friction in motion

with the viscous friction b one of two values by the direction of motion. At rest the body is stuck
while the torque on it is at most ``s + l |u - e|``.

Source: models M1 to M4 of Duclusaud et al., "Extended Friction Models for the Physics Simulation of
Servo Actuators" (2024), arXiv:2410.08650, with the Stribeck exponent 1 and a share of the load that
is the same at rest and in motion.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from haptic_wall.hw.errors import SpecError
from haptic_wall.hw.settings import MOST_LOAD_FRICTION, TrueServo


@dataclass(frozen=True, slots=True)
class Effects:
    """Effects beside inertia, viscous and Coulomb friction; by default none of them.

    Raises:
        ValueError: A value is out of range.
    """

    static_friction: float = 0.0
    """s: torque up to which a body at rest stays there [N·m], at least the Coulomb friction; 0: as
    much as that"""
    stribeck_speed: float = 0.0
    """v_s: speed over which the excess of the static friction falls by a factor e [rad/s], >= 0; 0:
    it is gone as soon as the body moves"""
    damping_back: float | None = None
    """Viscous friction at negative velocities [N·m·s/rad], >= 0; None: as at positive ones"""
    load_friction: float = 0.0
    """l: share of the load |u - e| that the gear adds to the friction, from 0 to 0.9"""
    gravity: float = 0.0
    """G: torque of a weight on a horizontal link [N·m], >= 0"""
    gravity_angle: float = 0.0
    """Position at which the weight hangs [rad]"""
    cogging: float = 0.0
    """A: amplitude of a torque that alternates with the position [N·m], >= 0"""
    cogging_periods: float = 24.0
    """N: periods of the cogging a turn, > 0"""
    cogging_phase: float = 0.0
    """Phase of the cogging at position 0 [rad]"""

    def __post_init__(self) -> None:
        for name in ("static_friction", "stribeck_speed", "damping_back", "gravity", "cogging"):
            value = getattr(self, name)
            if value is not None and not 0.0 <= value < math.inf:
                raise SpecError(f"{name} is {value}", advice="give a finite value from 0 up")
        if not 0.0 <= self.load_friction <= MOST_LOAD_FRICTION:
            raise SpecError(
                f"load_friction is {self.load_friction}",
                advice=f"give a share from 0 to {MOST_LOAD_FRICTION}: with 1 no torque would "
                "ever move the servo",
            )
        if not 0.0 < self.cogging_periods < math.inf:
            raise SpecError(
                f"cogging_periods is {self.cogging_periods}", advice="give a finite number above 0"
            )
        for name in ("gravity_angle", "cogging_phase"):
            value = getattr(self, name)
            if not math.isfinite(value):
                raise SpecError(f"{name} is {value}", advice="give a finite angle")

    @classmethod
    def of(cls, true: TrueServo) -> Effects:
        """Return the effects of a simulated servo.

        Raises:
            ValueError: A value is out of range, or the static friction below the Coulomb friction.
        """
        found = cls(
            true.static_friction,
            true.stribeck_speed,
            true.damping_back,
            true.load_friction,
            true.gravity,
            true.gravity_angle,
            true.cogging,
            true.cogging_periods,
            true.cogging_phase,
        )
        found.breakaway(true.coulomb)
        return found

    def breakaway(self, coulomb: float) -> float:
        """Return the static friction without load [N·m] beside this Coulomb friction.

        Raises:
            ValueError: It lies below the Coulomb friction.
        """
        static = self.static_friction or coulomb
        if static < coulomb:
            raise SpecError(
                f"static_friction is {static:g} N·m, below coulomb {coulomb:g} N·m",
                advice="give at least as much, or 0 for as much",
            )
        return static

    def none(self, damping: float, coulomb: float) -> bool:
        """Whether a body with this friction [N·m·s/rad, N·m] moves as without any effect."""
        return (
            self.breakaway(coulomb) == coulomb
            and self.damping_back in (None, damping)
            and self.load_friction == 0.0
            and self.gravity == 0.0
            and self.cogging == 0.0
        )

    def weight_at(self, position: float) -> float:
        """Return the torque of the weight at a position [N·m]."""
        if self.gravity == 0.0:
            return 0.0
        return -self.gravity * math.sin(position - self.gravity_angle)

    def cogging_at(self, position: float) -> float:
        """Return the torque of the cogging at a position [N·m]."""
        if self.cogging == 0.0:
            return 0.0
        return -self.cogging * math.sin(self.cogging_periods * position + self.cogging_phase)
