"""Counts half-cycles that repeat more regularly than a hand can make them."""

from __future__ import annotations

from haptic_wall.controller.detector.half_cycles import Repeated
from haptic_wall.controller.detector.tuning import SteadinessTuning


class Steadiness:
    """Counts the repetitions of one motion, each compared to the first one of its direction.

    Attributes:
        count: Consecutive repetitions.
    """

    __slots__ = ("_amplitude", "_counts", "_duration", "_periods", "_tuning", "count")

    def __init__(self, period: float, position_step: float, tuning: SteadinessTuning) -> None:
        """Start with none.

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
        """Count the half-cycle that has just ended, or restart with it."""
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
