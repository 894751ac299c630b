"""One period, start to end: read, estimate, render, delay, check, write, tell."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from controller.delay import DelayRing
from controller.detector.watch import Watch
from controller.engagement import Engagement
from controller.guard.schedule import GainSchedule
from controller.missed import MissedPeriods
from controller.overspeed import DrivenSpeed
from controller.passivity_control import PassivityControl
from controller.safety import Safety, Trip
from controller.telemetry import (
    FLAG_CONTACT,
    FLAG_OFF,
    FLAG_SATURATED,
    FLAG_WARM_UP,
    Telemetry,
    Word,
)
from controller.velocity import VelocityEstimator
from controller.wall import Law
from hw.clock import Clock
from hw.servo import Outcome, Servo

COLLECT_SHARE = 0.8
"""How much of a period a reply may take before it is given up."""
LONGER_SHARE = 1.05
"""The same after a pipelined reply was lost, until another one is: an adapter hands over what it
holds on a grid of its own. A request sent after giving up can then miss each tick by the time that
it takes itself, for ever. With the one share those are phases of 0.8 to about 0.95 periods, with
the other of 0.05 to 0.2, so that changing it leaves either."""
_OK = Outcome.OK  # members are looked up anew each time: plain names are many times as quick
_WAITING = Outcome.WAITING
_HEARTBEAT_NS, _CUT = int(Word.HEARTBEAT_NS), int(Word.CUT)
_TICKS, _MISSED, _RAISE = int(Word.TICKS), int(Word.MISSED), int(Word.RAISE)
_HELD_NS = int(Word.HELD_NS)
JITTER = 0.1
"""An interval between samples that is this near to whole periods counts as whole [periods]. A
loop that serves a tick every 1.5 periods is far from it: divided by 2, its velocity would leave
a quarter of the damping out."""
SHORTEST = 0.5
"""The shortest interval that a velocity is taken over [periods]: over a very short one, which
follows a late tick, one encoder count would be a high speed."""


@dataclass(frozen=True, slots=True)
class TickParts:
    """Everything a tick works with."""

    clock: Clock
    servo: Servo
    wall: Law
    velocity: VelocityEstimator
    ring: DelayRing
    schedule: GainSchedule
    safety: Safety
    driven: DrivenSpeed
    missed: MissedPeriods
    trips_on_missed: bool
    """Too many missed periods end the run; else they only lower stiffness and damping"""
    watch: Watch
    passivity: PassivityControl | None
    """Puts damping in where the wall gives energy; None: it does not"""
    most_injected: Sequence[float]
    """Damping that may be put in, for each decision of the schedule [N·m·s/rad]"""
    telemetry: Telemetry
    period_ns: int
    ramp_ticks: int
    """Ticks over which a new stiffness is reached [1]"""
    pipelined: bool
    """Requests are sent at the end of the period before"""
    wall_from_start: bool
    """The wall's position counts from the first reading"""
    engagement: Engagement
    """Decides when the wall may come on"""


class Tick:
    """The controller's state between periods.

    Attributes:
        trip: Why the run must end; None while all is well. Once set, no torque was sent.
        done: What was to be rendered is over; the torque of the last period was zero.
        warm_up: While true the torque is zero, and only the delay is measured.
        came_on: The wall has been on at least once.
        ticks: Periods executed.
        missed: Whole periods skipped.
    """

    def __init__(self, parts: TickParts) -> None:
        self._parts = parts
        self._now = parts.clock.now_ns
        self._words = parts.telemetry.words
        self._position = math.nan
        self._sampled_ns: int | None = None
        self._woke_ns = 0  # when the last tick began whose reading did not fail; 0: none
        self._limit = parts.servo.facts.torque_limit
        self._work_ns = 0
        self._bus_ns = 0
        self._outcome = Outcome.OK
        self._measured_torque = math.nan
        self._velocity = 0.0
        self._collect_ns = int(COLLECT_SHARE * parts.period_ns)
        self._other_collect_ns = int(LONGER_SHARE * parts.period_ns)
        self._ramp_left = 0
        self._ramp_stiffness = 0.0
        self._ramp_damping = 0.0
        self._target = 0.0  # stiffness at the end of the ramp
        self._target_damping = 0.0
        self._raises = self._words[Word.RAISE]
        self._owed = False  # the decision in force allows more, which waits for a moment at rest
        self._delay_s = 0.0
        self._on = False  # the wall acts
        self._most_decided = max(decision.stiffness for decision in parts.schedule.decisions)
        self.came_on = False
        self.trip: Trip | None = None
        self.done = False
        self.warm_up = True
        self.ticks = 0
        self.missed = 0
        if parts.pipelined:
            parts.servo.request()

    def wall_on(self) -> None:
        """End the warm-up: the guard's decision for the measured ages is in force at once."""
        parts = self._parts
        parts.schedule.settle()
        decision = parts.schedule.decision
        if parts.wall.guarded:
            parts.wall.stiffness = decision.stiffness
            parts.wall.damping = decision.damping
        self._target = decision.stiffness
        self._target_damping = decision.damping
        self._take_delay()
        self.warm_up = False

    def _take_delay(self) -> None:
        """Count with the delay that the schedule has found."""
        parts = self._parts
        self._delay_s = parts.schedule.decision.delay
        parts.watch.set_age(parts.schedule.age_ns * 1e-9)
        if parts.passivity is not None:
            parts.passivity.cap = parts.most_injected[parts.schedule.index]

    @property
    def commanded(self) -> tuple[float, float]:
        """Stiffness [N·m/rad] and damping [N·m·s/rad] that are rendered.

        Ramps are at their end. A probe is left out: it takes half of K for a cycle.
        """
        wall, own = self._parts.wall, self._parts.watch.own
        scale, damping_scale = (wall.scale, wall.damping_scale) if own is None else own.reduced
        return self._target * scale, self._target_damping * damping_scale

    @property
    def position(self) -> float:
        """The last known position of the shaft [rad]; NaN: none is known yet."""
        return self._position

    def may_engage(self) -> bool:
        """Whether the wall would come on with the next reading, if that is like the last one."""
        return self._parts.engagement.ready and self.held()

    def held(self) -> bool:
        """Whether the dead man is held, or there is none."""
        return self._now() <= self._words[_HELD_NS]

    def run(self, deadline_ns: int, woke_ns: int, missed: int) -> None:
        """Serve one deadline.

        Args:
            deadline_ns: The deadline served [ns].
            woke_ns: When the loop woke for it [ns].
            missed: Whole periods skipped since the tick before.
        """
        parts = self._parts
        servo, wall, watch = parts.servo, parts.wall, parts.watch
        periods = 1 + missed

        velocity = self._sense(woke_ns)
        position = self._position

        flags = 0
        wall_torque = 0.0
        contact = wall.in_contact(position)
        if missed:
            self._count_missed(deadline_ns, missed)
        on = (self._on and woke_ns <= self._words[_HELD_NS]) or self._engage(woke_ns, contact)
        if not on:
            flags = FLAG_WARM_UP if self.warm_up else FLAG_OFF
        elif self._sampled_ns is not None:
            self._look(position, contact, periods)
            wall_torque = wall.torque(position, velocity)
        if contact:
            flags |= FLAG_CONTACT
        torque = parts.ring.push(wall_torque, periods)
        torque = self._checked(torque)
        if abs(torque) > self._limit or abs(torque) >= wall.clip:
            flags |= FLAG_SATURATED
        words = self._words
        if words[_CUT]:
            return  # the supervisor has taken the bus: not one byte more
        # From the sending of the request to the sending of the torque: what either takes on its
        # way is the same, and so is no part of the age.
        sent_ns = self._now()
        sent = servo.write(torque)
        watch.sent(sent)
        if parts.pipelined:
            servo.request()

        sampled_ns = self._sampled_ns
        age_ns = 0
        interval_ns = 0
        outcome = self._outcome
        if outcome is _OK or outcome is _WAITING:
            # To the next tick with a sample: one that lost its reading is part of the interval.
            interval_ns = woke_ns - self._woke_ns if self._woke_ns else parts.period_ns
            self._woke_ns = woke_ns
        if sampled_ns is not None:
            age_ns = sent_ns - sampled_ns
            may_raise = not contact or not on or self._may_rise()
            self._follow_guard(age_ns, interval_ns, may_raise)
        parts.telemetry.write(
            deadline_ns,
            woke_ns - deadline_ns,
            self._work_ns,
            self._bus_ns,
            sampled_ns or 0,
            age_ns,
            self._outcome,
            missed,
            flags,
            wall.phase,
            watch.current,
            position,
            velocity,
            wall_torque,
            sent,
            wall.stiffness * wall.scale,
            (wall.damping + wall.injected) * wall.damping_scale,
            self._delay_s,
            self._measured_torque,
        )
        self.done = wall.done
        self.ticks = words[_TICKS] = self.ticks + 1
        self.missed = words[_MISSED] = self.missed + missed
        self._bus_ns = bus_ns = servo.waited_ns
        words[_HEARTBEAT_NS] = ended_ns = self._now()
        self._work_ns = ended_ns - woke_ns - bus_ns

    def _sense(self, woke_ns: int) -> float:
        """Take the reading; the velocity it implies [rad/s]."""
        parts = self._parts
        servo = parts.servo
        if not parts.pipelined:
            servo.request()
        reading = servo.collect(woke_ns + self._collect_ns)
        outcome, position, _, sampled_ns, self._measured_torque, _ = reading
        self._outcome = outcome
        if outcome is _WAITING:
            # Held as they are until the next sample: a loop with a longer period, which is what
            # the theory knows. With dx = 0 in between the damping would act in one tick of many.
            return self._velocity
        if outcome is not _OK:
            # The last position once more, so dx = 0. Before the first good reading nothing acts.
            self.trip = parts.safety.failed(self._now())
            self._velocity = 0.0
            if parts.pipelined and outcome is Outcome.LOST:
                self._collect_ns, self._other_collect_ns = self._other_collect_ns, self._collect_ns
            return 0.0
        self.trip = parts.safety.good(reading)
        self._position = position
        last_ns = self._sampled_ns
        self._sampled_ns = sampled_ns
        if last_ns is None and parts.wall_from_start and self.trip is None:
            parts.wall.position += position
        # The time that really passed between the samples, whatever came in between: lost
        # readings, skipped periods, and a tick that was served late, which the grid counts only
        # afterwards. Whole periods where that is nearly so: jitter does not reach the velocity.
        periods = 1.0
        if last_ns is not None:
            periods = (sampled_ns - last_ns) / parts.period_ns
            whole = round(periods)
            if abs(periods - whole) <= JITTER and whole:
                periods = whole
            periods = max(periods, SHORTEST)
        self._velocity = velocity = parts.velocity.update(position, periods)
        return velocity

    def _look(self, position: float, contact: bool, periods: int) -> None:
        """Watch the motion for an oscillation, and the wall for energy it gives."""
        parts = self._parts
        watch, wall = parts.watch, parts.wall
        watch.passed(periods)
        if self._outcome is not _OK:
            return
        watch.sample(position, wall, self._measured_torque)
        if parts.driven.too_fast(position, self._sampled_ns or 0, watch.commanded, contact, wall):
            self.trip = self.trip or Trip.OVERSPEED
        if watch.failed and self.trip is None:
            self.trip = Trip.OSCILLATION
        if watch.scale != wall.scale or watch.damping_scale != wall.damping_scale:
            wall.scale, wall.damping_scale = watch.scale, watch.damping_scale
            wall.elastic_limit = wall.scale * min(self._limit, wall.clip)
        injected = 0.0
        if parts.passivity is not None:
            penetration = position - wall.position if contact else 0.0
            injected = parts.passivity.update(
                position, penetration, wall.stiffness * wall.scale, watch.acted, watch.spanned
            )
        wall.injected = injected

    def _engage(self, woke_ns: int, contact: bool) -> bool:
        """Whether the wall comes on with this tick; it is off, or the dead man was let go."""
        parts = self._parts
        gate, wall = parts.engagement, parts.wall
        if self._on:
            self._on = False
            gate.restart()
            parts.ring.clear()
        if self._outcome is _OK or self._outcome is _WAITING:  # slow replies: the last place counts
            stiffness = max(wall.stiffness, self._target)
            if self.warm_up:
                stiffness = parts.schedule.decision.stiffness
            gate.sample(stiffness, self._position - wall.position if contact else 0.0)
        if self.warm_up or not gate.ready or woke_ns > self._words[_HELD_NS]:
            return False
        if self.came_on:  # what was seen before the pause says nothing about the motion now
            parts.watch.resume()
            if parts.passivity is not None:
                parts.passivity.restart()
        self._on = self.came_on = True
        return True

    def _may_rise(self) -> bool:
        """Whether K may rise by whatever it lacks, though the shaft is in contact."""
        parts = self._parts
        wall = parts.wall
        rise = self._most_decided - wall.stiffness
        return parts.engagement.may_rise(rise, self._position - wall.position)

    def _checked(self, torque: float) -> float:
        """The torque that may be sent [N·m]: none once a trip has come."""
        if self.trip is None and not math.isfinite(torque):
            self.trip = Trip.NOT_A_NUMBER
        return torque if self.trip is None else 0.0

    def _count_missed(self, deadline_ns: int, missed: int) -> None:
        """Count periods that had no tick; too many may end the run."""
        parts = self._parts
        if self.warm_up or self.trip is not None:
            return
        if parts.missed.count(deadline_ns, missed) and parts.trips_on_missed:
            self.trip = Trip.MISSED_PERIODS

    def _follow_guard(self, age_ns: int, interval_ns: int, may_raise: bool) -> None:
        """Count age and interval; move the commanded stiffness and damping together if need be."""
        parts = self._parts
        wall = parts.wall
        if self._words[_RAISE] != self._raises:
            self._raises = self._words[_RAISE]
            parts.watch.raise_again()
        changed = parts.schedule.observe(age_ns, interval_ns, may_raise)
        if changed and not self.warm_up:
            self._take_delay()
            if wall.guarded:
                self._begin_ramp(may_raise)
        elif self._owed and may_raise and not self._ramp_left:
            self._owed = False
            decision = parts.schedule.decision
            self._target, self._target_damping = decision.stiffness, decision.damping
            self._ramp_left = 1
        if self._ramp_left:
            self._ramp_left -= 1
            if self._ramp_left:
                wall.stiffness += self._ramp_stiffness
                wall.damping += self._ramp_damping
            else:
                wall.stiffness = self._target
                wall.damping = self._target_damping

    def _begin_ramp(self, may_raise: bool) -> None:
        """Set out for what is allowed from now on."""
        parts = self._parts
        wall = parts.wall
        ticks = parts.ramp_ticks
        # Raised only while the spring is at rest, so at once: a ramp could run on into contact.
        # A longer delay may allow more too: it allows less damping, and that leaves more of
        # the torque limit to the spring's encoder steps. Until a moment of rest K stays.
        decision = parts.schedule.decision
        target, damping = decision.stiffness, decision.damping
        self._owed = target > wall.stiffness and not may_raise
        if self._owed:
            target, damping = wall.stiffness, min(damping, wall.damping)
        self._target, self._target_damping = target, damping
        fall = wall.stiffness - target
        if fall < 0.0:
            ticks = 1
        elif self._ramp_left and self._ramp_stiffness < 0.0:
            # Another reason to lower it does not make a fall slower that is under way.
            ticks = min(ticks, max(1, math.ceil(fall / -self._ramp_stiffness)))
        self._ramp_left = ticks
        self._ramp_stiffness = (target - wall.stiffness) / ticks
        self._ramp_damping = (self._target_damping - wall.damping) / ticks
