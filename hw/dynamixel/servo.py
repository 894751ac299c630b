"""Drives one Dynamixel servo: converts torques [N·m] to goal currents, and checks its health."""

from __future__ import annotations

import math
from contextlib import suppress
from typing import Final

from haptic_wall.hw.clock import Clock
from haptic_wall.hw.dynamixel.cut import torque_off
from haptic_wall.hw.dynamixel.drivable import drivable
from haptic_wall.hw.dynamixel.hardware_errors import latched
from haptic_wall.hw.dynamixel.health import HealthWatch
from haptic_wall.hw.dynamixel.jump_filter import JumpFilter
from haptic_wall.hw.dynamixel.link import Link
from haptic_wall.hw.dynamixel.register_access import APART
from haptic_wall.hw.dynamixel.samples import Sample
from haptic_wall.hw.dynamixel.stand_in import StandInLine
from haptic_wall.hw.dynamixel.startup import Startup
from haptic_wall.hw.dynamixel.tables import COUNTS_PER_REV, POSITION_UNIT, model_by_number
from haptic_wall.hw.dynamixel.torque_law import torque_law
from haptic_wall.hw.dynamixel.watchdog import WatchdogMonitor
from haptic_wall.hw.errors import (
    ServoError,
    ServoHealthError,
    ServoLostError,
    ServoMissingError,
    StrangeServoError,
    TorqueLostError,
    UnfitServoError,
)
from haptic_wall.hw.serialport.line import FdLine, Line
from haptic_wall.hw.servo import Bus, BusCounts, Check, Facts, Outcome, Reading
from haptic_wall.hw.settings import DriverSettings

_NAN: Final = math.nan
_REPLY_PATIENCE: Final = 1.5
"""Factor on the usual reply time after which a slow adapter's reply is given up: one that has just
missed the timer comes with its next expiry"""


class DynamixelServo:
    """Driver of one servo on a line; the servo may be real or emulated."""

    facts: Facts
    bus: Bus
    trouble: str
    """See ``HasTrouble``"""

    def __init__(self, settings: DriverSettings, line: Line) -> None:
        """Take over ``line``, which ``close`` closes. Nothing is sent yet.

        Raises:
            UnfitServoError: The model is unknown, has no current control, or its smallest torque
                exceeds the torque limit.
        """
        model, constant = drivable(settings)
        self._settings = settings
        self._model = model
        self._line = line
        self._constant = constant
        self._law = torque_law(model, constant, model.voltage)
        if settings.torque_limit > 0.0 and not self._law.within(settings.torque_limit):
            raise UnfitServoError(
                advice="raise it above that.",
                field="servo.torque_limit",
                given=f"is {settings.torque_limit:g} N·m, but the smallest torque of the "
                f"{model.name} is {self._law.step:.2g} N·m",
            )
        self._name = f"{model.name} id {settings.id} on {settings.port or 'memory'}"
        self._link = Link(line, settings.id, baud=settings.baud)
        self._health = HealthWatch(self._link, model.registers, settings.baud, settings.period_s)
        self._now_ns = line.clock.now_ns
        self._watchdog = WatchdogMonitor(settings, self._link, line.clock, self._name)
        self._most = 0.0
        """The largest torque that is sent [N·m], a whole number of steps"""
        self._goal = 0
        self._reply_ns = 0
        """Time of a reply, where that is several periods [ns]; 0: replies are in time"""
        self._alert = False
        self._running = False
        self._known = False
        """It has replied as a model with a known control table"""
        self._confirmed_off = False
        self.trouble = ""
        self.bus = Bus(self._link.counts)
        self.facts = self._facts(model.current_limit, model.voltage)
        self._jump_filter = self._new_jump_filter()

    def start(self) -> list[Check]:
        """Check and set up the servo, then switch the torque on at a goal of zero.

        From here on the servo needs an instruction within every Bus Watchdog period; otherwise it
        drops its torque and silently refuses goals. ``request`` detects such a pause.

        From here on ``facts.torque_limit`` is the servo's own, if that is lower, and
        ``bus.reply_s`` says whether replies take several periods.

        Raises:
            StrangeServoError: It is of no known model; nothing was written.
            UnfitServoError: A check failed; torque is off, or the message says it may not be.
            ServoMissingError: Nothing answers.
            ServoLostError: It stops answering; the message says whether torque is off.
        """
        self._confirmed_off = self._alert = False
        self._goal = 0
        self._jump_filter.forget()
        self._link.forget()
        self._health.forget()
        self._reply_ns = self._link.patience_ns = 0
        self.trouble = ""
        startup = self._startup()
        try:
            number = self._meet(startup)
            ready = startup.run(number, self._health.describe())
            self._law = ready.law
            self._health.bounds = ready.bounds
            self._watchdog.heard_ns = self._now_ns()
            if startup.table.read("bus_watchdog") != ready.bounds.watchdog:
                self._watchdog.look(0, under_torque=False)  # a stall in the start has tripped it
        except ServoMissingError:
            self._off()
            raise  # a servo that never replied was never driven
        except ServoError as error:
            if isinstance(error, UnfitServoError) and not self._known:
                raise StrangeServoError(error.problem) from error
            if self._off():
                raise
            raise type(error)(
                f"{error} Torque off could not be read back",
                advice="switch the servo's power off.",
            ) from error
        except BaseException:
            self._off()
            raise
        self._reply_ns = ready.reply_ns
        if ready.reply_ns:
            jitter_ns = 2e9 * self._settings.period_s
            self._link.patience_ns = round(_REPLY_PATIENCE * ready.reply_ns + jitter_ns)
        self.facts = self._facts(ready.current_limit, ready.volts)
        self._jump_filter = self._new_jump_filter()
        self._most = self.facts.torque_limit
        self.bus.reply_s = self._reply_ns * 1e-9
        self.bus.longest_s = ready.longest_ns * 1e-9
        self.bus.counts = self._link.counts = BusCounts()
        self._watchdog.begin()
        self._running = True
        return ready.checks

    def request(self) -> None:
        """Request the position, without waiting unless the Bus Watchdog may have tripped.

        It may have tripped if no request was answered for most of its time. It is armed again if it
        tripped while the torque was zero.

        Raises:
            ServoLostError: The port is gone.
            TorqueLostError: The Bus Watchdog has ended a torque.
        """
        now_ns = self._now_ns()
        under_torque = self._goal != 0
        if self._reply_ns:
            self._watchdog.call(now_ns, under_torque=under_torque)
            if self._link.waiting:
                return
        self._watchdog.resume(now_ns, under_torque=under_torque)
        health = self._health
        health.asked = 0
        wide = health.length(now_ns) if now_ns >= health.due_ns and self._running else 0
        self._link.request(wide)

    def collect(self, deadline_ns: int) -> Reading:
        """Return the reply to the last ``request``; wait until ``deadline_ns`` [ns] at most.

        A position that implies a speed above ``max_speed`` is refused: the reply is broken in spite
        of a valid checksum, or the encoder has a fault. If such positions persist they are passed
        on, so that the speed limit ends the run.

        Raises:
            ServoLostError: The port is gone.
            TorqueLostError: The torque is gone.
            ServoHealthError: The servo is in no state to be driven any longer.
            RuntimeError: There was no request.
        """
        # Do not wait within a period for a reply that takes several.
        sample = self._link.collect(0 if self._reply_ns else deadline_ns)
        self.bus.waited_ns = self._link.waited_ns
        if self._link.twins:
            raise ServoHealthError(f"A second servo answers as the {self.facts.name}", advice=APART)
        if self._health.asked and sample.outcome is Outcome.OK and not sample.alert:
            # A latched error explains more than its consequences.
            self._judge_health()
        return self._reading(sample)

    def read_from(self, sample: Sample) -> Reading:
        """Convert a sample that a group of servos has collected to a reading.

        Raises:
            ServoLostError: The port is gone.
            TorqueLostError: It has not replied for long, and its torque is gone.
        """
        silence_ns = sample.sampled_ns - self._watchdog.heard_ns
        if sample.outcome is Outcome.OK and silence_ns > self._watchdog.most_ns:
            self._watchdog.look(silence_ns, under_torque=self._goal != 0)
        return self._reading(sample)

    def resume(self) -> None:
        """Examine the Bus Watchdog after a pause; see ``request``."""
        self._watchdog.resume(self._now_ns(), under_torque=self._goal != 0)

    def _reading(self, sample: Sample) -> Reading:
        outcome, counts, current, alert, sampled_ns = sample
        if outcome is not Outcome.OK:
            if self._running and self._link.restarted:
                self._raise_restarted()
            return Reading(outcome, _NAN, 0, sampled_ns, _NAN, False)
        self._watchdog.heard_ns = sampled_ns
        if not self._jump_filter.accepts(counts, sampled_ns):
            self.bus.counts.refused += 1
            return Reading(Outcome.REFUSED, _NAN, 0, sampled_ns, _NAN, False)
        self._alert = self._alert or alert
        return Reading(
            outcome, counts * POSITION_UNIT, counts, sampled_ns, self._law.torque(current), alert
        )

    def write(self, torque: float) -> float:
        """Send a torque [N·m], limited and rounded to the servo's current unit.

        A servo that senses its supply current gives this torque only at a standstill: it gives less
        when it moves with the torque, more when it moves against it.

        Returns:
            The torque really sent [N·m].

        Raises:
            ServoLostError: The port is gone.
            ValueError: The torque is not a finite number.
            RuntimeError: The servo is not started.
        """
        goal = self.goal(torque)
        self._link.send_current(goal)
        return self._law.torque(goal)

    def goal(self, torque: float) -> int:
        """Return the goal current for a torque [N·m]; the caller must send it at once.

        Raises:
            ValueError: The torque is not a finite number.
            RuntimeError: The servo is not started.
        """
        if not self._running:
            raise RuntimeError("a torque was written while torque is off; call start first")
        if not math.isfinite(torque):
            raise ValueError(f"a torque of {torque} N·m was commanded; a finite one is wanted")
        most = self._most
        goal = self._goal = self._law.goal(max(-most, min(most, torque)))
        return goal

    def torque(self, goal: int) -> float:
        """Return the torque [N·m] of a goal current, as ``write`` returns it."""
        return self._law.torque(goal)

    def stop(self) -> bool:
        """Send zero torque, switch torque off and read it back; safe to call at any time.

        Returns:
            Whether torque off was read back. False if the port is gone. False if no known model has
            replied: then nothing was written.
        """
        if not self._confirmed_off:
            if not self._known:  # never started: its torque may belong to another program
                with suppress(ServoError):
                    self._meet(self._startup())
            self._off()
            if self._alert and not self.trouble:
                self.trouble = latched(self._link, self.facts.name)
        return self._confirmed_off

    def close(self) -> None:
        """Stop the servo if it was started and not stopped, and close the line."""
        try:
            if self._running:
                self.stop()
        finally:
            self._line.close()

    def idle(self) -> None:
        """Make the line's system calls without effect, to keep them quick; see ``HasIdleWork``.

        Raises:
            ServoLostError: The port is gone.
        """
        if isinstance(self._line, FdLine):
            self._line.idle()

    def health(self) -> tuple[float, float]:
        """Return the last known supply [V] and temperature [°C]; see ``HasHealth``."""
        return self._health.last["supply"] / 10, float(self._health.last["temperature"])

    def stand_in(self, clock: Clock) -> DynamixelServo:
        """Return the same driver on a line in memory, without a servo; see ``HasStandIn``."""
        other = DynamixelServo(self._settings, StandInLine(self._settings.id, clock))
        other._most = other.facts.torque_limit
        other._watchdog.heard_ns = clock.now_ns()
        other._running = other._known = True
        return other

    def _startup(self) -> Startup:
        return Startup(self._settings, self._model, self._line, self._link, self._constant)

    def _meet(self, startup: Startup) -> int:
        """Read the model number; record whether its control table is known."""
        number = startup.model_number()
        self._known = model_by_number(number) is not None
        return number

    def _off(self) -> bool:
        """Send a zero goal if this driver switched the torque on; switch it off and read it back.

        Nothing is written to a servo with an unknown control table.
        """
        if not self._known:
            return False
        try:
            if self._running:
                self._running = False
                self._watchdog.end()
                with suppress(ServoLostError):  # torque off, which follows, is what counts
                    self._link.send_current(0)
            self._confirmed_off = torque_off(self._link)
        except ServoLostError:
            self._confirmed_off = False
        return self._confirmed_off

    def _judge_health(self) -> None:
        try:
            good = self._health.judge(self._link.block, self.facts.name)
        except TorqueLostError as error:
            raise self._watchdog.explained(error) from error
        if not good:
            self._watchdog.look(0, under_torque=self._goal != 0)

    def _raise_restarted(self) -> None:
        raise self._watchdog.explained(
            TorqueLostError(
                f"The {self.facts.name} has restarted, which its clock shows, so its torque is off",
                advice="check the supply, its current limit and the plugs.",
            )
        )

    def _new_jump_filter(self) -> JumpFilter:
        most = self._settings.max_speed
        return JumpFilter(self.facts.fastest if most is None else most)

    def _facts(self, current_limit: int, volts: float) -> Facts:
        """Return the facts; the torque limit is rounded down to a whole number of torque steps."""
        steps = current_limit
        if self._settings.torque_limit > 0.0:
            steps = min(steps, self._law.within(self._settings.torque_limit))
        return Facts(
            name=self._name,
            counts_per_rev=COUNTS_PER_REV,
            torque_limit=self._law.torque(steps),
            torque_step=self._law.step,
            stall_torque=self._model.stall_torque or self._law.torque(self._model.current_limit),
            no_load_speed=self._model.no_load_at(volts),
        )
