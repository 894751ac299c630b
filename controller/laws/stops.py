"""Renders stops: a wall at each end of a free range, or at one end of an endless one."""

from __future__ import annotations

import math

from haptic_wall.controller.laws import linear
from haptic_wall.controller.laws.shape import Grid, LawError, Shape
from haptic_wall.controller.laws.wall import Side


class Stops(Shape):
    """Zero between two ends, and beyond each a wall that never pulls.

    Args:
        low: Lower end of the free range [rad]; -inf: it has none.
        high: Upper end, above ``low`` [rad]; inf: it has none.
    """

    damped_everywhere = False
    lowest_slope, highest_slope = 0.0, 1.0

    def __init__(self, low: float, high: float) -> None:
        self._low = low
        self._high = high
        ends = [end for end in (low, high) if math.isfinite(end)]
        self.lowest = ends[0], ends[-1]

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
        """Whether the shaft is beyond an end."""
        return away > self._high or away < self._low


def wall(grid: Grid, side: Side) -> Shape:
    """Make the shape of a wall on ``wall.side``, for sums; a law of its own is a ``Wall``."""
    if side == "both":
        return linear.spring(grid)
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


RANGE_COUNTS = 4.0
"""Shortest free range between two stops [encoder counts]"""
