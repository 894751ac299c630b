"""Counts consecutive half-cycles that the torque explains up to a constant error of the model.

A wrong belief is wrong by the same in every half-cycle, so that its unexplained remainder stays
constant while the amplitude changes. A hand's remainder varies.
"""

from __future__ import annotations

import math

from haptic_wall.controller.detector.tuning import StreakTuning


class Streaks:
    """Counts consecutive half-cycles.

    Attributes:
        moved: Half-cycles in which the torque moved the believed inertia.
        explained: Of the last ones, those in which it also supplied friction, with a
            constant remainder.
        even: Half-cycles with a constant remainder, explained or not.
        outward: Of the last explained ones, those that led farther away from the wall.
        grown: By how much, as a logarithm.
    """

    __slots__ = (
        "_last",
        "_left",
        "_share",
        "_tuning",
        "even",
        "explained",
        "grown",
        "moved",
        "outward",
    )

    def __init__(self, tuning: StreakTuning) -> None:
        """Begin with none; ``tuning`` says how much two remainders of a streak differ."""
        self._tuning = tuning
        self.clear()

    def clear(self) -> None:
        """Restart all counts."""
        self.moved = self.explained = self.even = self.outward = 0
        self.grown = 0.0
        self._last = (0.0, 0.0)
        self._left = self._share = (math.nan, math.nan)

    def take(self, *, moved: bool, explained: bool, share: float, left: float, fine: float) -> None:
        """Count a half-cycle.

        Args:
            moved: The torque moved the servo's inertia.
            explained: It also supplied friction, and nothing else.
            share: Apparent over believed inertia.
            left: Its work beyond friction's, as a damping over ``m ω``.
            fine: A count of the encoder, over the amplitude.
        """
        tuning = self._tuning
        most = tuning.inertia + tuning.inertia_counts * fine
        self._share, same = _within(self._share, share, most)
        self.moved = (self.moved + 1 if same else 1) if moved else 0
        most = tuning.damping + tuning.damping_counts * fine
        self._left, same = _within(self._left, left, most)
        self.even = self.even + 1 if same else 1
        self.explained = min(self.explained + 1, self.even) if explained else 0

    def went_outward(self, outward: float) -> None:
        """Count the growth of the distance from the wall, as a logarithm; <= 0: no growth."""
        if outward > 0.0:
            self.outward += 1
            self.grown += outward
        else:
            self.outward, self.grown = 0, 0.0
        self._last = (self._last[1], outward)

    @property
    def least_outward(self) -> float:
        """Return the smaller one of the last two over their mean; 1 where all are equal."""
        return min(self._last) * self.outward / self.grown if self.outward else 0.0


def _within(
    span: tuple[float, float], value: float, most: float
) -> tuple[tuple[float, float], bool]:
    """Return the span extended by the value if narrow enough, else the value alone; and which."""
    low, high = min(value, span[0]), max(value, span[1])
    if high - low > most:
        return (value, value), False
    return (low, high), True
