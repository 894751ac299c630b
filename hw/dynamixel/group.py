"""Drives several servos on one bus: reads all in one cycle, commands all in one frame.

They are read by the fastest instruction that all of them support; if a servo does not reply, only
its own reading is lost. Any servo that is lost for too long, is hot, has restarted, has latched an
error or has lost its torque ends the run of all: zero torque in the next frame, then torque off.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import Final

from haptic_wall.hw.dynamixel.codec import SyncWrite
from haptic_wall.hw.dynamixel.cut import torque_off
from haptic_wall.hw.dynamixel.driven import Driven
from haptic_wall.hw.dynamixel.exchange import GOAL_CURRENT, Exchange
from haptic_wall.hw.dynamixel.health import HealthPolls
from haptic_wall.hw.dynamixel.samples import Way
from haptic_wall.hw.dynamixel.startup import Ready
from haptic_wall.hw.errors import (
    ServoError,
    ServoHealthError,
    ServoLostError,
    UnfitServoError,
)
from haptic_wall.hw.serialport.line import Line
from haptic_wall.hw.servo import BusCounts, Check, Outcome, Reading
from haptic_wall.hw.settings import DriverSettings

_OK: Final = Outcome.OK
_REPLY_PATIENCE: Final = 1.5
"""Factor on the usual reply time after which a slow adapter's reply is given up: one that has just
missed the timer comes with its next expiry"""
_TRIES: Final = 3
_NEVER_NS: Final = 1 << 62
_PATIENCE_NS: Final = 100_000_000


class DynamixelGroup:
    """Servos on a line, in the order of their settings.

    Args:
        settings: Settings of each servo, with the same bus and period; the ids must differ.
        line: The bus; ``close`` closes it. Nothing is sent yet.

    Raises:
        UnfitServoError: Two servos have the same id, or see ``Driven``.
    """

    def __init__(self, settings: Sequence[DriverSettings], line: Line) -> None:
        ids = [one.id for one in settings]
        if not ids or len(set(ids)) != len(ids):
            raise UnfitServoError(
                f"A group needs servos with an id each, but has {ids}",
                advice="give each another one.",
            )
        first = settings[0]
        self.line = line
        self.exchange = Exchange(line, ids, baud=first.baud)
        self.servos = [
            Driven(one, station, self.exchange)
            for one, station in zip(settings, self.exchange.stations, strict=True)
        ]
        self._baud, self._period_s = first.baud, first.period_s
        self._polls = self._plan()
        self._now_ns = line.clock.now_ns
        self._reply_ns = 0
        """Time of a reply, where that is several periods [ns]; 0: replies are in time"""
        self.running = False
        self.left_on: list[Driven] = self.servos
        """Servos whose torque off was not read back since the last start"""

    def start(self) -> list[list[Check]]:
        """Check and set up each servo in sequence; then determine how to read them.

        Returns:
            The checks of each servo.

        Raises:
            ServoError: A servo could not be started; the torque of all servos is off, or the
                message says of which it may not be.
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
                ready.append(one.start())
                self._keep(servos[: len(ready)])
            if len(servos) > 1:
                self._choose_way()
                self._polls = self._plan()
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
        self._reply_ns = max(each.reply_ns for each in ready)
        if self._reply_ns:
            jitter_ns = 2e9 * self._period_s
            exchange.patience_ns = round(_REPLY_PATIENCE * self._reply_ns + jitter_ns)
        for one in servos:
            one.watchdog.limit_ns += exchange.patience_ns
            one.bus.reply_s = self._reply_ns * 1e-9
            one.bus.counts = one.station.counts = BusCounts()
        self._run(running=True)
        watched = Check("watched while it runs", True, *self._polls.describe())
        return [[*each.checks, watched] for each in ready]

    def request(self) -> None:
        """Request all positions, without waiting unless a Bus Watchdog may have tripped.

        Raises:
            ServoError: As ``collect``.
        """
        try:
            now_ns = self._now_ns()
            exchange = self.exchange
            if self._reply_ns and exchange.waiting:
                return
            for one in self.servos:
                watchdog = one.watchdog
                if now_ns - watchdog.heard_ns > watchdog.limit_ns:
                    watchdog.resume(now_ns, under_torque=one.goal != 0)
            polls = self._polls
            polls.asked = 0
            wide = polls.length(now_ns) if now_ns >= polls.due_ns and self.running else 0
            exchange.request(wide)
        except ServoError as error:
            raise self._all_off(error) from error.__cause__

    def collect(self, deadline_ns: int) -> list[Reading]:
        """Return the replies to the last ``request``; wait until ``deadline_ns`` [ns] at most.

        Raises:
            ServoError: The port is gone, or a servo is lost, has lost its torque or is in no state
                to be driven any longer. The torque of several is off then, or the message says of
                which it may not be; a single one is left to the caller.
        """
        exchange, readings = self.exchange, []
        asked = self._polls.asked
        try:
            # Do not wait within a period for replies that take several.
            samples = exchange.collect(0 if self._reply_ns else deadline_ns)
            waited_ns = exchange.waited_ns
            for one, sample in zip(self.servos, samples):  # noqa: B905 - quicker
                one.bus.waited_ns = waited_ns
                if asked and sample.outcome is _OK and not sample.alert:
                    # A latched error explains more than its consequences.
                    self._judge(one)
                readings.append(one.reading(sample))
            for one in self.servos if len(readings) > 1 else ():
                if one.alert:  # who drives one servo decides
                    raise ServoHealthError(f"The {one.facts.name} reports a hardware error.")
        except ServoError as error:
            raise self._all_off(error) from error.__cause__
        return readings

    def write(self, torques: Sequence[float]) -> list[float]:
        """Send the torques of all servos [N·m] in one frame, limited and rounded.

        Returns:
            The torques really sent [N·m].

        Raises:
            ServoLostError: The port is gone.
            ValueError: A torque is not a finite number, or there is not one for each. The torque of
                all is off then, or ``stop`` says so.
            RuntimeError: The group is not started.
        """
        servos = self.servos
        try:
            goals = [one.goal_of(torque) for one, torque in zip(servos, torques, strict=True)]
        except ValueError:
            self.stop()
            raise
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
        """Stop the servos if they were started and not stopped, and close the line."""
        try:
            if self.running:
                self.stop()
        finally:
            self.line.close()

    def _run(self, *, running: bool) -> None:
        self.running = running
        for one in self.servos:
            one.running = running

    def _plan(self) -> HealthPolls:
        return HealthPolls(self.exchange, self._baud, self._period_s)

    def _choose_way(self) -> None:
        """Select the fastest instruction to which all servos reply.

        Raises:
            UnfitServoError: There is none.
        """
        exchange = self.exchange
        for way in (Way.FAST, Way.SYNC):
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
        self._keep([])
        known = [one for one in self.servos if one.known]
        left = [one.table for one in known]
        for one in self.servos:
            one.watchdog.end()
        with suppress(ServoLostError):
            if self.running:
                self._run(running=False)
                with suppress(ServoLostError):  # torque off, which follows, is what counts
                    self.exchange.send([0] * len(self.servos))
            left = torque_off(left)
        self.left_on = [one for one in self.servos if not one.known or one.table in left]
        return not left

    def _of_whom(self) -> str:
        if len(self.servos) == 1:
            return ""
        return " of " + ", ".join(one.facts.name for one in self.left_on if one.known)

    def _keep(self, some: Sequence[Driven]) -> None:
        """While one of several is examined, none pushes on, and no other's watchdog trips."""
        if len(self.servos) > 1:
            zero = SyncWrite(GOAL_CURRENT, [one.station.id for one in some])
            self.exchange.kept = zero.encode([0] * len(some)) if some else b""

    def _judge(self, one: Driven) -> None:
        """Judge the health of a servo that has replied to a poll, if it was asked for its block."""
        if values := self._polls.values(one.station.block):
            if not one.health.judge(values, one.facts.name):
                one.watchdog.look(0, under_torque=one.goal != 0)
            self._polls.answered()

    def _all_off(self, error: ServoError) -> ServoError:
        """Switch the torques of several off; return the error, with what else is wrong."""
        if len(self.servos) == 1:  # its driver's user stops it
            return error
        self.stop()
        told = [str(error)]
        told += [f"T{one.trouble[1:]}." for one in self.servos if one.trouble]
        if self.left_on:
            told.append(
                f"Torque off{self._of_whom()} could not be read back: switch the power off."
            )
        return type(error)(" ".join(told))
