"""The loads of an ordinary servo: a weight or a spring, cogging, excess friction at rest.

The loads depend on the measured position, so they are torques of known shape and unknown size: a
weight's follows the sine and cosine of the angle, cogging those of a multiple of it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from haptic_wall.controller.theory.checks import FloatArray

_AWAY = 0.3
"""Scale of the positions [rad]"""
_FURTHEST = 4.0
"""Largest correction of the periods in a turn by one step"""


@dataclass(frozen=True, slots=True)
class Loads:
    """Torques against the shaft, and the friction at rest."""

    static: float
    """Friction at rest [N·m]; at most that in motion: no excess"""
    fading: float
    """Speed at which the excess has fallen to a third [rad/s]; 0: none in motion"""
    center: float
    """Position at which the cogging's phase is given [rad]"""
    periods: float = 0.0
    """Of the cogging in a turn; 0: there is none"""
    weights: tuple[float, ...] = (0.0, 0.0)
    """Of each of ``waves`` [N·m]"""
    errors: tuple[float, ...] = ()
    """Standard errors of the friction at rest [N·m], its fading [rad/s] and the weights [N·m]"""

    @property
    def gravity(self) -> float:
        """Return the amplitude of the torque with the angle's period [N·m]."""
        return math.hypot(*self.weights[:2])

    @property
    def hanging(self) -> float:
        """Return the angle at which a weight would hang [rad]."""
        return math.atan2(-self.weights[1], self.weights[0])

    @property
    def cogging(self) -> float:
        """Return the amplitude of the cogging [N·m]."""
        return math.hypot(*self.weights[2:4]) if self.periods else 0.0

    def waves(self, position: FloatArray) -> FloatArray:
        """Return torques per weight: sine and cosine of the angle, and of the cogging's.

        With a cogging the last one is the derivative with respect to its periods in a turn.

        Returns:
            Shape (2, 4 or 5, *position.shape).
        """
        found = [np.sin(position), np.cos(position)]
        if self.periods:
            away = position - self.center
            sine, cosine = np.sin(self.periods * away), np.cos(self.periods * away)
            found += [sine, cosine]
            if self.cogging > 0.0:
                one, other = self.weights[2:4]
                found.append(away * (one * cosine - other * sine) / (_AWAY * self.cogging))
        return np.stack(found)

    def settled(self) -> Loads:
        """Return the loads with the last weight's correction of the periods applied."""
        if len(self.weights) < 5 or self.cogging == 0.0:
            return self
        away = self.weights[4] / (_AWAY * self.cogging)
        periods = self.periods + min(max(away, -_FURTHEST), _FURTHEST)
        return replace(self, periods=max(periods, 1.0), weights=(*self.weights[:4], 0.0))
