"""Renders a spring to a centre; it is the same as a two-sided wall."""

from __future__ import annotations

from haptic_wall.controller.laws.shape import Grid, Memoryless, Numbers, Shape


class Spring(Memoryless):
    """Elongation is the distance from the centre."""

    lowest_slope, highest_slope = 1.0, 1.0

    def elongation(self, away: float, speed: float, stiffness: float) -> float:  # noqa: ARG002
        """Return the distance from the centre [rad]."""
        return away

    def potential(self, away: float) -> float:
        """Return half the distance's square [rad²]."""
        return 0.5 * away * away


def make(numbers: Numbers, grid: Grid) -> Shape:  # noqa: ARG001 - as every law
    """Make a spring; it has no numbers besides stiffness, damping and position."""
    return Spring()
