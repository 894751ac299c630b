"""Counts missed periods: the fraction of the last half second's periods without a tick."""

from __future__ import annotations

from collections import deque

WINDOW_S = 0.5
"""Time over which missed periods are counted [s]"""
_LEAST = 10
"""Periods in the window at low rates"""


class MissedPeriods:
    """Counts missed periods over the last half second of the grid's time.

    It takes no time in a tick without missed periods before it.

    Args:
        period_ns: Period of the grid [ns].
        max_missed: Fraction of the periods in the window that may be missed [1].

    Attributes:
        max_missed: As given.
        worst: The largest fraction in any window [1].
    """

    __slots__ = ("_gaps", "_missed", "_periods", "_window_ns", "max_missed", "worst")

    def __init__(self, period_ns: int, max_missed: float) -> None:
        self._window_ns = max(round(WINDOW_S * 1e9), _LEAST * period_ns)
        self._periods = self._window_ns / period_ns
        self._gaps: deque[tuple[int, int]] = deque()
        self._missed = 0
        self.max_missed = max_missed
        self.worst = 0.0

    @property
    def exceeded(self) -> bool:
        """Whether more periods than allowed were missed in some window."""
        return self.worst > self.max_missed

    def count(self, deadline_ns: int, missed: int) -> bool:
        """Count ``missed`` periods before a deadline; return whether the window has too many now.

        Args:
            deadline_ns: The deadline that was served after them [ns].
            missed: Number of missed periods.
        """
        gaps = self._gaps
        gaps.append((deadline_ns, missed))
        self._missed += missed
        while gaps[0][0] <= deadline_ns - self._window_ns:
            self._missed -= gaps.popleft()[1]
        fraction = min(self._missed / self._periods, 1.0)
        self.worst = max(self.worst, fraction)
        return fraction > self.max_missed
