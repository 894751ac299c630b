"""Defines the shape of a one-sided wall, for sums of laws; a law of its own is a ``Wall``."""

from __future__ import annotations

from haptic_wall.controller.laws.shape import Grid, Memoryless, Numbers, Shape
from haptic_wall.controller.laws.spring import Spring
from haptic_wall.controller.laws.wall import SIGNS


class OneSided(Memoryless):
    """A wall that fills the positions on one side of zero.

    Args:
        sign: +1: above; -1: below.
    """

    damped_everywhere = False
    stores_work = True
    lowest_slope, highest_slope = 0.0, 1.0

    def __init__(self, sign: int) -> None:
        self._sign = sign

    def elongation(self, away: float, speed: float, stiffness: float) -> float:  # noqa: ARG002
        """Return the penetration, signed [rad]."""
        return away if self._sign * away > 0.0 else 0.0

    def potential(self, away: float) -> float:
        """Return half the penetration's square [rad²]."""
        return 0.5 * away * away if self._sign * away > 0.0 else 0.0

    def in_contact(self, away: float) -> bool:
        """Whether the shaft is inside."""
        return self._sign * away > 0.0


def make(numbers: Numbers, grid: Grid) -> Shape:  # noqa: ARG001 - as every law
    """Make the shape of a wall on ``wall.side``."""
    return Spring() if numbers.side == "both" else OneSided(SIGNS[numbers.side])
