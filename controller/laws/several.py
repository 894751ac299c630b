"""Renders a sum of laws."""

from __future__ import annotations

from collections.abc import Sequence

from haptic_wall.controller.laws.shape import Shape

PLACES = 2048
"""Places between which the lowest point of a sum is sought"""


class Sum(Shape):
    """The weighted sum of several shapes, scaled to a steepest slope of one.

    The bound of its slope is the sum of the parts' bounds, wherever these are steepest.

    Args:
        parts: Name, shape and weight (``share``) of each part; weights are above 0 [1].
    """

    def __init__(self, parts: Sequence[tuple[str, Shape, float]]) -> None:
        low = sum(share * shape.lowest_slope for _, shape, share in parts)
        high = sum(share * shape.highest_slope for _, shape, share in parts)
        most = max(-low, high)
        scale = 1.0 / most if most > 0.0 else 1.0
        self.lowest_slope, self.highest_slope = low * scale, high * scale
        self._parts = [(shape, share * scale) for _, shape, share in parts]
        self.resolved = min(shape.resolved / share for shape, share in self._parts)
        self.own_stiffness = None if most > 0.0 else 0.0  # dampers alone
        self.damped_everywhere = any(shape.damped_everywhere for _, shape, _ in parts)
        self.stores_work = all(shape.stores_work for _, shape, _ in parts)
        self.steepest = max(
            parts, key=lambda part: part[2] * max(-part[1].lowest_slope, part[1].highest_slope)
        )[0]
        low = min(shape.lowest[0] for _, shape, _ in parts)
        high = max(shape.lowest[1] for _, shape, _ in parts)
        self.lowest = low, high
        self._floor = 0.0
        step = (high - low) / PLACES
        if self.potential(0.0) > 0.0:  # the parts do not rest at one place
            self._floor = min(self.potential(low + step * k) for k in range(PLACES + 1))

    def elongation(self, away: float, speed: float, stiffness: float) -> float:
        """Return the weighted sum of the parts' elongations [rad]."""
        total = 0.0
        for shape, share in self._parts:
            total += share * shape.elongation(away, speed, share * stiffness)
        return total

    def potential(self, away: float) -> float:
        """Return the sum of the parts' potentials above its lowest point [rad²]."""
        whole = sum(share * shape.potential(away) for shape, share in self._parts)
        return max(0.0, whole - self._floor)

    def in_contact(self, away: float) -> bool:
        """Whether any part acts at this position."""
        return any(shape.in_contact(away) for shape, _ in self._parts)

    def settle(self, away: float) -> None:
        """Start every part at rest at this position."""
        for shape, _ in self._parts:
            shape.settle(away)
