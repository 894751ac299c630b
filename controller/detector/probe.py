"""A probe of the wall: compares a motion on a softer wall with the same motion before it."""

from __future__ import annotations

from enum import IntEnum

from haptic_wall.controller.detector.evidence import (
    NEVER,
    Answer,
    Sighting,
    alike,
    as_unsure,
    may_be_a_load,
    took_longer,
)
from haptic_wall.controller.detector.half_cycles import Repeated

SAME_PERIOD, SAME_AMPLITUDE = 0.1, 0.5
"""Largest logarithms of the ratios of periods and of amplitudes of one motion at two times"""
STILL = 3.0
"""Turning-point intervals without a turning point after which a motion has stopped [1]"""
_EARLY = 0.15
"""Part of a half-cycle within which a probe has begun at its turning point [1]"""
_FADE_SIZE = 2.5
"""Motions with constant period in a probe and smaller than so many thresholds may be tremor; larger
ones may be a load that swings on its transmission."""
_FADE_EACH, _FADE_ALL, _FADE_LONGEST = 0.985, 0.75, 8
"""Such a motion fades by this ratio in each half-cycle, and in all, within so many half-cycles."""
_COLLAPSED, _QUICKER, _SLOWER = 0.6, 0.8, 3.2
"""Ratio of amplitudes below which a motion has stopped in the probe, and of durations below and
above which it is another one: the wall makes no motion quicker by giving way; under a load that all
but pushes through the probed wall it becomes so slow, a hand's does not."""


class Verdict(IntEnum):
    """The result of a probe."""

    OPEN = 0
    """No result yet"""
    WALL = 1
    """The wall moves the shaft."""
    STOPPED = 2
    """The motion has stopped: no evidence."""
    HAND = 3
    """A hand moves the shaft."""
    CHANGED = 4
    """This is another motion than before."""


class Probe:
    """Judges the half-cycles, or the contacts, since the wall was made softer.

    Attributes:
        before: The motion before the probe.
    """

    __slots__ = ("_contacts", "_count", "_fading", "_first", "_threshold", "_unsure", "before")

    def __init__(self, threshold: float, *, contacts: bool) -> None:
        """No probe has begun.

        Args:
            threshold: Amplitude from which a regular motion is probed [rad].
            contacts: Contacts with a one-sided wall are probed, not half-cycles.
        """
        self._threshold = threshold
        self._contacts = contacts
        self._count = 0
        self._first = self._fading = 0.0
        self._unsure: tuple[Answer, Sighting] | None = None
        self.before = NEVER

    def begin(self, motion: Repeated, *, within: bool) -> None:
        """Start: the wall has just been made softer.

        Args:
            motion: The motion until now.
            within: A half-cycle has begun before; its length is no evidence if that is long ago.
        """
        self._count = -1 if within and motion.elapsed > _EARLY * motion.duration else 0

    def still(self, motion: Repeated) -> bool:
        """Whether the motion has stopped: no turning point comes any more."""
        return motion.elapsed > STILL * max(motion.interval, 0.5 * self.before.cycle)

    def ended(self, motion: Repeated, now: Sighting) -> Verdict:
        """Judge the end of a half-cycle.

        Args:
            motion: With that half-cycle.
            now: The present motion.
        """
        self._count += 1
        before = self.before
        ratio = 2.0 * motion.duration / before.cycle
        if self._count == 1:
            self._first = ratio
        elif self._count == 2:
            inertia = now.inertia / before.inertia if before.inertia else 0.0
            return self._both(
                Answer(self._first, ratio, inertia, now.amplitude / before.amplitude), now.amplitude
            )
        elif self._count > 2:
            if now.amplitude < _FADE_ALL * self._fading:
                return Verdict.STOPPED
            if motion.amplitude > _FADE_EACH * motion.amplitude_2 or self._count > _FADE_LONGEST:
                return Verdict.HAND
        return Verdict.OPEN

    def _both(self, answer: Answer, amplitude: float) -> Verdict:
        """Judge the first two half-cycles, with their mean amplitude [rad]."""
        if took_longer(answer, contacts=self._contacts) or self._twice_unsure(answer):
            return Verdict.WALL
        if answer.amplitude < _COLLAPSED:
            return Verdict.STOPPED if answer.first > _QUICKER else Verdict.CHANGED
        if answer.second >= _SLOWER and not self._contacts:
            return Verdict.CHANGED
        if self._contacts or not may_be_a_load(self.before.cycle):
            return Verdict.HAND
        if self.before.amplitude <= _FADE_SIZE * self._threshold:
            return Verdict.HAND
        self._fading = amplitude
        return Verdict.OPEN

    def _twice_unsure(self, answer: Answer) -> bool:
        """Whether the last probe of this motion had the same doubtful answer."""
        last, self._unsure = self._unsure, (answer, self.before)
        return (
            last is not None
            and not self._contacts
            and as_unsure(answer, last[0])
            and alike(self.before, last[1], SAME_PERIOD, SAME_AMPLITUDE)
        )
