"""Executes one period from start to end: sample, render, delay, check, write, report."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import isfinite

from haptic_wall.controller.detector.watch import Watch
from haptic_wall.controller.laws.delay import DelayRing
from haptic_wall.controller.laws.engagement import Engagement
from haptic_wall.controller.laws.passivity_control import PassivityControl
from haptic_wall.controller.laws.wall import Law
from haptic_wall.controller.runtime.changeover import Changeover, Obstacle, adopt
from haptic_wall.controller.runtime.checks import Safety
from haptic_wall.controller.runtime.gains import Gains
from haptic_wall.controller.runtime.handover import Change, Inbox
from haptic_wall.controller.runtime.safety import Trip
from haptic_wall.controller.runtime.sampler import Sampler
from haptic_wall.controller.runtime.telemetry import (
    FLAG_CHANGED,
    FLAG_CONTACT,
    FLAG_OFF,
    FLAG_RAISED,
    FLAG_SATURATED,
    FLAG_WARM_UP,
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


@dataclass(slots=True)
class Tick:
    """Executes the steps of a period in order; holds its parts, its trip and its counters."""

    clock: Clock
    servo: Servo
    law: Law
    """Only the tick sets its ``injected``"""
    sampler: Sampler
    gains: Gains
    ring: DelayRing
    safety: Safety
    watch: Watch
    passivity: PassivityControl | None
    """Injects damping where the wall generates energy; None: none"""
    telemetry: Telemetry
    period_ns: int
    """Of the grid [ns]"""
    wall_from_start: bool
    """The wall's position counts from the first reading"""
    engagement: Engagement
    """Decides when the wall may come on"""
    inbox: Inbox
    """Changes of the running wall"""
    changeover: Changeover
    """Finds the tick for a change"""
    trip: Trip | None = None
    """Why the run must end; None: no trip. Once set, no torque is sent"""
    done: bool = False
    """The program is over; the torque of the last period was zero"""
    came_on: bool = False
    """The wall has been on at least once"""
    ticks: int = 0
    """Periods executed"""
    missed: int = 0
    """Whole periods skipped"""
    _on: bool = False
    """The wall acts"""
    _work_ns: int = 0
    _bus_ns: int = 0
    _waited: int = 0
    _served_ns: int = 0
    """Wake-up of the last tick with a reading [ns]; 0: none"""
    _offset: int = 0
    """Of an elastic clock, as last seen [ns]"""
    _delay_s: float = 0.0
    _started_at: float = 0.0
    """Added to the positions of laws [rad]"""
    _raises: int = 0
    _limit: float = 0.0
    _wall_torque: float = 0.0
    """Of the law in the last tick, before the delay [N·m]"""
    _bus: Bus = field(default_factory=Bus)
    _words: memoryview[int] = field(init=False)
    _now: Callable[[], int] = field(init=False)

    def __post_init__(self) -> None:
        self._now = self.clock.now_ns
        self._words = words = self.telemetry.words
        self._limit = self.servo.facts.torque_limit
        self._bus = self.servo.bus or self._bus
        self._offset, self._raises = words[_OFFSET_NS], words[_RAISE]
        self.law.derating = self.watch.backstop.derating
        if self.sampler.pipelined:
            self.servo.request()

    def wall_on(self) -> None:
        """End the warm-up: the guard's decision for the measured ages is in force at once."""
        self.gains.begin()
        self._follow_gains()

    def _follow_gains(self) -> None:
        """Use delay, sample age and injected damping of the present decision."""
        schedule = self.gains.schedule
        self._delay_s = schedule.allowed.delay
        self.watch.set_age(schedule.age_ns * 1e-9)
        if self.passivity is not None:
            self.passivity.cap = schedule.allowed.injected

    @property
    def commanded(self) -> tuple[float, float]:
        """Return the rendered stiffness [N·m/rad] and damping [N·m·s/rad].

        Ramps count as complete. Probes are excluded: one takes most of K for a cycle.
        """
        gains = self.gains
        scale, damping_scale = self.watch.backstop.reduced
        return gains.stiffness * scale, gains.damping * damping_scale

    @property
    def position(self) -> float:
        """Return the last known position of the shaft [rad]; NaN: none is known yet."""
        return self.sampler.position

    def may_engage(self) -> bool:
        """Whether the wall would come on with the next reading, if that equals the last one."""
        return self.engagement.ready and self.held()

    def held(self) -> bool:
        """Whether the dead man is held, or there is none."""
        return self._now() <= self._words[_HELD_NS]

    def run(  # noqa: PLR0912, PLR0915 - in one piece for speed
        self, deadline_ns: int, woke_ns: int, missed: int
    ) -> None:
        """Serve one deadline.

        Args:
            deadline_ns: The deadline served [ns].
            woke_ns: When the loop woke for it [ns].
            missed: Whole periods skipped since the last tick.
        """
        words, sampler, watch, inbox = self._words, self.sampler, self.watch, self.inbox
        offset, self._waited = words[_OFFSET_NS], words[_WAITED_NS]
        # Reported is real time, whatever an elastic clock takes out.
        lateness_ns = woke_ns - deadline_ns + offset - self._offset
        self._offset = offset

        reading = sampler.sample(woke_ns)
        outcome, position, sampled_ns = sampler.outcome, sampler.position, sampler.sampled_ns
        if outcome is _OK:
            self.trip = self.safety.good(reading)
            if sampler.first and self.wall_from_start and self.trip is None:
                self._started_at = position
                self.law.position += position
        elif outcome is not _WAITING:
            self.trip = self.safety.failed(self._now())
        flags = 0 if inbox.change is None else self._change(inbox.change)

        law, wall_torque = self.law, 0.0
        contact = law.in_contact(position)
        if missed and self.gains.in_force and self.trip is None:
            self.trip = self.safety.missed(deadline_ns, missed)
        on = (self._on and woke_ns <= words[_HELD_NS]) or self._engage(woke_ns)
        if not on:
            flags |= FLAG_OFF if self.gains.in_force else FLAG_WARM_UP
        elif sampled_ns is not None:
            watch.passed(1 + missed)
            if outcome is _OK:
                watch.sample(position, law, sampler.measured_torque)
                if self.safety.driven(watch.commanded, contact, law):
                    self.trip = self.trip or Trip.OVERSPEED
                elif watch.failed:
                    self.trip = self.trip or Trip.OSCILLATION
                if self.passivity is not None:
                    law.injected = self._injected(self.passivity, position)
            wall_torque = law.torque(position, sampler.damped)
        if contact:
            flags |= FLAG_CONTACT
        torque = self.ring.push(wall_torque, 1 + missed)
        if self.trip is None and not isfinite(torque):
            self.trip = Trip.NOT_A_NUMBER
        if self.trip is not None:
            torque = 0.0
        size = torque if torque >= 0.0 else -torque
        if size > self._limit or size >= law.clip:
            flags |= FLAG_SATURATED
        if words[_CUT]:
            return  # the supervisor has taken the bus: write nothing more
        # From sending the request to sending the torque: both have the same travel time, which
        # therefore is no part of the age.
        sent_ns = self._now()
        sent = self.servo.write(torque)
        watch.sent(sent)
        if sampler.pipelined:
            self.servo.request()

        age_ns = 0
        interval_ns = 0  # to the next tick with a sample: a lost reading is part of the interval
        if outcome is _OK or outcome is _WAITING:
            interval_ns = woke_ns - self._served_ns if self._served_ns else self.period_ns
            self._served_ns = woke_ns
        if sampled_ns is not None:
            age_ns = sent_ns - sampled_ns
            may_raise = not (contact and on) or self._may_rise()
            if words[_RAISE] != self._raises:  # the return to the full wall is requested
                self._raises = words[_RAISE]
                flags |= FLAG_RAISED
                watch.raise_again()
            if self.gains.follow(age_ns, interval_ns, may_raise):
                self._follow_gains()
        derating = law.derating
        self.telemetry.write(
            deadline_ns,
            lateness_ns,
            self._work_ns,
            self._bus_ns,
            sampled_ns or 0,
            age_ns,
            outcome,
            missed,
            flags,
            law.phase,
            watch.current,
            position,
            sampler.velocity,
            wall_torque,
            sent,
            law.stiffness * derating.scale,
            (law.damping + law.injected) * derating.damping_scale,
            self._delay_s,
            sampler.measured_torque,
            law.held,
        )
        self._wall_torque = wall_torque
        self.done = law.done
        if words[_OFFERED] != inbox.taken:
            inbox.take()

        self.ticks = words[_TICKS] = self.ticks + 1
        self.missed = words[_MISSED] = self.missed + missed
        bus_ns = self._bus.waited_ns
        words[_HEARTBEAT_NS] = ended_ns = self._now()
        work_ns = ended_ns - woke_ns - bus_ns
        if (offset := words[_OFFSET_NS]) != self._offset:  # elastic, in this tick
            waited_ns = words[_WAITED_NS] - self._waited
            bus_ns += waited_ns
            work_ns += offset - self._offset - waited_ns
            self._offset = offset
        self._work_ns, self._bus_ns = work_ns, bus_ns

    def _injected(self, passivity: PassivityControl, position: float) -> float:
        """Return the damping that the energy of the motion asks for [N·m·s/rad]."""
        watch, law = self.watch, self.law
        injected = passivity.update(
            position,
            law.elongation(position),
            law.stiffness * law.derating.scale,
            watch.acted - law.held,
            watch.spanned,
        )
        # A damper may feed the vibration of a link.
        return passivity.waive() if watch.outruns(law.stiffness) else injected

    def _change(self, change: Change) -> int:
        """Make the change at hand, if this is the tick for it.

        Returns:
            ``FLAG_CHANGED`` where it is in force from this tick on; else 0.
        """
        inbox, gains, changeover = self.inbox, self.gains, self.changeover
        if self.trip is not None or self._words[_WITHDRAWN] >= change.number:
            gains.release()
            changeover.restart()
            inbox.settle(-1, 0)
            return 0
        obstacle = self._obstacle(change)
        if obstacle is not Obstacle.NONE:
            inbox.waits(obstacle, changeover.size)
            return 0
        self._make(change)
        inbox.settle(self._words[_HEAD], gains.schedule.index)
        return FLAG_CHANGED

    def _obstacle(self, change: Change) -> Obstacle:
        """Return the obstacle to making a change in this tick."""
        sampler, gains, changeover = self.sampler, self.gains, self.changeover
        if not self.came_on:
            return Obstacle.NOT_ON
        if sampler.outcome is not _OK:
            return Obstacle.READING
        if not change.placed:
            change.placed = True
            if change.law is not None:
                change.law.position += self._started_at
        allowed = change.table.at(gains.schedule.index)
        softer = change.softer and allowed.stiffness <= gains.stiffness
        obstacle = changeover.watched(self.watch, softer)
        if obstacle is not Obstacle.NONE or not self._on:
            return obstacle
        law = self.law
        obstacle = changeover.obstacle(
            law,
            self.ring,
            change.law or law,
            allowed._replace(delay=max(allowed.delay, self._delay_s)),
            change.steps,
            sampler.position,
            sampler.damped,
        )
        falls = allowed.stiffness < gains.stiffness
        if obstacle is not Obstacle.NONE and falls and not change.moved:
            gains.lower(allowed.stiffness)
        return obstacle

    def _make(self, change: Change) -> None:
        """Render, command and watch as the change asks for, from this tick on."""
        law, ring, position = self.law, self.ring, self.sampler.position
        before = law.position
        if change.steps != ring.steps:
            coming = law.torque(position, self.sampler.damped) if self._on else 0.0
            ring = ring.resized(change.steps, self._wall_torque, coming)
        if change.law is not None:
            adopt(change.law, law)
            law = change.law
            law.settle(position)
        self.gains.take(law, change.table)
        self.watch.change(change.watch, law.position - before)
        if self.passivity is not None:
            self.passivity.rebase(law.elongation(position))
        if not self._on:
            self.engagement.restart()
        self.law, self.ring = law, ring
        self.changeover.restart()
        self._follow_gains()

    def _engage(self, woke_ns: int) -> bool:
        """Record that the wall is off; return whether it comes on in this tick."""
        gate, law, sampler = self.engagement, self.law, self.sampler
        if self._on:
            self._on = False
            gate.restart()
            self.ring.clear()
            law.settle(sampler.position)  # what it has stored is lost with its torque
        if sampler.outcome is _OK or sampler.outcome is _WAITING:  # a slow reply: the last position
            gate.sample(self.gains.coming, law.elongation(sampler.position))
        if not (self.gains.in_force and gate.ready) or woke_ns > self._words[_HELD_NS]:
            return False
        if self.came_on:
            self.watch.resume()
            if self.passivity is not None:
                self.passivity.restart()
        law.settle(sampler.position)
        self._on = self.came_on = True
        return True

    def _may_rise(self) -> bool:
        """Whether K may rise by the largest possible amount although the shaft is in contact."""
        elongation = self.law.elongation(self.sampler.position)
        return self.engagement.may_rise(self.gains.largest_rise, elongation)
