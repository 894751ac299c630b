"""Renders springs beyond the ends of a free range: stops, a wall, a spring, viscous friction."""

from __future__ import annotations

import math

from haptic_wall.controller.laws.shape import Grid, LawError, Shape
from haptic_wall.controller.laws.wall import Side

RANGE_COUNTS = 4.0
"""Shortest free range between two stops [encoder counts]"""


class Stops(Shape):
    """Zero between two ends, and a spring beyond each.

    Args:
        low: Lower end of the free range [rad]; -inf: it has none.
        high: Upper end, not below ``low`` [rad]; inf: it has none.
        damped: Damping acts everywhere. Else the law never pulls.
    """

    def __init__(self, low: float, high: float, *, damped: bool = False) -> None:
        self._low = low
        self._high = high
        self.damped_everywhere = damped
        ends = [end for end in (low, high) if math.isfinite(end)]
        self.lowest_slope = 1.0 if low == high else 0.0
        self.highest_slope = 1.0 if ends else 0.0
        self.own_stiffness = None if ends else 0.0
        self.lowest = (ends[0], ends[-1]) if ends else (0.0, 0.0)

    def elongation(self, away: float, speed: float, stiffness: float) -> float:  # noqa: ARG002
        """Return the penetration of the nearest end, signed [rad]."""
        if away > self._high:
            return away - self._high
        return away - self._low if away < self._low else 0.0

    def potential(self, away: float) -> float:
        """Return half the penetration's square [rad²]."""
        depth = self.elongation(away, 0.0, 0.0)
        return 0.5 * depth * depth

    def in_contact(self, away: float) -> bool:
        """Whether the shaft is beyond an end, or damping acts everywhere."""
        return self.damped_everywhere or away > self._high or away < self._low


def spring(grid: Grid) -> Shape:  # noqa: ARG001 - as every law
    """Make a spring to a centre, which is the same as a two-sided wall."""
    return Stops(0.0, 0.0, damped=True)


def damper(grid: Grid) -> Shape:  # noqa: ARG001 - as every law
    """Make a damper; its only number is ``wall.damping``."""
    return Stops(-math.inf, math.inf, damped=True)


def wall(grid: Grid, side: Side) -> Shape:
    """Make the shape of a wall on ``wall.side``, for sums; a law of its own is a ``Wall``."""
    if side == "both":
        return spring(grid)
    return Stops(-math.inf, 0.0) if side == "above" else Stops(0.0, math.inf)


def make(grid: Grid, low: float, high: float) -> Shape:
    """Make the stops from ``wall.low`` and ``wall.high``.

    Raises:
        LawError: The free range is shorter than four encoder counts.
    """
    if high <= low or high - low < RANGE_COUNTS * grid.step:
        raise LawError(
            "high",
            f"found {high:g} rad with wall.low {low:g} rad",
            f"an end above wall.low by at least {RANGE_COUNTS:g} encoder counts",
        )
    return Stops(low, high)
