"""Counts consecutive half-cycles that are more regular than a hand can make."""

from __future__ import annotations

from haptic_wall.controller.detector.half_cycles import Repeated
from haptic_wall.controller.detector.tuning import SteadinessTuning


class Steadiness:
    """Counts repeated half-cycles: each is compared to the first half-cycle in the same direction.

    Attributes:
        count: Number of consecutive half-cycles of equal amplitude and duration.
    """

    __slots__ = ("_amplitude", "_counts", "_duration", "_periods", "_tuning", "count")

    def __init__(self, period: float, position_step: float, tuning: SteadinessTuning) -> None:
        """Start with a count of zero.

        Args:
            period: T [s].
            position_step: Encoder count [rad]; 0: none.
            tuning: Numbers for steadiness.
        """
        self._counts = tuning.amplitude_counts * position_step
        self._periods = tuning.duration_periods * period
        self._tuning = tuning
        self._amplitude = [0.0, 0.0]
        self._duration = [0.0, 0.0]
        self.count = 0

    def take(self, motion: Repeated) -> None:
        """Count the half-cycle that has just ended; restart the count if it differs."""
        way = motion.known & 1
        if self.count > 1:
            first, lasted = self._amplitude[way], self._duration[way]
            amplitude = max(self._tuning.amplitude * first, self._counts)
            duration = max(self._tuning.duration * lasted, self._periods)
            if (
                abs(motion.amplitude - first) <= amplitude
                and abs(motion.duration - lasted) <= duration
            ):
                self.count += 1
                return
            self.count = 0
        self._amplitude[way], self._duration[way] = motion.amplitude, motion.duration
        self.count += 1
