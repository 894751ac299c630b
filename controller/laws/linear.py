"""Renders a spring to a centre, which is the same as a two-sided wall, and viscous friction."""

from __future__ import annotations

from haptic_wall.controller.laws.shape import Grid, Shape


class Linear(Shape):
    """Elongation is a multiple of the distance from the centre.

    Args:
        slope: 1: a spring; 0: a damper, without an elastic torque [1].
    """

    def __init__(self, slope: float) -> None:
        self.lowest_slope = self.highest_slope = slope
        self.own_stiffness = None if slope else 0.0

    def elongation(self, away: float, speed: float, stiffness: float) -> float:  # noqa: ARG002
        """Return the distance from the centre times the slope [rad]."""
        return self.highest_slope * away

    def potential(self, away: float) -> float:
        """Return half the distance's square times the slope [rad²]."""
        return 0.5 * self.highest_slope * away * away


def spring(grid: Grid) -> Shape:  # noqa: ARG001 - as every law
    """Make a spring; it has no numbers besides stiffness, damping and position."""
    return Linear(1.0)


def damper(grid: Grid) -> Shape:  # noqa: ARG001 - as every law
    """Make a damper; its only number is ``wall.damping``."""
    return Linear(0.0)
