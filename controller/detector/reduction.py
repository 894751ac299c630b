"""Judges a motion on reduced walls: it dies, needs softer walls, or must end the run."""

from __future__ import annotations

from enum import IntEnum

from haptic_wall.controller.detector.regularity import (
    Regularity,
    Sighting,
    beyond_hands,
    lasts,
    sighting,
)
from haptic_wall.controller.detector.settings import WatchSettings
from haptic_wall.controller.detector.tuning import TUNING


class Cause(IntEnum):
    """Why the walls were reduced."""

    LONGER = 0
    """A half-cycle became longer in the probe."""
    STOPPED = 1
    """The motion stopped in the probe, returned, and stopped again."""
    BEYOND_HANDS = 2
    """No hand moves a shaft so fast, so sharply, or so regularly."""


class Course(IntEnum):
    """The course of a motion on reduced walls."""

    OPEN = 0
    """It is not known yet."""
    DIED = 1
    """It is over, or too small."""
    DIES = 2
    """It becomes smaller."""
    PERSISTS = 3
    """It goes on."""
    SOFTEN = 4
    """It goes on, and the walls may become softer."""
    END = 5
    """It goes on, the wall certainly makes it, and softer walls do not help."""


class Reduction:
    """The reduction of all walls of a run because of one motion.

    Attributes:
        cause: Its reason.
        step: Number of its steps so far.
        count: Half-cycles of the motion since the last step, or since another one died.
    """

    def __init__(self) -> None:
        """Start without a reduction."""
        self.cause = Cause.STOPPED
        self.step = self.count = 0
        self._begun = 0.0
        self._small = False

    def begin(self, cause: Cause, begun: float, *, small: bool) -> None:
        """Take the first step.

        Args:
            cause: Its reason.
            begun: When the motion began on the whole wall [s].
            small: The motion is below the threshold.
        """
        self.cause, self._begun, self._small = cause, begun, small
        self.step, self.count = 1, 0

    def go_on_with(self, at: float) -> None:
        """Judge the motion of another axis from now on, ``at`` [s]: it was never probed."""
        self.cause, self._small = Cause.STOPPED, False
        self.restart(at)

    def restart(self, at: float) -> None:
        """Give the next motion its own time, from ``at`` on [s], and its own evidence."""
        self._begun, self.count = at, 0

    def further(self) -> None:
        """Take the next step."""
        self.step += 1
        self.count = 0

    def judge(
        self,
        seen: Regularity,
        before: Sighting,
        settings: WatchSettings,
        at: float,
        *,
        softest: bool,
        slowest: float,
        alone: bool,
    ) -> Course:
        """Judge the motion, whose last half-cycle has just ended.

        Args:
            seen: The motion.
            before: That on the whole wall.
            settings: Those of the watch.
            at: Time now [s].
            softest: The load would push through softer walls.
            slowest: Period of the slowest motion that the wall may make [s].
            alone: The run has no other axis. A hand that taps an arm keeps the motion of its links
                going.
        """
        last, size = seen.motion.last, seen.size
        large = size >= settings.threshold
        self.count += 1
        if not large and seen.goes_on(settings.small):
            self._small = True
        if size < (settings.small if self._small else settings.threshold):
            return Course.DIED
        if self.count < 2 or len(last) < 4:
            return Course.OPEN
        shrinks = last[3].amplitude < TUNING.dying * last[1].amplitude
        if shrinks and last[2].amplitude <= last[0].amplitude:
            return Course.DIES
        if self._small and large:
            self._small = False  # it has become a large motion, whose time begins now
            self._begun = at
        if self._small and not (lasts(last) and self.count >= TUNING.steady):
            return Course.OPEN
        enough = 1 if alone else TUNING.regular_long
        softest = softest or self.step >= TUNING.steps
        longest = min(TUNING.cycles * slowest, TUNING.longest_s)
        late = not seen.contacts and at - self._begun > longest
        if large and (softest or late) and self._own(seen, before, enough):
            feeds = not seen.contacts or seen.motion.gain > TUNING.reduced_gain
            ends = feeds and self.count >= TUNING.reduced_half_cycles
            return Course.END if ends else Course.PERSISTS
        return Course.PERSISTS if softest else Course.SOFTEN

    def _own(self, seen: Regularity, before: Sighting, enough: int) -> bool:
        """Whether the wall certainly makes this motion; ``enough``: regular half-cycles."""
        if self.cause == Cause.STOPPED:
            return seen.steady
        last = seen.motion.last
        inertia = sighting(last, 0.0).inertia
        least, most = TUNING.lightest_probed, TUNING.heaviest_probed
        explained = least * before.inertia < inertia < most * before.inertia
        if self.cause == Cause.LONGER:
            return explained and seen.streak >= enough
        return explained or seen.steady or (not seen.contacts and beyond_hands(last))
