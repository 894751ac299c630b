"""Renders detents: positions at equal distances that hold the shaft."""

from __future__ import annotations

import math

from haptic_wall.controller.laws.shape import Grid, LawError, Shape

WIDTH_COUNTS = 16.0
"""Least distance between detents [encoder counts]"""


class Detents(Shape):
    """Torque rises from each detent to a peak, and falls to zero midway to the next one.

    Both parts are straight, the steeper one of slope 1. At a snap of 0.25 both are equally steep; a
    smaller one gives a firm detent and a long soft crest, a larger one a soft detent that lets go
    sharply.

    Args:
        width: Distance between detents [rad].
        snap: Distance from a detent to the peak, as a fraction of the width: above 0, below 0.5,
            where the torque would jump from one side to the other.
    """

    def __init__(self, width: float, snap: float) -> None:
        self._width = width
        self._half = 0.5 * width
        self._peak = peak = snap * width
        rest = self._half - peak
        self._rise = min(1.0, rest / peak)
        self._fall = min(1.0, peak / rest)
        self._crest = 0.5 * self._rise * peak * self._half
        self.lowest_slope, self.highest_slope = -self._fall, self._rise
        self.steepest = "its crest" if self._fall > self._rise else "its detent"

    def elongation(self, away: float, speed: float, stiffness: float) -> float:  # noqa: ARG002
        """Return the distance from the nearest detent, less beyond the peak [rad]."""
        off = away - self._width * math.floor(away / self._width + 0.5)
        peak = self._peak
        if -peak <= off <= peak:
            return self._rise * off
        return self._fall * (self._half - off if off > 0.0 else -self._half - off)

    def potential(self, away: float) -> float:
        """Return the potential above that of a detent [rad²]."""
        off = abs(away - self._width * math.floor(away / self._width + 0.5))
        if off <= self._peak:
            return 0.5 * self._rise * off * off
        left = self._half - off
        return self._crest - 0.5 * self._fall * left * left


def make(grid: Grid, count: int | None, width: float | None, snap: float) -> Shape:
    """Make detents from ``wall.count`` or ``wall.width``, and ``wall.snap``.

    Raises:
        LawError: Not exactly one of count and width is given, or the encoder does not resolve the
            width.
    """
    if (count is None) == (width is None):
        found = "found nothing" if count is None else "found wall.width too"
        raise LawError("count", found, "the number of detents in a turn, or wall.width [rad]")
    name = "count" if width is None else "width"
    width = math.tau / count if width is None and count is not None else width
    assert width is not None
    if width < WIDTH_COUNTS * grid.step:
        raise LawError(
            name,
            f"found detents {width:.4g} rad apart",
            f"at least {WIDTH_COUNTS:g} encoder counts, {WIDTH_COUNTS * grid.step:.4g} rad",
        )
    return Detents(width, snap)
