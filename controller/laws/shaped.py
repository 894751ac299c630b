"""Renders a shape: elastic torque, damping where it acts, torque limits."""

from __future__ import annotations

import math

from haptic_wall.controller.laws.shape import Shape
from haptic_wall.controller.laws.wall import Derating, limited_torque


class ShapedLaw:
    """A law whose elastic torque is ``-K e(x)``; attributes as of ``Law``.

    It holds no load while it is derated: ``Derating.carried`` has no effect.

    Args:
        name: Name of the law, for people.
        shape: Its elongation over position.
        position: Position from which the shape's positions count [rad].
        clip: Largest torque of spring and damper together [N·m].
    """

    linear, guarded, phase, done = False, True, 0, False

    def __init__(self, name: str, shape: Shape, position: float, clip: float = math.inf) -> None:
        self.name = name
        self._shape = shape
        self._everywhere = shape.damped_everywhere
        self.one_sided = not self._everywhere
        self.stiffness = self.damping = self.injected = 0.0
        self.position = position
        self.clip = clip
        self.derating = Derating()
        self.held = 0.0

    def in_contact(self, position: float) -> bool:
        """Whether the law acts at ``position`` [rad]."""
        return self._shape.in_contact(position - self.position)

    def elongation(self, position: float) -> float:
        """Return the elongation of a linear spring with the same energy at ``position`` [rad]."""
        away = position - self.position
        return away if math.isnan(away) else math.sqrt(2.0 * self._shape.potential(away))

    def stored(self, position: float, limit: float) -> float:  # noqa: ARG002 - see below
        """Return the energy in the spring at ``position`` [J], or a little more.

        A limit of the torque is not counted: it only lessens the energy.
        """
        away = position - self.position
        return away if math.isnan(away) else self.stiffness * self._shape.potential(away)

    def settle(self, position: float) -> None:
        """Start at rest at ``position`` [rad]."""
        self._shape.settle(position - self.position)

    def torque(self, position: float, velocity: float) -> float:
        """Return the torque [N·m] at a position [rad] and a velocity [rad/s]; call once a tick."""
        away = position - self.position
        if math.isnan(away):
            return away  # not a number: the safety checks must see it
        stiffness = self.stiffness
        elongation = self._shape.elongation(away, velocity, stiffness)
        derating = self.derating
        softer = stiffness * derating.scale
        torque = -softer * elongation
        limit = derating.elastic_limit
        if torque > limit or torque < -limit:
            torque = limited_torque(torque, limit, softer * (abs(away) - derating.soft_to))
        everywhere = self._everywhere
        if not everywhere and elongation == 0.0:
            return 0.0
        torque -= (self.damping + self.injected) * derating.damping_scale * velocity
        clip = self.clip
        if torque > clip:
            torque = clip
        elif torque < -clip:
            torque = -clip
        if not everywhere and elongation * torque >= 0.0:
            return 0.0  # it never pulls
        return torque
