"""Counts how much longer sleeps last than requested, at the loop's pace: integers, no arrays."""

from __future__ import annotations

from haptic_wall.controller.runtime.deadlines import Waiter


class Overshoots:
    """Percentiles of the sleeps' overshoot, in bins of an eighth of an octave."""

    def __init__(self) -> None:
        self._counts = [0] * (8 * 64)
        self._max_ns = 0
        self._n = 0

    def add(self, deadline_ns: int, waiter: Waiter, times: int) -> None:
        """Count the sleep before a deadline [ns], if there was one, a number of times."""
        if waiter.slept_ns == 0:
            return
        overshoot_ns = max(0, waiter.slept_ns + waiter.margin_ns - deadline_ns)
        octave = max(4, overshoot_ns.bit_length())
        self._counts[8 * octave + ((overshoot_ns >> (octave - 4)) & 7)] += times
        self._n += times
        self._max_ns = max(self._max_ns, overshoot_ns)

    def as_report(self) -> dict[str, float | None]:
        """Return ``{p50, p99, max}`` [µs]; percentiles to 6 %."""
        return {
            "p50": self._percentile_us(0.5),
            "p99": self._percentile_us(0.99),
            "max": self._max_ns / 1e3 if self._n else None,
        }

    def _percentile_us(self, share: float) -> float | None:
        left = share * self._n
        for place, count in enumerate(self._counts):
            left -= count
            if count and left <= 0:
                octave, eighth = divmod(place, 8)
                return min((8.5 + eighth) * 2.0 ** (octave - 4), self._max_ns) / 1e3
        return None
