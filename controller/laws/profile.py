"""Renders a profile: torque over position from a table, linear between its rows."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise

from haptic_wall.controller.laws.shape import Grid, LawError, Shape

ROUNDING = 1e-12
"""Torques below this fraction of the largest count as zero"""
STEEPEST = 1e12
"""Highest slope between two rows [N·m/rad], as of ``wall.stiffness``"""


class Profile(Shape):
    """Torque over position; beyond the table's ends the torque stays.

    Its steepest slope is the stiffness that it asks for. Where the guard allows less, all torques
    are scaled down in proportion.

    Args:
        positions: Rising [rad].
        torques: One for each [N·m]; the first not below 0 and the last not above, so that nothing
            is driven away without end.

    Raises:
        LawError: The table makes no law.
    """

    def __init__(self, positions: Sequence[float], torques: Sequence[float]) -> None:
        if len(positions) < 2:
            raise LawError("profile", f"found {len(positions)} rows", "two or more")
        slopes = []
        for (x, u), (y, v) in pairwise(zip(positions, torques, strict=True)):
            if not y > x:
                raise LawError("profile", f"found {y:g} rad after {x:g} rad", "rising positions")
            slope = (u - v) / (y - x)
            if not abs(slope) <= STEEPEST:
                raise LawError(
                    "profile",
                    f"found {u:g} N·m at {x:g} rad and {v:g} N·m at {y:g} rad",
                    f"a slope of at most {STEEPEST:g} N·m/rad between two positions",
                )
            slopes.append(slope)
        least = ROUNDING * max(map(abs, torques))
        torques = [0.0 if abs(torque) <= least else torque for torque in torques]
        if torques[0] < 0.0 or torques[-1] > 0.0:
            raise LawError(
                "profile",
                f"found {torques[0]:g} N·m at its first position, {torques[-1]:g} N·m at its last",
                "a first torque of 0 or above and a last one of 0 or below: beyond the ends the "
                "torque stays, and would drive the shaft away without end",
            )
        self.own_stiffness = stiffness = max(map(abs, slopes))
        if stiffness == 0.0:
            raise LawError("profile", "found the same torque everywhere", "torques that differ")
        at = max(range(len(slopes)), key=lambda i: abs(slopes[i]))
        self.steepest = f"from {positions[at]:.4g} to {positions[at + 1]:.4g} rad"
        self.lowest_slope, self.highest_slope = min(slopes) / stiffness, max(slopes) / stiffness
        self.lowest_slope = min(self.lowest_slope, 0.0)  # the torque stays beyond the ends
        self._positions = list(positions)
        self.lowest = positions[0], positions[-1]
        self._elongations = [-torque / stiffness for torque in torques]
        potentials = [0.0]
        least = 0.0
        rows = list(zip(self._positions, self._elongations, strict=True))
        for (x, e), (y, f) in pairwise(rows):
            start = potentials[-1]
            potentials.append(start + 0.5 * (e + f) * (y - x))
            if e < 0.0 < f:  # the lowest point lies between two rows
                least = min(least, start - 0.5 * e * e * (y - x) / (f - e))
            least = min(least, potentials[-1])
        self._potentials = [each - least for each in potentials]

    def elongation(self, away: float, speed: float, stiffness: float) -> float:  # noqa: ARG002
        """Return the table's torque over its stiffness, with the sign of a spring [rad]."""
        positions, elongations = self._positions, self._elongations
        if away <= positions[0]:
            return elongations[0]
        if away >= positions[-1]:
            return elongations[-1]
        i = bisect_right(positions, away)
        x, e = positions[i - 1], elongations[i - 1]
        return e + (elongations[i] - e) * (away - x) / (positions[i] - x)

    def potential(self, away: float) -> float:
        """Return the potential above its lowest point [rad²]."""
        positions = self._positions
        if away <= positions[0]:
            value = self._potentials[0] + self._elongations[0] * (away - positions[0])
            return max(0.0, value)  # rounding leaves a little less than zero at the lowest point
        i = min(bisect_right(positions, away), len(positions)) - 1
        between = 0.5 * (self._elongations[i] + self.elongation(away, 0.0, 0.0))
        return max(0.0, self._potentials[i] + between * (away - positions[i]))


def make(grid: Grid, profile: Sequence[tuple[float, float]]) -> Shape:  # noqa: ARG001 - as every law
    """Make a profile from the rows of ``wall.profile``.

    Raises:
        LawError: They make no law.
    """
    return Profile(*zip(*profile, strict=True)) if profile else Profile([], [])
