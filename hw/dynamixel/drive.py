"""Drives the servos on a line: starts them, reads and commands all in one cycle, stops them."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import Final

from haptic_wall.hw.dynamixel.cut import torque_off
from haptic_wall.hw.dynamixel.driven import Driven
from haptic_wall.hw.dynamixel.exchange import Exchange
from haptic_wall.hw.dynamixel.health import HealthPolls
from haptic_wall.hw.dynamixel.samples import Way
from haptic_wall.hw.dynamixel.startup import Ready
from haptic_wall.hw.errors import (
    ServoError,
    ServoLostError,
    UnfitServoError,
)
from haptic_wall.hw.serialport.line import FdLine, Line
from haptic_wall.hw.servo import BusCounts, Check, Outcome, Reading
from haptic_wall.hw.settings import DriverSettings

_OK: Final = Outcome.OK
_REPLY_PATIENCE: Final = 1.5
"""Factor on the usual reply time after which a slow adapter's reply is given up: one that has just
missed the timer comes with its next expiry"""
_TRIES: Final = 3
_NEVER_NS: Final = 1 << 62
_PATIENCE_NS: Final = 100_000_000


class Drive:
    """The servos on a line, in the order of their settings.

    Args:
        settings: Settings of each servo, with the same bus and period.
        line: The bus; ``close`` closes it. Nothing is sent yet.

    Raises:
        UnfitServoError: See ``Driven``.
    """

    def __init__(self, settings: Sequence[DriverSettings], line: Line) -> None:
        first = settings[0]
        self.line = line
        self.exchange = Exchange(line, [one.id for one in settings], baud=first.baud)
        self.servos = [
            Driven(one, station, self.exchange)
            for one, station in zip(settings, self.exchange.stations, strict=True)
        ]
        self._period_s = first.period_s
        self._polls = HealthPolls(self.exchange, first.baud, first.period_s)
        self._now_ns = line.clock.now_ns
        self._reply_ns = 0
        """Time of a reply, where that is several periods [ns]; 0: replies are in time"""
        self.running = False
        self.left_on: list[Driven] = self.servos
        """Servos whose torque off was not read back since the last start"""

    def start(self) -> list[list[Check]]:
        """Check and set up each servo in turn, and switch its torque on at a goal of zero.

        Returns:
            The checks of each servo.

        Raises:
            ServoError: See ``DynamixelServo.start``; torque is off, or the message says it may not
                be.
        """
        exchange, servos = self.exchange, self.servos
        self.left_on = servos
        self._reply_ns = exchange.patience_ns = 0
        ready: list[Ready] = []
        for one in servos:
            one.forget()
        try:
            for one in servos:
                exchange.select([one.station])
                ready.append(one.start(self._polls.describe()))
            if len(servos) > 1:
                self._choose_way()
                for one in servos:
                    one.watchdog.resume(self._now_ns(), under_torque=False)  # idle meanwhile
        except ServoError as error:
            if self._off():
                raise
            raise type(error)(
                f"{error} Torque off{self._of_whom()} could not be read back",
                advice="switch the servo's power off.",
            ) from error
        except BaseException:
            self._off()
            raise
        if len(servos) == 1 or exchange.way is not Way.PLAIN:
            self._reply_ns = max(each.reply_ns for each in ready)
        if self._reply_ns:
            jitter_ns = 2e9 * self._period_s
            exchange.patience_ns = round(_REPLY_PATIENCE * self._reply_ns + jitter_ns)
        for one in servos:
            one.watchdog.limit_ns += exchange.patience_ns
            one.bus.reply_s = self._reply_ns * 1e-9
            one.bus.counts = one.station.counts = BusCounts()
        self._run(running=True)
        return [each.checks for each in ready]

    def request(self) -> None:
        """Request all positions; see ``DynamixelServo.request``."""
        now_ns = self._now_ns()
        exchange = self.exchange
        if self._reply_ns:
            for one in self.servos:
                one.watchdog.call(now_ns, under_torque=one.goal != 0)
            if exchange.waiting:
                return
        for one in self.servos:
            watchdog = one.watchdog
            if now_ns - watchdog.heard_ns > watchdog.limit_ns:
                if len(self.servos) > 1:  # nobody must push on while one is examined
                    exchange.send([0] * len(self.servos))
                watchdog.resume(now_ns, under_torque=one.goal != 0)
        polls = self._polls
        polls.asked = 0
        wide = polls.length(now_ns) if now_ns >= polls.due_ns and self.running else 0
        exchange.request(wide)

    def collect(self, deadline_ns: int) -> list[Reading]:
        """Return the replies to the last ``request``; see ``DynamixelServo.collect``."""
        # Do not wait within a period for replies that take several.
        exchange, polls = self.exchange, self._polls
        samples = exchange.collect(0 if self._reply_ns else deadline_ns)
        waited_ns = exchange.waited_ns
        readings = []
        polled = False
        for one, sample in zip(self.servos, samples):  # noqa: B905 - quicker
            one.bus.waited_ns = waited_ns
            if one.station.twins:
                one.be_one()
            if polls.asked and sample.outcome is _OK and not sample.alert:
                # A latched error explains more than its consequences.
                values = polls.values(one.station.block)
                one.judge(values)
                polled = polled or bool(values)
            readings.append(one.reading(sample))
        if polled:
            polls.answered()
        return readings

    def write(self, torques: Sequence[float]) -> list[float]:
        """Send the torques of all servos in one frame; see ``DynamixelServo.write``."""
        servos = self.servos
        goals = [one.goal_of(torque) for one, torque in zip(servos, torques, strict=True)]
        self.exchange.send(goals)
        return [one.law.torque(goal) for one, goal in zip(servos, goals, strict=True)]

    def stop(self) -> bool:
        """Send zero torque to all, switch all torques off and read them back.

        Returns:
            Whether torque off was read back from all.
        """
        if self.left_on:
            for one in self.servos:
                if not one.known:  # never started: its torque may belong to another program
                    with suppress(ServoError):
                        one.meet()
            self._off()
            for one in self.servos:
                one.name_trouble()
        return not self.left_on

    def close(self) -> None:
        """Stop all that was started and not stopped, and close the line."""
        try:
            if self.running:
                self.stop()
        finally:
            self.line.close()

    def idle(self) -> None:
        """Make the line's system calls without effect, to keep them quick."""
        if isinstance(self.line, FdLine):
            self.line.idle()

    def pretend(self) -> None:
        """Run without a start and without polls, on a line without servos."""
        self._polls.due_ns = _NEVER_NS
        for one in self.servos:
            one.known = True
            one.watchdog.heard_ns = self._now_ns()
        self._run(running=True)

    def _run(self, *, running: bool) -> None:
        self.running = running
        for one in self.servos:
            one.running = running

    def _choose_way(self) -> None:
        """Select the fastest instruction to which all servos reply.

        Raises:
            UnfitServoError: There is none.
        """
        exchange = self.exchange
        for way in Way:
            exchange.select(exchange.stations, way)
            for _ in range(_TRIES):
                exchange.request()
                samples = exchange.collect(self._now_ns() + _PATIENCE_NS)
                if all(sample.outcome is _OK for sample in samples):
                    return
        raise UnfitServoError(
            "The servos answer one by one but not in one cycle",
            advice="check the cable, and that no two have the same id.",
        )

    def _off(self) -> bool:
        """Send zero goals if this driver has the torque on; switch it off and read it back.

        Nothing is written to a servo with an unknown control table.

        Returns:
            Whether torque off was read back from all others.
        """
        known = [one for one in self.servos if one.known]
        left = [one.station for one in known]
        for one in self.servos:
            one.watchdog.end()
        with suppress(ServoLostError):
            if self.running:
                self._run(running=False)
                with suppress(ServoLostError):  # torque off, which follows, is what counts
                    self.exchange.send([0] * len(self.servos))
            left = torque_off(left)
        self.left_on = [one for one in self.servos if not one.known or one.station in left]
        return not left

    def _of_whom(self) -> str:
        if len(self.servos) == 1:
            return ""
        return " of " + ", ".join(one.facts.name for one in self.left_on if one.known)
