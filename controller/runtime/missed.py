"""Counts missed periods: the fraction of the last half second's periods without a tick."""

from __future__ import annotations

WINDOW_S = 0.5
"""Time over which missed periods are counted [s]"""
_BUCKETS = 10


class MissedPeriods:
    """Counts missed periods over the last half second, in ten buckets of the grid's time.

    It takes no time in a tick without missed periods before it.

    Args:
        period_ns: Period of the grid [ns].
        max_missed: Fraction of the periods in the window that may be missed [1].

    Attributes:
        max_missed: As given.
        worst: The largest fraction in any window [1].
    """

    __slots__ = ("_bucket_ns", "_counts", "_last", "_periods", "max_missed", "worst")

    def __init__(self, period_ns: int, max_missed: float) -> None:
        window_ns = max(round(WINDOW_S * 1e9), _BUCKETS * period_ns)
        self._bucket_ns = window_ns // _BUCKETS
        self._periods = window_ns / period_ns
        self.max_missed = max_missed
        self._counts = [0] * _BUCKETS
        self._last = 0
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
        counts = self._counts
        bucket = deadline_ns // self._bucket_ns
        for old in range(max(self._last + 1, bucket - _BUCKETS + 1), bucket + 1):
            counts[old % _BUCKETS] = 0
        self._last = bucket
        counts[bucket % _BUCKETS] += missed
        fraction = min(sum(counts) / self._periods, 1.0)
        self.worst = max(self.worst, fraction)
        return fraction > self.max_missed
