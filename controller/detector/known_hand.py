"""Remembers the last motion that was found to be a hand's."""

from __future__ import annotations

import math

from haptic_wall.controller.detector.evidence import NEVER, Sighting
from haptic_wall.controller.detector.tuning import BackstopTuning


class KnownHand:
    """The last motion that a hand made; there need not be one."""

    __slots__ = ("_motion", "_tuning")

    def __init__(self, tuning: BackstopTuning) -> None:
        """Start without a hand."""
        self._tuning = tuning
        self._motion = NEVER

    def found(self, motion: Sighting, at: float) -> None:
        """Remember a motion; ``at``: the time now [s]."""
        self._motion = motion._replace(at=at)

    def forget(self) -> None:
        """Forget the hand."""
        self._motion = NEVER

    def made(self, seen: Sighting) -> bool:
        """Return whether the hand made a motion like this."""
        hand, tuning = self._motion, self._tuning
        return (
            hand.at > -math.inf
            and abs(math.log(seen.cycle / hand.cycle)) < tuning.other_period
            and seen.amplitude < tuning.other_amplitude * hand.amplitude
        )

    def recent(self, seen: Sighting) -> bool:
        """Return whether the hand made a motion about as large not long ago."""
        hand, tuning = self._motion, self._tuning
        return (
            seen.at - hand.at < tuning.held_off_s
            and seen.amplitude < tuning.other_amplitude * hand.amplitude
        )

    def holds_off(self, seen: Sighting) -> bool:
        """Return whether the hand made a motion like this not long ago: it is not probed."""
        return self.recent(seen) and self.made(seen)
