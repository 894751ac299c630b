"""The delay ring: delays a torque by a whole number of periods."""

from __future__ import annotations


class DelayRing:
    """Delays a value by ``steps`` periods; gives zeros until the first value comes out.

    It counts periods, not calls: periods that the loop skipped also shift it, as if the last value
    had been pushed again in each of them.

    Args:
        steps: Whole periods of delay, 0 or more.
    """

    __slots__ = ("_at", "_last", "_ring", "steps")

    def __init__(self, steps: int) -> None:
        self.steps = steps
        self._ring = [0.0] * (steps + 1)
        self._at = 0
        self._last = 0.0

    def push(self, value: float, periods: int = 1) -> float:
        """Put a value in, ``periods`` after the last one, and return the value that comes out."""
        if self.steps == 0:
            return value
        ring = self._ring
        size = self.steps + 1
        if periods > 1:
            # More skipped periods than the ring's length fill it with this value alone.
            for _ in range(min(periods - 1, size)):
                ring[self._at] = self._last
                self._at = (self._at + 1) % size
        ring[self._at] = value
        self._last = value
        self._at = (self._at + 1) % size
        return ring[self._at]

    def clear(self) -> None:
        """Empty the ring: zeros come out until a new value does."""
        self._ring = [0.0] * (self.steps + 1)
        self._at = 0
        self._last = 0.0
