"""Probes the wall: compares a motion on a softer wall with the same motion before."""

from __future__ import annotations

from enum import IntEnum

from haptic_wall.controller.detector.regularity import (
    NEVER,
    Regularity,
    Sighting,
    apart,
    sighting,
)
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


def alike(one: Sighting, other: Sighting, tuning: Tuning) -> bool:
    """Whether two motions are one and the same."""
    return (
        apart(one.cycle, other.cycle) < tuning.same_period
        and apart(one.amplitude, other.amplitude) < tuning.same_amplitude
    )


class Probe:
    """Judges the first two half-cycles, or contacts, since the wall was made softer.

    Attributes:
        before: The motion before the probe.
    """

    def __init__(self, tuning: Tuning) -> None:
        """Start without a probe."""
        self._tuning = tuning
        self._count = 0
        self._first = 0.0
        self.before = NEVER

    def begin(self) -> None:
        """Start: the wall has just been made softer."""
        self._count = 0

    def still(self, seen: Regularity) -> bool:
        """Whether the motion has stopped: no turning point comes any more."""
        motion = seen.motion
        return motion.elapsed > self._tuning.still * max(motion.interval, 0.5 * self.before.cycle)

    def ended(self, seen: Regularity, at: float) -> Verdict:
        """Judge the end of a half-cycle.

        Args:
            seen: The motion.
            at: Time now [s].
        """
        self._count += 1
        ratio = 2.0 * seen.motion.last[-1].duration / self.before.cycle
        if self._count == 1 or len(seen.motion.last) < 2:
            self._first = ratio
            return Verdict.OPEN
        now, before, tuning = sighting(seen.motion.last, at), self.before, self._tuning
        inertia = now.inertia / before.inertia if before.inertia else 0.0
        amplitude = now.amplitude / before.amplitude
        if self._longer(ratio, inertia, amplitude, contacts=seen.contacts):
            return Verdict.WALL
        if amplitude < tuning.collapsed:
            return Verdict.STOPPED if self._first > tuning.quicker else Verdict.CHANGED
        if ratio >= tuning.largest and not seen.contacts:
            return Verdict.CHANGED
        return Verdict.HAND

    def _longer(self, second: float, inertia: float, amplitude: float, *, contacts: bool) -> bool:
        """Whether the wall moves the shaft: the motion takes longer, and the torque explains it.

        Args:
            second: Duration of the second half-cycle, over half the period before [1].
            inertia: Apparent inertia of the two, over that before [1].
            amplitude: Their amplitude, over that before [1].
            contacts: They were contacts with a one-sided wall.
        """
        tuning, first = self._tuning, self._first
        largest, heaviest = tuning.largest, tuning.heaviest_probed
        if contacts:
            long = min(first, second) > tuning.contact and first + second > tuning.contacts
            largest, heaviest = tuning.largest_contact, tuning.heaviest_contact
        elif inertia > tuning.explained and amplitude < tuning.grown:
            long = min(first, second) > tuning.explained_each
            long = long and first + second > tuning.explained_both
        else:
            long = first > tuning.first and second > tuning.second and first + second > tuning.both
        explained = tuning.lightest_probed < inertia < heaviest
        return long and max(second, amplitude) < largest and explained
