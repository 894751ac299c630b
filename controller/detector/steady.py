"""Counts half-cycles that repeat more regularly than a hand can make them."""

from __future__ import annotations

from haptic_wall.controller.detector.half_cycles import Repeated

_AMPLITUDE, _COUNTS = 0.02, 0.6
"""Largest difference of amplitudes, relative, or in encoder counts."""
_DURATION, _PERIODS = 0.03, 2.1
"""Largest difference of durations, relative, or in periods."""


class Steadiness:
    """Counts the repetitions of one motion, each compared to the first one of its direction.

    Attributes:
        count: Consecutive repetitions.
    """

    __slots__ = ("_amplitude", "_counts", "_duration", "_periods", "count")

    def __init__(self, period: float, position_step: float) -> None:
        """Start with none.

        Args:
            period: T [s].
            position_step: Encoder count [rad]; 0: none.
        """
        self._counts = _COUNTS * position_step
        self._periods = _PERIODS * period
        self._amplitude = [0.0, 0.0]
        self._duration = [0.0, 0.0]
        self.count = 0

    def take(self, motion: Repeated) -> None:
        """Count the half-cycle that has just ended, or restart with it."""
        way = motion.known & 1
        if self.count > 1:
            first, lasted = self._amplitude[way], self._duration[way]
            if abs(motion.amplitude - first) <= max(_AMPLITUDE * first, self._counts) and abs(
                motion.duration - lasted
            ) <= max(_DURATION * lasted, self._periods):
                self.count += 1
                return
            self.count = 0
        self._amplitude[way], self._duration[way] = motion.amplitude, motion.duration
        self.count += 1
