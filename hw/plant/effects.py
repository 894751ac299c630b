"""Describes effects that the ideal body lacks: friction at rest, gear load, weight, cogging.

The whole equation of motion is ::

    m x'' = u + e - b x' - A sin(N x + phase) - F sign(x')
    u     = w (1 + r sin(N_r x + phase_r))                              motor's torque
    e     = hand - G sin(x - angle)                                     external torque
    F     = c + L(u, e) + (s - c + R(u, e)) exp(-(|x'| / v_s)^n)        friction in motion

with w the torque of the motor's current, the viscous friction b one of two values by the direction
of motion, and L and R the loads of ``haptic_wall.hw.plant.gear_load``. At rest the body is stuck
while the torque on it is at most ``s + L + R``.

Source: models M1 to M6 of Duclusaud et al., "Extended Friction Models for the Physics Simulation of
Servo Actuators" (2024), arXiv:2410.08650.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from haptic_wall.hw.errors import SpecError
from haptic_wall.hw.plant.gear_load import GearLoad
from haptic_wall.hw.settings import (
    LEAST_STRIBECK_EXPONENT,
    MOST_LOAD_FRICTION,
    MOST_STRIBECK_EXPONENT,
    MOST_TORQUE_RIPPLE,
    TrueServo,
)


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
    """l_m: share of the motor's torque that the gear adds to the friction, from 0 to 0.9"""
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
    stribeck_exponent: float = 1.0
    """n: of the fall with the speed, 0.5 to 10"""
    load_friction_external: float | None = None
    """l_e: as ``load_friction``, of the external torque; None: as much"""
    load_friction_at_rest: float = 0.0
    """r_m: increase of ``load_friction`` at rest; both together up to 0.9"""
    load_friction_at_rest_external: float | None = None
    """r_e: increase of ``load_friction_external`` at rest; None: ``load_friction_at_rest``"""
    load_friction_square: float = 0.0
    """q_m: share of the square of the motor's torque, at rest [1/(N·m)], >= 0"""
    load_friction_square_external: float = 0.0
    """q_e: share of the square of the external torque, at rest [1/(N·m)], >= 0"""
    torque_ripple: float = 0.0
    """r: the motor's torque varies with the position by this share of it, 0 to 0.9"""
    torque_ripple_periods: float = 24.0
    """N_r: periods of that ripple a turn, > 0"""
    torque_ripple_phase: float = 0.0
    """Phase of the ripple at position 0 [rad]"""

    def __post_init__(self) -> None:
        for name in (
            "static_friction",
            "stribeck_speed",
            "damping_back",
            "gravity",
            "cogging",
            "load_friction_square",
            "load_friction_square_external",
        ):
            value = getattr(self, name)
            if value is not None and not 0.0 <= value < math.inf:
                raise SpecError(f"{name} is {value}", advice="give a finite value from 0 up")
        load = self.load
        for name, value, more in (
            ("load_friction", load.motor, load.rest_motor),
            ("load_friction_external", load.external, load.rest_external),
        ):
            if min(value, more) < 0.0 or not value + more <= MOST_LOAD_FRICTION:
                at_rest = f", {value + more:g} at rest" if more else ""
                raise SpecError(
                    f"{name} is {value}{at_rest}",
                    advice=f"give a fraction from 0 to {MOST_LOAD_FRICTION}, with the addition at"
                    " rest: with 1 no torque would ever move the servo",
                )
        for name, low, high in (
            ("torque_ripple", 0.0, MOST_TORQUE_RIPPLE),
            ("stribeck_exponent", LEAST_STRIBECK_EXPONENT, MOST_STRIBECK_EXPONENT),
        ):
            if not low <= getattr(self, name) <= high:
                raise SpecError(
                    f"{name} is {getattr(self, name)}", advice=f"give a value from {low} to {high}"
                )
        for name in ("cogging_periods", "torque_ripple_periods"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise SpecError(
                    f"{name} is {getattr(self, name)}", advice="give a finite number above 0"
                )
        for name in ("gravity_angle", "cogging_phase", "torque_ripple_phase"):
            value = getattr(self, name)
            if not math.isfinite(value):
                raise SpecError(f"{name} is {value}", advice="give a finite angle")

    @classmethod
    def of(cls, true: TrueServo) -> Effects:
        """Return the effects of a simulated servo.

        Raises:
            ValueError: A value is out of range, or the static friction below the Coulomb friction.
        """
        found = cls(**{field.name: getattr(true, field.name) for field in fields(cls)})
        found.breakaway(true.coulomb)
        return found

    @property
    def load(self) -> GearLoad:
        """Return the shares of both sides' torques that the gear adds to the friction."""
        external, rest = self.load_friction_external, self.load_friction_at_rest_external
        return GearLoad(
            self.load_friction,
            self.load_friction if external is None else external,
            self.load_friction_at_rest,
            self.load_friction_at_rest if rest is None else rest,
            self.load_friction_square,
            self.load_friction_square_external,
        )

    def breakaway(self, coulomb: float) -> float:
        """Return the static friction without load [N·m] beside this Coulomb friction.

        Raises:
            ValueError: It lies below the Coulomb friction.
        """
        static = self.static_friction or coulomb
        if static < coulomb:
            raise SpecError(
                f"static_friction is {static:g} N·m, below coulomb {coulomb:g} N·m",
                advice="give at least coulomb, or 0 for coulomb",
            )
        return static

    def none(self, damping: float, coulomb: float) -> bool:
        """Whether none of the effects acts, for a body with viscous and Coulomb friction."""
        return (
            self.breakaway(coulomb) == coulomb
            and self.damping_back in (None, damping)
            and not any(self.load)
            and self.gravity == 0.0
            and self.cogging == 0.0
            and self.torque_ripple == 0.0
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

    def ripple_at(self, position: float) -> float:
        """Return the torque ripple at a position, as a fraction of the motor's mean torque."""
        if self.torque_ripple == 0.0:
            return 0.0
        phase = self.torque_ripple_periods * position + self.torque_ripple_phase
        return self.torque_ripple * math.sin(phase)
