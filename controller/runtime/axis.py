"""One servo's law, and the parts that judge it; it knows no clock and no bus.

``torque`` is what must come before the torque is sent, ``after`` the rest of the period.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from math import isfinite
from typing import Final

from haptic_wall.controller.detector.soft_wall import Phase
from haptic_wall.controller.detector.watch import Watch
from haptic_wall.controller.laws.delay import DelayRing
from haptic_wall.controller.laws.engagement import Engagement
from haptic_wall.controller.laws.passivity_control import PassivityControl
from haptic_wall.controller.laws.velocity import Biquad, VelocityEstimator
from haptic_wall.controller.laws.wall import Law
from haptic_wall.controller.runtime.changeover import Changeover, Obstacle, adopt
from haptic_wall.controller.runtime.checks import Safety
from haptic_wall.controller.runtime.gains import Gains
from haptic_wall.controller.runtime.handover import Change, Inbox
from haptic_wall.controller.runtime.safety import Trip
from haptic_wall.controller.runtime.telemetry import (
    FLAG_ALARM,
    FLAG_CHANGED,
    FLAG_CONTACT,
    FLAG_OFF,
    FLAG_PROBED,
    FLAG_RAISED,
    FLAG_REDUCED,
    FLAG_SATURATED,
    FLAG_WARM_UP,
    Telemetry,
    Word,
)
from haptic_wall.hw.servo import Outcome, Reading

JITTER: Final = 0.1
"""Largest distance from whole periods at which an interval between samples counts as whole
[periods]. A loop that serves a tick every 1.5 periods is far from it: with a division by 2, its
velocity would omit a quarter of the damping."""
_OK: Final = Outcome.OK  # looking up an enum member is slow: a plain name is many times faster
_REFUSED: Final = Outcome.REFUSED
_PROBED: Final = Phase.PROBED
_HEAD, _WITHDRAWN = int(Word.HEAD), int(Word.WITHDRAWN)


@dataclass(slots=True)
class Tick:
    """The times of one period, the same for all axes."""

    deadline_ns: int = 0
    """The deadline served [ns]"""
    woke_ns: int = 0
    """When the loop woke for it [ns]"""
    lateness_ns: int = 0
    """Of the wake-up, in real time [ns]"""
    missed: int = 0
    """Whole periods skipped since the last tick"""
    read_ns: int = 0
    """When the readings had come [ns]"""
    sent_ns: int = 0
    """When the torques were sent [ns]"""
    age_ns: int = 0
    """Age of the oldest sample when the torques were sent [ns]"""
    interval_ns: int = 0
    """Longest interval of an axis from its last tick with a reading to this one [ns]; 0: the
    reading of that axis failed, and the interval continues"""
    held: bool = True
    """The dead man is held, or there is none"""
    raises: int = 0
    """Number of requests to return to the full wall"""
    work_ns: int = 0
    """Work of the tick before [ns]"""
    bus_ns: int = 0
    """Wait for the bus of the tick before [ns]"""


@dataclass(slots=True)
class Axis:
    """The law of one servo with its state; what it returns is sent unless an axis has tripped."""

    law: Law
    """Only the axis sets its ``injected``"""
    velocities: VelocityEstimator
    velocity_filter: Biquad | None
    """Filters the velocity that damps; None: none"""
    gains: Gains
    ring: DelayRing
    safety: Safety
    watch: Watch
    passivity: PassivityControl | None
    """Injects damping where the wall generates energy; None: none"""
    telemetry: Telemetry
    """Takes the rows"""
    period_ns: int
    """Of the grid [ns]"""
    torque_limit: float
    """Of the servo [N·m]"""
    wall_from_start: bool
    """The wall's position counts from the first reading"""
    engagement: Engagement
    """Decides when the wall may come on"""
    inbox: Inbox
    """Hears what becomes of a change of the running wall"""
    changeover: Changeover
    """Finds the tick for a change"""
    sign: int = 1
    """1, -1: position = sign * the servo's own + offset, and torques turn with the sign"""
    offset: float = 0.0
    """See ``sign`` [rad]"""
    change: Change | None = None
    """The change at hand; None: none is"""
    made: Change | None = None
    """The last change that was made; None: none was"""
    trip: Trip | None = None
    """Why the run must end; None: no trip"""
    came_on: bool = False
    """The wall has been on at least once"""
    outcome: Outcome = _OK
    """Of the last request"""
    position: float = math.nan
    """The last known position [rad]; NaN: none is known yet"""
    velocity: float = 0.0
    """Estimated velocity [rad/s]; 0 after a reading that failed"""
    damped: float = 0.0
    """Velocity that the law's damping acts on: filtered if the wall has a filter [rad/s]"""
    sampled_ns: int | None = None
    """When ``position`` was sampled [ns]; None: none is known yet"""
    served_ns: int = 0
    """Wake-up of the last tick with a reading [ns]; 0: none"""
    measured_torque: float = math.nan
    """Torque in the last reply [N·m]; NaN: the servo measures none"""
    _on: bool = False
    """The wall acts"""
    _flags: int = 0
    _may_raise: bool = True
    """K may go up after this tick"""
    _delay_s: float = 0.0
    _started_at: float = 0.0
    """Added to the positions of laws [rad]"""
    _raises: int = 0
    _wall_torque: float = 0.0
    """Of the law in the last tick, before the delay [N·m]"""

    def __post_init__(self) -> None:
        self._raises = self.telemetry.words[Word.RAISE]
        self.law.derating = self.watch.backstop.wall.derating

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
        scale, damping_scale = self.watch.backstop.wall.reduced
        return gains.stiffness * scale, gains.damping * damping_scale

    def torque(  # noqa: PLR0912 - in one piece for speed
        self, reading: Reading, tick: Tick
    ) -> float:
        """Return the servo's torque for its reading [N·m]; where ``trip`` is set the run must end.

        Args:
            reading: The servo's answer.
            tick: Times of this period.
        """
        outcome, position, _, sampled_ns, measured, alert = reading
        sign = self.sign
        self.measured_torque = sign * measured
        if outcome is _OK:
            position = sign * position + self.offset
            verdict = self.safety.good(position, sampled_ns, alert)
            if verdict is _REFUSED:
                outcome, self.measured_torque = _REFUSED, math.nan
            else:
                self.trip = verdict
                self._move(position, sampled_ns)
        self.outcome = outcome
        if outcome is not _OK:
            # The last position again, so dx = 0. Before the first good reading the torque is zero.
            self.velocity = self.damped = 0.0
            self.trip = self.safety.failed(tick.read_ns)
        change, missed = self.change, tick.missed
        flags = 0 if change is None else self._change(change)
        law, watch, position, wall_torque = self.law, self.watch, self.position, 0.0
        contact = law.in_contact(position)
        if missed and self.gains.in_force and self.trip is None:
            self.trip = self.safety.missed(tick.deadline_ns, missed)
        on = (self._on and tick.held) or self._engage(tick.held)
        if not on:
            flags |= FLAG_OFF if self.gains.in_force else FLAG_WARM_UP
        elif self.sampled_ns is not None:
            if outcome is _OK:
                watch.sample(position, law, self.measured_torque, 1 + missed)
                if self.safety.driven(watch.commanded, contact, law):
                    self.trip = self.trip or Trip.OVERSPEED
                elif watch.failed:
                    self.trip = self.trip or Trip.OSCILLATION
                if self.passivity is not None:
                    law.injected = self.passivity.update(
                        position,
                        law.elongation(position),
                        law.stiffness * law.derating.scale,
                        watch.acted - law.held,
                        watch.spanned,
                    )
            else:
                watch.passed(1 + missed)
            wall_torque = law.torque(position, self.damped)
        torque = self.ring.push(wall_torque, 1 + missed)
        if self.trip is None and not isfinite(torque):
            self.trip = Trip.NOT_A_NUMBER
        self._flags = flags | FLAG_CONTACT if contact else flags
        self._may_raise = not (contact and on)
        self._wall_torque = wall_torque
        return sign * torque

    def _move(self, position: float, sampled_ns: int) -> None:
        """Take a good position [rad], sampled at an instant [ns]; estimate the velocity."""
        last_ns, periods = self.sampled_ns, 1.0
        if last_ns is None:
            if self.wall_from_start and self.trip is None:
                self._started_at = position
                self.law.position += position
        else:
            # Not the count of ticks: readings may be lost, periods skipped, ticks late. Nearly
            # whole numbers are rounded, so that jitter does not disturb the velocity.
            passed = (sampled_ns - last_ns) / self.period_ns
            if not -JITTER <= passed - 1.0 <= JITTER:
                whole = round(passed)
                near = abs(passed - whole) <= JITTER and whole
                periods = whole if near else max(passed, 0.0)
        self.position, self.sampled_ns = position, sampled_ns
        self.velocity = self.damped = self.velocities.update(position, periods)
        if self.velocity_filter is not None:
            self.damped = self.velocity_filter.update(self.velocity)

    def after(self, torque: float, sent: float, tick: Tick) -> None:
        """Do what can wait until the torque is sent: gains and row.

        Args:
            torque: Of the servo, as commanded [N·m].
            sent: As sent [N·m].
            tick: Times of this period.
        """
        sent *= self.sign
        law, watch, outcome, flags = self.law, self.watch, self.outcome, self._flags
        watch.sent(sent)
        size = torque if torque >= 0.0 else -torque
        if size > self.torque_limit or size >= law.clip:
            flags |= FLAG_SATURATED
        age_ns = 0
        if self.sampled_ns is not None:
            age_ns = tick.sent_ns - self.sampled_ns
            if tick.raises != self._raises:  # the return to the full wall is requested
                self._raises = tick.raises
                flags |= FLAG_RAISED
                watch.backstop.raise_again()
            may_raise = self._may_raise or self._may_rise()
            if self.gains.follow(tick.age_ns, tick.interval_ns, may_raise):
                self._follow_gains()
        derating = law.derating
        if watch.alarm:
            flags |= FLAG_ALARM
        if derating.scale != 1.0:
            flags |= FLAG_PROBED if watch.backstop.wall.phase is _PROBED else FLAG_REDUCED
        self.telemetry.write(
            tick.deadline_ns,
            tick.lateness_ns,
            tick.work_ns,
            tick.bus_ns,
            self.sampled_ns or 0,
            age_ns,
            outcome,
            tick.missed,
            flags,
            law.phase,
            watch.current,
            self.position,
            self.velocity,
            self._wall_torque,
            sent,
            law.stiffness * derating.scale,
            (law.damping + law.injected) * derating.damping_scale,
            self._delay_s,
            self.measured_torque,
            law.held,
        )

    def _change(self, change: Change) -> int:
        """Make the change at hand, if this is the tick for it.

        Returns:
            ``FLAG_CHANGED`` where it is in force from this tick on; else 0.
        """
        inbox, gains, changeover = self.inbox, self.gains, self.changeover
        if self.trip is not None or self.telemetry.words[_WITHDRAWN] >= change.number:
            gains.release()
            changeover.restart()
            self.change = None
            inbox.settle(-1, 0)
            return 0
        obstacle = self._obstacle(change)
        if obstacle is not Obstacle.NONE:
            inbox.waits(obstacle, changeover.size)
            return 0
        self._make(change)
        self.change, self.made = None, change
        inbox.settle(self.telemetry.words[_HEAD], gains.schedule.index)
        return FLAG_CHANGED

    def _obstacle(self, change: Change) -> Obstacle:
        """Return the obstacle to making a change in this tick."""
        gains, changeover = self.gains, self.changeover
        if not self.came_on:
            return Obstacle.NOT_ON
        if self.outcome is not _OK:
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
            self.position,
            self.damped,
        )
        falls = allowed.stiffness < gains.stiffness
        if obstacle is not Obstacle.NONE and falls and not change.moved:
            gains.lower(allowed.stiffness)
        return obstacle

    def _make(self, change: Change) -> None:
        """Render, command and watch as the change asks for, from this tick on."""
        law, ring, position = self.law, self.ring, self.position
        before = law.position
        if change.steps != ring.steps:
            coming = law.torque(position, self.damped) if self._on else 0.0
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

    def _engage(self, held: bool) -> bool:
        """Record that the wall is off; return whether it comes on in this tick."""
        gate, law, position = self.engagement, self.law, self.position
        if self._on:
            self._on = False
            gate.restart()
            self.ring.clear()
            law.settle(position)  # what it has stored is lost with its torque
        if self.outcome is _OK:
            gate.sample(self.gains.coming, law.elongation(position))
        if not (self.gains.in_force and gate.ready and held):
            return False
        if self.came_on:
            self.watch.resume()
            if self.passivity is not None:
                self.passivity.restart()
        law.settle(position)
        self._on = self.came_on = True
        return True

    def _may_rise(self) -> bool:
        """Whether K may rise by the largest possible amount although the shaft is in contact."""
        law, rise = self.law, self.gains.highest - self.law.stiffness
        return rise <= 0.0 or self.engagement.may_rise(rise, law.elongation(self.position))
