"""Compares a motion on a softer wall with the same motion before, and keeps the answers."""

from __future__ import annotations

from enum import IntEnum

from haptic_wall.controller.detector.regularity import NEVER, Regularity, apart, sighting
from haptic_wall.controller.detector.tuning import TUNING


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
    """Judges the first two half-cycles, or contacts, since the wall was made softer.

    Attributes:
        before: The motion before the probe; ``NEVER``: none is known.
        since: When that motion began [s].
    """

    def __init__(self) -> None:
        """Start without a probe."""
        self._count = self._stops = 0
        self._first = self.since = 0.0
        self.before = self._hand = self._stop = NEVER

    def take_up(self, seen: Regularity, at: float) -> None:
        """Store a motion on the whole wall, seen at a time [s], before an alarm or a probe."""
        self.since = seen.since
        self.before = sighting(seen.motion.last, at)

    def begin(self) -> None:
        """Start: the wall has just been made softer."""
        self._count = 0

    def forget(self) -> None:
        """Discard the answers so far."""
        self._hand = self._stop = NEVER

    def found_hand(self, at: float) -> None:
        """Remember that a hand makes the motion, ``at`` a time [s]."""
        self._hand = self.before._replace(at=at)

    @property
    def like_hand(self) -> bool:
        """Whether the last hand that a probe found made a motion like the one taken up."""
        hand, now = self._hand, self.before
        return (
            hand is not NEVER
            and apart(now.cycle, hand.cycle) < TUNING.other_period
            and now.amplitude < TUNING.other_amplitude * hand.amplitude
        )

    def held_off(self, at: float) -> bool:
        """Whether a probe found a hand not long before a time [s]."""
        return at - self._hand.at < TUNING.held_off_s

    def stopped(self, at: float, *, large: bool) -> bool:
        """Remember that the motion has stopped in the probe; return whether it was the wall's.

        It was if it returns and stops again, or after several stops of large motions.

        Args:
            at: Time now [s].
            large: The motion was above the threshold.
        """
        before, last = self.before, self._stop
        recent = at - last.at < TUNING.again_s
        again = (
            recent
            and apart(before.cycle, last.cycle) < TUNING.same_period
            and apart(before.amplitude, last.amplitude) < TUNING.same_amplitude
        )
        self._stops = self._stops + 1 if recent else 1
        if again or (self._stops >= TUNING.stops and large):
            self._stops = 0
            return True
        self._stop = before._replace(at=at)
        return False

    def still(self, seen: Regularity) -> bool:
        """Whether the motion has stopped: no turning point comes any more."""
        motion = seen.motion
        return motion.elapsed > TUNING.still * max(motion.interval, 0.5 * self.before.cycle)

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
        now, before = sighting(seen.motion.last, at), self.before
        inertia = now.inertia / before.inertia if before.inertia else 0.0
        amplitude = now.amplitude / before.amplitude
        if self._longer(ratio, inertia, amplitude, contacts=seen.contacts):
            return Verdict.WALL
        if amplitude < TUNING.collapsed:
            return Verdict.STOPPED if self._first > TUNING.quicker else Verdict.CHANGED
        if ratio >= TUNING.largest and not seen.contacts:
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
        first = self._first
        largest, heaviest = TUNING.largest, TUNING.heaviest_probed
        if contacts:
            long = min(first, second) > TUNING.contact and first + second > TUNING.contacts
            largest, heaviest = TUNING.largest_contact, TUNING.heaviest_contact
        elif inertia > TUNING.explained and amplitude < TUNING.grown:
            long = min(first, second) > TUNING.explained_each
            long = long and first + second > TUNING.explained_both
        else:
            long = first > TUNING.first and second > TUNING.second and first + second > TUNING.both
        explained = TUNING.lightest_probed < inertia < heaviest
        return long and max(second, amplitude) < largest and explained
