"""Renders friction: a bristle that bends up to the friction torque, and then slips."""

from __future__ import annotations

import math

from haptic_wall.controller.laws.shape import Grid, Shape

TRAVEL_COUNTS = 4.0
"""Least travel of the bristle before it slips [encoder counts]"""


class Friction(Shape):
    """A spring to an anchor, which is dragged along where the spring would exceed the friction.

    It gives back only the energy of the bent bristle, which is lost when it slips.

    Args:
        torque: Torque at which it slips [N·m].
        step: Encoder step [rad]; 0: the position is not quantised.
    """

    lowest_slope, highest_slope = 0.0, 1.0
    stores_work = False
    steepest = "its bristle"

    def __init__(self, torque: float, step: float) -> None:
        self._torque = torque
        self.resolved = torque / (TRAVEL_COUNTS * step) if step > 0.0 else math.inf
        self._anchor = math.nan
        self._most = 0.0  # bend at which it slips [rad]

    def elongation(self, away: float, speed: float, stiffness: float) -> float:  # noqa: ARG002
        """Return the bristle's bend [rad], and drag its anchor along."""
        bent = away - self._anchor
        if math.isnan(bent):  # the first sample
            bent = 0.0
            self._anchor = away
        if stiffness > 0.0:
            self._most = most = self._torque / stiffness
            if not -most <= bent <= most:
                bent = math.copysign(most, bent)
                self._anchor = away - bent
        else:  # the bristle is not felt, so it does not bend
            bent = self._most = 0.0
            self._anchor = away
        return bent

    def potential(self, away: float) -> float:
        """Return that of the bristle as it would be bent there [rad²]."""
        bent = abs(away - self._anchor)
        return 0.5 * min(bent, self._most) ** 2 if bent > 0.0 else 0.0

    def settle(self, away: float) -> None:
        """Straighten the bristle at this position."""
        self._anchor = away


def make(grid: Grid, friction: float) -> Shape:
    """Make friction that slips at ``wall.friction`` [N·m]."""
    return Friction(friction, grid.step)
