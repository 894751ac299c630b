"""Counts for how long a motion has lasted, and how regular it has been meanwhile."""

from __future__ import annotations

import math
from collections import deque

from haptic_wall.controller.detector.backstop_settings import BackstopSettings
from haptic_wall.controller.detector.evidence import lasts, same_period
from haptic_wall.controller.detector.half_cycles import Repeated
from haptic_wall.controller.detector.steady import Steadiness


class Persistence:
    """Judges a motion at the end of each half-cycle, or contact.

    Attributes:
        steady: It is more regular than a hand's; or it is regular, and must not be probed.
        streak: Number of half-cycles in a row that neither decay nor change their period.
        gentle: Of these, those in a row that hardly grow.
        since: When the streak began [s].
    """

    __slots__ = (
        "_beyond",
        "_enough",
        "_evidence",
        "_largest",
        "_largest_before",
        "_settings",
        "_sizes",
        "_steadiness",
        "_tuning",
        "gentle",
        "since",
        "steady",
        "streak",
    )

    def __init__(self, settings: BackstopSettings) -> None:
        """Start without a motion."""
        tuning = settings.tuning
        self._settings, self._tuning = settings, tuning.backstop
        self._evidence, self._enough = tuning.evidence, tuning.steadiness.half_cycles
        self._steadiness = Steadiness(settings.period, settings.position_step, tuning.steadiness)
        self._sizes: deque[float] = deque(maxlen=self._tuning.loss_half_cycles + 2)
        self._beyond = 0
        self._largest, self._largest_before = 0.0, math.inf
        self.steady = False
        self.streak = self.gentle = 0
        self.since = 0.0

    def take(self, motion: Repeated, at: float) -> None:
        """Judge a motion whose last half-cycle has just ended.

        Args:
            motion: The motion.
            at: Time now [s].
        """
        settings = self._settings
        size = min(motion.amplitude, motion.amplitude_2)
        self._steadiness.take(motion)
        self.steady = self._steadiness.count >= self._enough and size >= settings.small
        regular = same_period(motion, self._evidence)
        even = regular and lasts(motion, self._evidence)
        self.streak = self.streak + 1 if even else 0
        gentle = even and motion.amplitude < self._tuning.gentle * motion.amplitude_3
        self.gentle = self.gentle + 1 if gentle else 0
        if not settings.acts and size >= settings.threshold:
            self.steady = self.steady or self.streak >= settings.unprobed
        self._sizes.append(motion.amplitude)
        if not regular:
            while len(self._sizes) > 4:
                self._sizes.popleft()
        if not self.streak:
            self.since = at - motion.duration - motion.duration_2

    @property
    def dies(self) -> bool:
        """Whether a regular motion has become smaller by more than the encoder's rounding."""
        sizes, tuning = self._sizes, self._tuning
        first, last = 0.5 * (sizes[0] + sizes[1]), 0.5 * (sizes[-1] + sizes[-2])
        cycles = 0.5 * (len(sizes) - 2)
        return first - last > max(
            tuning.loss_counts * self._settings.position_step, tuning.loss * cycles * last
        )

    @property
    def nearly_steady(self) -> bool:
        """Whether it has been steady for half of what no hand is: a probe would disturb it."""
        return not self.steady and 2 * self._steadiness.count > self._enough

    def goes_on(self, amplitude: float, *, beyond_hands: bool) -> bool:
        """Return whether a motion beyond hands persists, regular or not: that of two modes is not.

        Args:
            amplitude: Of the motion [rad].
            beyond_hands: Whether no hand moves a shaft like this.
        """
        if not beyond_hands:
            self._beyond = 0
            self._largest, self._largest_before = 0.0, math.inf
            return False
        self._beyond += 1
        self._largest = max(self._largest, amplitude)
        if self._beyond % self._tuning.beyond_half_cycles:
            return False
        goes_on = self._largest > self._evidence.dying * self._largest_before
        self._largest, self._largest_before = 0.0, self._largest
        return goes_on
