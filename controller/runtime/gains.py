"""Owns the commanded stiffness and damping, and moves them along ramps.

On the way down no pair of both may be unstable that need not be. At a lower K the stable dampings
are one interval up to the ceiling, so K goes down first, and then B. Where B is above the ceiling
of what is allowed now, the stable stiffnesses may not begin at 0: both then go down together.

Two things decide them: the guard's decision for the present sample age and interval, and whether
the shaft is where K may be raised.
"""

from __future__ import annotations

import math

from haptic_wall.controller.guard.schedule import GainSchedule, GainTable
from haptic_wall.controller.laws.wall import Law


class Gains:
    """Sets stiffness and damping of the law; the oscillation watch sets their scales.

    Args:
        schedule: The guard's decisions by sample age and served interval.
        law: The rendered law.
        ramp_ticks: Duration of a ramp to a lower stiffness [ticks].

    Attributes:
        stiffness: At the end of the ramp, without scale [N·m/rad].
        damping: At the end of the ramp, without scale [N·m·s/rad].
        highest: Largest stiffness of the table [N·m/rad].
        in_force: The warm-up is over.
        schedule: The gain schedule.
    """

    def __init__(self, schedule: GainSchedule, law: Law, ramp_ticks: int) -> None:
        self.schedule = schedule
        self._law = law
        self._ramp_ticks = ramp_ticks
        self.highest = schedule.table.highest
        self._most = math.inf  # while a change waits that lowers K
        self._ramp_left = self._damping_wait = self._damping_left = 0
        self._stiffness_step = self._damping_step = 0.0
        self._pending = False  # an increase that waits for a moment at rest
        self.stiffness = self.damping = 0.0
        self.in_force = False

    @property
    def coming(self) -> float:
        """Return the stiffness with which the wall would come on [N·m/rad]."""
        if not self.in_force:
            return self.schedule.allowed.stiffness
        return max(self._law.stiffness, self.stiffness)

    def begin(self) -> None:
        """End the warm-up: the decision for the ages measured so far is in force at once."""
        self.schedule.settle()
        allowed, law = self.schedule.allowed, self._law
        if law.guarded:
            law.stiffness = allowed.stiffness
            law.damping = allowed.damping
        self.stiffness = allowed.stiffness
        self.damping = allowed.damping
        self.in_force = True

    def follow(self, age_ns: int, interval_ns: int, may_raise: bool) -> bool:
        """Count a tick's age and interval; move stiffness and damping along their ramp.

        Args:
            age_ns: Age of the sample when its torque was sent [ns].
            interval_ns: Interval from the last tick with a reading to this one [ns]; 0: this
                reading failed.
            may_raise: K may go up now.

        Returns:
            Whether the decision has changed and is in force.
        """
        changed = self.schedule.observe(age_ns, interval_ns, may_raise) and self.in_force
        law = self._law
        if changed:
            if law.guarded:
                self._begin_ramp(may_raise)
        elif self._pending and may_raise and not (self._ramp_left or self._damping_left):
            self._pending = False
            allowed = self.schedule.allowed
            self.stiffness = min(allowed.stiffness, self._most)
            self.damping = allowed.damping
            self._ramp_left = self._damping_left = 1
        if self._ramp_left:
            self._ramp_left -= 1
            if self._ramp_left:
                law.stiffness += self._stiffness_step
            else:
                law.stiffness = self.stiffness
        if self._damping_wait:
            self._damping_wait -= 1
        elif self._damping_left:
            self._damping_left -= 1
            if self._damping_left:
                law.damping += self._damping_step
            else:
                law.damping = self.damping
        return changed

    def lower(self, stiffness: float) -> None:
        """Lower K to at most ``stiffness`` [N·m/rad] along a ramp, and keep it there."""
        if stiffness != self._most:
            self._most = stiffness
            self._begin_ramp(may_raise=False)

    def release(self) -> None:
        """End ``lower``: K returns where it may be raised."""
        if self._most < math.inf:
            self._most = math.inf
            self._begin_ramp(may_raise=False)

    def take(self, law: Law, table: GainTable) -> None:
        """Command another law, or the same one by another table, from now on.

        Args:
            law: Its state is that of the law before.
            table: Replaces that of the schedule.
        """
        self._law = law
        self.schedule.take(table)
        self.highest, self._most = table.highest, math.inf
        self._ramp_left = self._damping_left = self._damping_wait = 0
        self._pending = False
        allowed = self.schedule.allowed
        self.stiffness = law.stiffness = allowed.stiffness
        self.damping = law.damping = allowed.damping

    def _begin_ramp(self, may_raise: bool) -> None:
        """Start a ramp to the gains that are allowed from now on."""
        law, ticks = self._law, self._ramp_ticks
        # K is raised only while the spring is at rest, so at once: a ramp could continue into
        # contact. A longer delay may also allow more: it allows less damping, which leaves more of
        # the torque limit to the spring's encoder steps. K stays until a moment of rest.
        allowed = self.schedule.allowed
        stiffness, damping = min(allowed.stiffness, self._most), allowed.damping
        self._pending = stiffness > law.stiffness and not may_raise
        if self._pending:
            stiffness, damping = law.stiffness, min(damping, law.damping)
        self.stiffness, self.damping = stiffness, damping
        fall = law.stiffness - stiffness
        if fall < 0.0:
            ticks = 1
        elif self._ramp_left and self._stiffness_step < 0.0:
            # A new reason to lower K does not slow down a ramp that is under way.
            ticks = min(ticks, max(1, math.ceil(fall / -self._stiffness_step)))
        above = law.damping > allowed.ceiling
        self._ramp_left = self._damping_left = ticks
        self._damping_wait = 0 if above or fall <= 0.0 else ticks
        self._stiffness_step = (stiffness - law.stiffness) / ticks
        self._damping_step = (damping - law.damping) / ticks
