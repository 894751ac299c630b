"""How many swings in a row the torque explains, and whether what is left over stays the same.

A belief that is wrong is wrong by the same in every swing, so that what it leaves unexplained stays
the same while the amplitude changes. What a hand does is another thing each time.
"""

from __future__ import annotations

import math

_SAME, _SAME_COUNTS = 0.03, 0.525
"""What is left over may differ by so much within a streak, of ``m ω``; the second per amplitude in
counts."""
_ONE_MASS, _ONE_MASS_COUNTS = 0.2, 1.0
"""And the inertia that the torque seems to move, as a share."""


class Streaks:
    """Counts swings without a break.

    Attributes:
        moved: Swings in which the torque moved what it is believed to move.
        explained: Of the last ones, those in which it paid for it too, and what was left over
            stayed the same.
        even: Swings in which what was left over stayed the same, explained or not.
        outward: Of the last explained ones, those that led farther away from the wall.
        grown: By how much, as a logarithm.
    """

    __slots__ = (
        "_last",
        "_left",
        "_share",
        "even",
        "explained",
        "grown",
        "moved",
        "outward",
    )

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Forget all of them."""
        self.moved = self.explained = self.even = self.outward = 0
        self.grown = 0.0
        self._last = (0.0, 0.0)
        self._left = self._share = (math.nan, math.nan)

    def take(self, *, moved: bool, explained: bool, share: float, left: float, fine: float) -> None:
        """Take a swing.

        Args:
            moved: Whether the torque moved the servo's inertia.
            explained: Whether it paid for friction, too, and for nothing else.
            share: Inertia that it moved, of the believed one.
            left: Work that it did beyond friction's, as a damping over ``m ω``.
            fine: A count of the encoder, over the amplitude.
        """
        self._share, same = _within(self._share, share, _ONE_MASS + _ONE_MASS_COUNTS * fine)
        self.moved = (self.moved + 1 if same else 1) if moved else 0
        self._left, same = _within(self._left, left, _SAME + _SAME_COUNTS * fine)
        self.even = self.even + 1 if same else 1
        self.explained = min(self.explained + 1, self.even) if explained else 0

    def went_outward(self, outward: float) -> None:
        """Take the growth of the distance from the wall, as a logarithm; <= 0: it did not grow."""
        if outward > 0.0:
            self.outward += 1
            self.grown += outward
        else:
            self.outward, self.grown = 0, 0.0
        self._last = (self._last[1], outward)

    @property
    def least_outward(self) -> float:
        """The smaller one of the last two, of their mean; 1 where all are alike."""
        return min(self._last) * self.outward / self.grown if self.outward else 0.0


def _within(
    span: tuple[float, float], value: float, most: float
) -> tuple[tuple[float, float], bool]:
    """The span that holds the value too, and whether it is narrow enough; else the value alone."""
    low, high = min(value, span[0]), max(value, span[1])
    if high - low > most:
        return (value, value), False
    return (low, high), True
