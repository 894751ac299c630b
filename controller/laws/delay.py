"""The delay ring: delays a torque by a whole number of periods."""

from __future__ import annotations


class DelayRing:
    """Delays a value by ``steps`` periods; gives zeros until the first value comes out.

    It counts periods, not calls: periods that the loop skipped also shift it, as if the last value
    had been pushed again in each of them.

    Args:
        steps: Whole periods of delay, 0 or more.
    """

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

    def coming(self, value: float) -> float:
        """Return the value that ``push(value)`` would return."""
        return self._ring[(self._at + 1) % (self.steps + 1)] if self.steps else value

    def resized(self, steps: int, last: float, coming: float) -> DelayRing:
        """Return a ring of another length with the same values under way.

        In a longer ring the lesser of two values is held for the added periods: of the one that
        came out last and of the one that comes next; zero, where they differ in sign. An encoder
        count makes one large value, which is not to last. In a shorter one the oldest values are
        left out.

        Args:
            steps: Steps of the new ring.
            last: The value that came out last, of a ring without length: others know theirs.
            coming: The value that comes out of such a ring next.
        """
        at, size = self._at, self.steps + 1
        waiting = [self._ring[(at + 1 + k) % size] for k in range(self.steps)]
        if self.steps:
            last, coming = self._ring[at], waiting[0]
        added = steps - self.steps
        held = 0.0 if last * coming <= 0.0 else min(last, coming, key=abs)
        waiting = [held] * added + waiting if added > 0 else waiting[-added:]
        ring = DelayRing(steps)
        ring._ring[1:] = waiting
        ring._last = self._last if self.steps else last
        return ring

    def clear(self) -> None:
        """Empty the ring: zeros come out until a new value does."""
        self._ring = [0.0] * (self.steps + 1)
        self._at = 0
        self._last = 0.0
