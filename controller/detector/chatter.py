"""Finds a torque that jumps from limit to limit faster than a hand makes it.

A vibration of a link may stay below an encoder count, so that the motion has no turning points.
"""

from __future__ import annotations

import math

from haptic_wall.controller.detector.settings import WatchSettings

_AT_LIMIT = 0.98
"""Part of the limit from which the torque counts as limited: a servo rounds it [1]"""
_COUNTS = 4.0
"""Encoder counts whose torque a limit must exceed: the encoder's noise reaches a lower one"""


class Chatter:
    """Counts the jumps of the torque between its limits.

    Attributes:
        limit: Torque from which on ``turns`` must be called [N·m]; inf: never.
        count: Number of jumps in a row, each soon after the one before.
    """

    def __init__(self, settings: WatchSettings) -> None:
        """Start without a jump."""
        tuning = settings.tuning
        beyond_noise = settings.torque_limit > _COUNTS * settings.count_torque
        self.limit = _AT_LIMIT * settings.torque_limit if beyond_noise else math.inf
        self._enough, self._longest = tuning.steady, 0.5 / tuning.hands_hz
        self._up = False
        self._turned = self._began = 0.0
        self.count = 0

    @property
    def found(self) -> bool:
        """Whether no hand makes so many."""
        return self.count >= self._enough

    @property
    def cycle(self) -> float:
        """Return the mean period of the jumps, of which there are some [s]."""
        return 2.0 * (self._turned - self._began) / self.count

    def turns(self, torque: float, now: float) -> bool:
        """Take a torque at its limit; return whether the jumps are found with it.

        Args:
            torque: [N·m]
            now: The present time [s].
        """
        if (torque > 0.0) == self._up:
            return False
        self._up = not self._up
        if self.over(now):
            self.count, self._began = 0, now
        else:
            self.count += 1
        self._turned = now
        return self.count > 0 and self.count % self._enough == 0

    def over(self, now: float) -> bool:
        """Whether the last jump is longer ago than a hand's would be [s]."""
        return now - self._turned > self._longest
