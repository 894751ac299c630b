"""Executes one period from start to end: sample, render, delay, check, write, report."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from haptic_wall.controller.laws.delay import DelayRing
from haptic_wall.controller.laws.engagement import Engagement
from haptic_wall.controller.laws.wall import Law
from haptic_wall.controller.runtime.change import Change
from haptic_wall.controller.runtime.changeover import Changeover, Obstacle, Target, adopt
from haptic_wall.controller.runtime.gains import Gains
from haptic_wall.controller.runtime.handover import Inbox
from haptic_wall.controller.runtime.missed import MissedPeriods
from haptic_wall.controller.runtime.motion_watch import MotionWatch
from haptic_wall.controller.runtime.safety import Safety, Trip
from haptic_wall.controller.runtime.sampler import Sampler
from haptic_wall.controller.runtime.telemetry import (
    FLAG_CHANGED,
    FLAG_CONTACT,
    FLAG_OFF,
    FLAG_RAISED,
    FLAG_SATURATED,
    FLAG_WARM_UP,
    Row,
    Telemetry,
    Word,
)
from haptic_wall.hw.clock import Clock
from haptic_wall.hw.servo import Bus, Outcome, Servo

_OK = Outcome.OK  # looking up an enum member is slow: a plain name is many times faster
_WAITING = Outcome.WAITING
_HEARTBEAT_NS, _CUT = int(Word.HEARTBEAT_NS), int(Word.CUT)
_TICKS, _MISSED, _RAISE = int(Word.TICKS), int(Word.MISSED), int(Word.RAISE)
_HELD_NS, _HEAD = int(Word.HELD_NS), int(Word.HEAD)
_OFFSET_NS, _WAITED_NS = int(Word.OFFSET_NS), int(Word.WAITED_NS)
_OFFERED, _WITHDRAWN = int(Word.OFFERED), int(Word.WITHDRAWN)


@dataclass(frozen=True, slots=True)
class TickParts:
    """All parts of a tick."""

    clock: Clock
    servo: Servo
    law: Law
    sampler: Sampler
    gains: Gains
    ring: DelayRing
    safety: Safety
    missed: MissedPeriods
    trips_on_missed: bool
    """Too many missed periods end the run; else they only lower stiffness and damping"""
    motion: MotionWatch
    telemetry: Telemetry
    wall_from_start: bool
    """The wall's position counts from the first reading"""
    engagement: Engagement
    """Decides when the wall may come on"""
    inbox: Inbox
    """Changes of the running wall"""
    changeover: Changeover
    """Finds the tick for a change"""


class Tick:
    """Executes the steps of a period in order; holds its trip and its counters.

    Attributes:
        trip: Why the run must end; None: no trip. Once set, no torque is sent.
        done: The program is over; the torque of the last period was zero.
        came_on: The wall has been on at least once.
        ticks: Periods executed.
        missed: Whole periods skipped.
    """

    def __init__(self, parts: TickParts) -> None:
        self._parts = parts
        self._now = parts.clock.now_ns
        self._words = parts.telemetry.words
        self._row = Row()
        self._limit = parts.servo.facts.torque_limit
        self._bus = parts.servo.bus or Bus()
        self._work_ns = 0
        self._bus_ns = 0
        self._offset = self._words[_OFFSET_NS]  # of an elastic clock, as last seen [ns]
        self._waited = 0  # likewise
        self._raises = self._words[Word.RAISE]
        self._delay_s = 0.0
        self._started_at = 0.0  # added to the positions of laws [rad]
        self._on = False  # the wall acts
        self.came_on = False
        self.trip: Trip | None = None
        self.done = False
        self.ticks = 0
        self.missed = 0
        parts.sampler.request_ahead()

    def wall_on(self) -> None:
        """End the warm-up: the guard's decision for the measured ages is in force at once."""
        self._parts.gains.begin()
        self._follow_gains()

    @property
    def parts(self) -> TickParts:
        """Return the parts; a change replaces some."""
        return self._parts

    def _follow_gains(self) -> None:
        """Use the delay of the present decision."""
        parts = self._parts
        self._delay_s = parts.gains.decision.delay
        parts.motion.follow_gains()

    @property
    def warm_up(self) -> bool:
        """Whether the warm-up is on: the torque is zero, and only the delay is measured."""
        return not self._parts.gains.in_force

    @property
    def commanded(self) -> tuple[float, float]:
        """Return the rendered stiffness [N·m/rad] and damping [N·m·s/rad].

        Ramps count as complete. Probes are excluded: one takes most of K for a cycle.
        """
        parts = self._parts
        gains = parts.gains
        scale, damping_scale = parts.motion.watch.backstop.reduced
        return gains.stiffness * scale, gains.damping * damping_scale

    @property
    def position(self) -> float:
        """Return the last known position of the shaft [rad]; NaN: none is known yet."""
        return self._parts.sampler.position

    def may_engage(self) -> bool:
        """Whether the wall would come on with the next reading, if that equals the last one."""
        return self._parts.engagement.ready and self.held()

    def held(self) -> bool:
        """Whether the dead man is held, or there is none."""
        return self._now() <= self._words[_HELD_NS]

    def run(self, deadline_ns: int, woke_ns: int, missed: int) -> None:
        """Serve one deadline.

        Args:
            deadline_ns: The deadline served [ns].
            woke_ns: When the loop woke for it [ns].
            missed: Whole periods skipped since the last tick.
        """
        words, row = self._words, self._row
        periods = 1 + missed
        # Reported is real time, whatever an elastic clock takes out.
        row.lateness_ns = woke_ns - deadline_ns + words[_OFFSET_NS] - self._offset
        self._offset, self._waited = words[_OFFSET_NS], words[_WAITED_NS]

        self._sample(woke_ns)
        change = self._parts.inbox.change
        flags = 0 if change is None else self._change(change)
        parts = self._parts
        servo, law, sampler, motion = parts.servo, parts.law, parts.sampler, parts.motion
        position, sampled_ns = sampler.position, sampler.sampled_ns

        wall_torque = 0.0
        contact = law.in_contact(position)
        if missed:
            self._count_missed(deadline_ns, missed)
        on = (self._on and woke_ns <= words[_HELD_NS]) or self._engage(woke_ns)
        if not on:
            flags |= FLAG_WARM_UP if self.warm_up else FLAG_OFF
        elif sampled_ns is not None:
            found = motion.update(sampler, contact, periods)
            self.trip = self.trip or found
            wall_torque = law.torque(position, sampler.damped)
        if contact:
            flags |= FLAG_CONTACT
        torque = parts.ring.push(wall_torque, periods)
        torque = self._checked(torque)
        if abs(torque) > self._limit or abs(torque) >= law.clip:
            flags |= FLAG_SATURATED
        if words[_CUT]:
            return  # the supervisor has taken the bus: write nothing more
        # From sending the request to sending the torque: both have the same travel time, which
        # therefore is no part of the age.
        sent_ns = self._now()
        sent = servo.write(torque)
        motion.watch.sent(sent)
        sampler.request_ahead()

        age_ns = 0
        # To the next tick with a sample: a tick with a lost reading is part of the interval.
        interval_ns = sampler.interval_ns(woke_ns)
        if sampled_ns is not None:
            age_ns = sent_ns - sampled_ns
            may_raise = not contact or not on or self._may_rise()
            flags |= self._follow_guard(age_ns, interval_ns, may_raise)
        row.deadline_ns = deadline_ns
        row.age_ns = age_ns
        row.missed = missed
        row.flags = flags
        row.wall_torque = wall_torque
        row.torque = sent
        self._write_row()
        self.done = law.done
        if words[_OFFERED] != parts.inbox.taken:
            parts.inbox.take()
        self._end(woke_ns, missed)

    def _end(self, woke_ns: int, missed: int) -> None:
        """Count the tick and its time."""
        words = self._words
        self.ticks = words[_TICKS] = self.ticks + 1
        self.missed = words[_MISSED] = self.missed + missed
        bus_ns = self._bus.waited_ns
        words[_HEARTBEAT_NS] = ended_ns = self._now()
        self._work_ns = ended_ns - woke_ns - bus_ns
        if (offset := words[_OFFSET_NS]) != self._offset:  # elastic, in this tick
            waited_ns = words[_WAITED_NS] - self._waited
            bus_ns += waited_ns
            self._work_ns += offset - self._offset - waited_ns
            self._offset = offset
        self._bus_ns = bus_ns

    def _write_row(self) -> None:
        """Fill the row with the parts' values, and write it."""
        parts, row = self._parts, self._row
        law, sampler = parts.law, parts.sampler
        row.work_ns = self._work_ns
        row.bus_ns = self._bus_ns
        row.outcome = sampler.outcome
        row.sampled_ns = sampler.sampled_ns or 0
        row.position = sampler.position
        row.velocity = sampler.velocity
        row.measured_torque = sampler.measured_torque
        row.phase = law.phase
        row.oscillation = parts.motion.watch.current
        row.stiffness = law.stiffness * law.derating.scale
        row.damping = (law.damping + law.injected) * law.derating.damping_scale
        row.held_torque = law.held
        row.delay_s = self._delay_s
        parts.telemetry.write(row)

    def _sample(self, woke_ns: int) -> None:
        """Take the reading, and check it."""
        parts = self._parts
        sampler = parts.sampler
        reading = sampler.sample(woke_ns)
        if sampler.outcome is _OK:
            self.trip = parts.safety.good(reading)
            if sampler.first and parts.wall_from_start and self.trip is None:
                self._started_at = sampler.position
                parts.law.position += sampler.position
        elif sampler.outcome is not _WAITING:
            self.trip = parts.safety.failed(self._now())

    def _change(self, change: Change) -> int:
        """Make the change at hand, if this is the tick for it.

        Returns:
            ``FLAG_CHANGED`` where it is in force from this tick on; else 0.
        """
        parts = self._parts
        inbox, gains = parts.inbox, parts.gains
        if self.trip is not None or self._words[_WITHDRAWN] >= change.number:
            gains.release()
            parts.changeover.restart()
            inbox.settle(-1, 0)
            return 0
        obstacle = self._obstacle(change)
        if obstacle is not Obstacle.NONE:
            inbox.waits(obstacle, parts.changeover.size)
            return 0
        self._make(change)
        inbox.settle(self._words[_HEAD], gains.index)
        return FLAG_CHANGED

    def _obstacle(self, change: Change) -> Obstacle:
        """Return the obstacle to making a change in this tick."""
        parts = self._parts
        sampler, gains, changeover = parts.sampler, parts.gains, parts.changeover
        if not self.came_on:
            return Obstacle.NOT_ON
        if sampler.outcome is not _OK:
            return Obstacle.READING
        if not change.placed:
            change.placed = True
            if change.law is not None:
                change.law.position += self._started_at
        decision = gains.schedule.present(change.rows)
        softer = change.softer and decision.stiffness <= gains.stiffness
        obstacle = changeover.watched(parts.motion.watch, softer)
        if obstacle is not Obstacle.NONE or not self._on:
            return obstacle
        target = Target(
            law=change.law or parts.law,
            stiffness=decision.stiffness,
            damping=decision.damping,
            delay=max(decision.delay, self._delay_s),
            steps=change.steps,
        )
        obstacle = changeover.obstacle(
            parts.law, parts.ring, target, sampler.position, sampler.damped
        )
        falls = decision.stiffness < gains.stiffness
        if obstacle is not Obstacle.NONE and falls and not change.moved:
            gains.lower(decision.stiffness)
        return obstacle

    def _make(self, change: Change) -> None:
        """Render, command and watch as the change asks for, from this tick on."""
        parts = self._parts
        law, ring, position = parts.law, parts.ring, parts.sampler.position
        before = law.position
        if change.steps != ring.steps:
            coming = law.torque(position, parts.sampler.damped) if self._on else 0.0
            ring = ring.resized(change.steps, self._row.wall_torque, coming)
        if change.law is not None:
            adopt(change.law, law)
            law = change.law
            law.settle(position)
        parts.gains.take(law, change.rows, change.highest)
        parts.motion.change(
            law,
            position,
            change.injected,
            change.watch,
            law.position - before,
        )
        if not self._on:
            parts.engagement.restart()
        self._parts = replace(parts, law=law, ring=ring)
        parts.changeover.restart()
        self._follow_gains()

    def _engage(self, woke_ns: int) -> bool:
        """Record that the wall is off; return whether it comes on in this tick."""
        parts = self._parts
        gate, law, sampler = parts.engagement, parts.law, parts.sampler
        if self._on:
            self._on = False
            gate.restart()
            parts.ring.clear()
            law.settle(sampler.position)  # what it has stored is lost with its torque
        if sampler.known:  # with slow replies the last position counts
            gate.sample(parts.gains.coming, law.elongation(sampler.position))
        if self.warm_up or not gate.ready or woke_ns > self._words[_HELD_NS]:
            return False
        if self.came_on:
            parts.motion.resume()
        law.settle(sampler.position)
        self._on = self.came_on = True
        return True

    def _may_rise(self) -> bool:
        """Whether K may rise by the largest possible amount although the shaft is in contact."""
        parts = self._parts
        elongation = parts.law.elongation(parts.sampler.position)
        return parts.engagement.may_rise(parts.gains.largest_rise, elongation)

    def _checked(self, torque: float) -> float:
        """Return the torque that may be sent [N·m]: zero after a trip."""
        if self.trip is None and not math.isfinite(torque):
            self.trip = Trip.NOT_A_NUMBER
        return torque if self.trip is None else 0.0

    def _count_missed(self, deadline_ns: int, missed: int) -> None:
        """Count periods without a tick; too many may end the run."""
        parts = self._parts
        if self.warm_up or self.trip is not None:
            return
        if parts.missed.count(deadline_ns, missed) and parts.trips_on_missed:
            self.trip = Trip.MISSED_PERIODS

    def _follow_guard(self, age_ns: int, interval_ns: int, may_raise: bool) -> int:
        """Let the gains follow the guard's present decision.

        Returns:
            ``FLAG_RAISED`` where the return to the full wall was requested; else 0.
        """
        parts = self._parts
        asked = 0
        if self._words[_RAISE] != self._raises:
            self._raises = self._words[_RAISE]
            asked = FLAG_RAISED
            parts.motion.watch.raise_again()
        if parts.gains.follow(age_ns, interval_ns, may_raise):
            self._follow_gains()
        return asked
