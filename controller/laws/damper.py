"""Renders a damper: virtual damping at every position, no elastic torque."""

from __future__ import annotations

from haptic_wall.controller.laws.shape import Grid, Memoryless, Numbers, Shape


class Damper(Memoryless):
    """A law whose elongation is zero everywhere."""

    lowest_slope, highest_slope = 0.0, 0.0

    def elongation(self, away: float, speed: float, stiffness: float) -> float:  # noqa: ARG002
        """Return zero."""
        return 0.0

    def potential(self, away: float) -> float:  # noqa: ARG002
        """Return zero."""
        return 0.0


def make(numbers: Numbers, grid: Grid) -> Shape:  # noqa: ARG001 - as every law
    """Make a damper; its only number is ``wall.damping``."""
    return Damper()
