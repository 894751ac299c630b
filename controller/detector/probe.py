"""Probes the wall: compares a motion on a softer wall with the same motion before."""

from __future__ import annotations

import math
from enum import IntEnum

from haptic_wall.controller.detector.evidence import (
    NEVER,
    Answer,
    Sighting,
    alike,
    as_unsure,
    is_clear,
    took_longer,
)
from haptic_wall.controller.detector.half_cycles import Repeated
from haptic_wall.controller.detector.tuning import Tuning


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
    DOUBTFUL = 5
    """It became longer, but so unevenly, or by so much, that a second probe must confirm it."""


class Probe:
    """Judges the half-cycles, or the contacts, since the wall was made softer.

    Attributes:
        before: The motion before the probe.
    """

    __slots__ = (
        "_contacts",
        "_count",
        "_doubted",
        "_fading",
        "_first",
        "_still",
        "_threshold",
        "_tuning",
        "_unsure",
        "before",
    )

    def __init__(self, threshold: float, tuning: Tuning, *, contacts: bool) -> None:
        """Start without a probe.

        Args:
            threshold: Amplitude from which a regular motion is probed [rad].
            tuning: Numbers of the detector.
            contacts: Contacts with a one-sided wall are probed, not half-cycles.
        """
        self._threshold = threshold
        self._tuning = tuning.probe
        self._still = tuning.half_cycles.still
        self._contacts = contacts
        self._count = 0
        self._first = self._fading = 0.0
        self._unsure: tuple[Answer, Sighting] | None = None
        self._doubted: tuple[Answer, Sighting] | None = None
        self.before = NEVER

    def begin(self, motion: Repeated, *, within: bool) -> None:
        """Start: the wall has just been made softer.

        Args:
            motion: The motion until now.
            within: A half-cycle has begun before; its length is no evidence if that is long ago.
        """
        late = motion.elapsed > self._tuning.early * motion.duration
        self._count = -1 if within and late else 0

    def still(self, motion: Repeated) -> bool:
        """Whether the motion has stopped: no turning point comes any more."""
        return motion.elapsed > self._still * max(motion.interval, 0.5 * self.before.cycle)

    def ended(self, motion: Repeated, now: Sighting) -> Verdict:
        """Judge the end of a half-cycle.

        Args:
            motion: Motion that contains that half-cycle.
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
            tuning = self._tuning
            if now.amplitude < tuning.load_all * self._fading:
                return Verdict.STOPPED
            fades = motion.amplitude <= tuning.load_each * motion.amplitude_2
            if not fades or self._count > tuning.load_half_cycles:
                return Verdict.HAND
        return Verdict.OPEN

    def _both(self, answer: Answer, amplitude: float) -> Verdict:
        """Judge the first two half-cycles, with their mean amplitude [rad]."""
        tuning, before = self._tuning, self.before
        longer = took_longer(answer, tuning, contacts=self._contacts)
        another = answer.second >= tuning.longest and not self._contacts
        doubtful = longer or (another and answer.first > tuning.first)
        if self._twice_unsure(answer) or self._confirms(answer, doubtful=doubtful):
            return Verdict.WALL
        if longer and is_clear(answer, tuning, contacts=self._contacts):
            return Verdict.WALL
        if doubtful:
            self._doubted = answer, before
            return Verdict.DOUBTFUL
        if answer.amplitude < tuning.collapsed:
            return Verdict.STOPPED if answer.first > tuning.quicker else Verdict.CHANGED
        if another:
            return Verdict.CHANGED
        fast = before.cycle * tuning.load_hz < 1.0
        if self._contacts or not fast or before.amplitude <= tuning.load_size * self._threshold:
            return Verdict.HAND
        self._fading = amplitude  # it may be a load that swings on its transmission
        return Verdict.OPEN

    def _confirms(self, answer: Answer, *, doubtful: bool) -> bool:
        """Whether a probe of this motion had a doubtful answer, and this one is so, too, or alike.

        Args:
            answer: Of this probe.
            doubtful: Whether this answer alone would be doubtful.
        """
        if self._doubted is None:
            return False
        last, before = self._doubted
        tuning = self._tuning
        window = max(tuning.confirmed_s, tuning.confirmed_cycles * before.cycle)
        if (
            self.before.at - before.at > window
            or abs(math.log(self.before.cycle / before.cycle)) > tuning.confirmed_period
        ):
            return False
        alike = abs(math.log(answer.second / last.second)) < tuning.unsure_alike
        return doubtful or (alike and abs(answer.inertia - last.inertia) < tuning.unsure_alike)

    def _twice_unsure(self, answer: Answer) -> bool:
        """Whether the last probe of this motion had the same doubtful answer."""
        last, self._unsure = self._unsure, (answer, self.before)
        return (
            last is not None
            and not self._contacts
            and as_unsure(answer, last[0], self._tuning)
            and alike(self.before, last[1], self._tuning)
        )
