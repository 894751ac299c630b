"""Drives the servos of one bus, one or several: reads all in one cycle, commands all in one frame.

Several are read by the fastest instruction that all of them support, unless another one is asked
for; if a servo does not reply, only its own reading is lost. An error names the servo it is about,
and carries its id.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Final

from haptic_wall.hw.dynamixel.codec import SyncWrite
from haptic_wall.hw.dynamixel.cut import torque_off
from haptic_wall.hw.dynamixel.driven import NEVER_NS, Driven
from haptic_wall.hw.dynamixel.exchange import GOAL_CURRENT, Exchange
from haptic_wall.hw.dynamixel.health import HealthPolls
from haptic_wall.hw.dynamixel.register_access import Table
from haptic_wall.hw.dynamixel.registers import POSITION_UNIT
from haptic_wall.hw.dynamixel.startup import Startup
from haptic_wall.hw.dynamixel.wire import Read, asking_s
from haptic_wall.hw.errors import (
    GivenUpError,
    PortLostError,
    Problem,
    ServoError,
    ServoLostError,
    UnfitServoError,
)
from haptic_wall.hw.serialport.line import Line
from haptic_wall.hw.servo import BusCounts, Check, Facts, Outcome, Reading, Traffic
from haptic_wall.hw.settings import DriverSettings

_OK: Final = Outcome.OK
_NAN: Final = math.nan


@contextmanager
def _about(one: Driven) -> Iterator[None]:
    """Let an error carry the id of the servo it is about."""
    try:
        yield
    except PortLostError:
        raise  # not its fault
    except ServoError as error:
        error.id = one.station.id
        raise


class DynamixelGroup:
    """A ``Bus`` of servos on a line, real or emulated, in the order of their settings.

    After any error the caller calls ``stop``.

    After ``start`` a servo needs an instruction within every Bus Watchdog period; otherwise it
    drops its torque and silently refuses goals. ``request`` detects such a pause, and may wait
    then: it arms the watchdog again if that tripped while the torque was zero.

    Args:
        settings: Settings of each servo, with the same bus and period; the ids must differ.
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
        self._baud, self._period_s, self._read = first.baud, first.period_s, first.read
        self.traffic = Traffic([one.station.counts for one in self.servos])
        self._polls = HealthPolls(self.exchange, first.baud, first.period_s)
        self._now_ns = line.clock.now_ns
        self.running = False
        self.left_on: list[Driven] = self.servos
        """Servos whose torque off was not read back since the last start"""
        self.given_up: Callable[[], bool] = lambda: False

    @property
    def facts(self) -> list[Facts]:
        """Return the facts of each servo; some are known after ``start`` only."""
        return [one.facts for one in self.servos]

    @property
    def trouble(self) -> str:
        """Return what was wrong with the servos; see ``Bus``."""
        told = [one.trouble for one in self.servos if one.trouble]
        if len(self.servos) > 1 and not self.running:
            left = [one.facts.name for one in self.left_on if one.known]
            told += [f"torque off was not read back from {', '.join(left)}"] if left else []
        return "; ".join(told)

    def health(self) -> list[tuple[float, float]]:
        """Return each servo's last supply [V] and temperature [°C]; supply 0: not known."""
        seen = (one.health for one in self.servos)
        return [(each["supply"] / 10, float(each["temperature"])) for each in seen]

    def start(self) -> list[list[Check]]:
        """Check and set up each servo in sequence; then switch on one torque after another.

        Goals are zero. Where one servo is refused, none has had a torque.

        Returns:
            The checks of each servo.

        Raises:
            StrangeServoError: One is of no known model; nothing was written to it.
            GivenUpError: The start was given up; see ``Bus``.
            ServoError: A servo could not be started; the torque of all servos is off, or the
                message says of which it may not be.
        """
        exchange, servos, count = self.exchange, self.servos, len(self.servos)
        self.left_on = servos
        chosen = []
        for one in servos:
            one.forget()
        try:
            ready, longest_s = self._started()
            hold_s = longest_s - asking_s(self._baud)
            if count > 1:
                chosen.append(self._choose_way())
                hold_s = longest_s  # a timer's whole period: it ran from the request on
                for one in servos:
                    with _about(one):
                        one.resume(self._now_ns())  # idle meanwhile
            self._polls = HealthPolls(exchange, self._baud, self._period_s, hold_s)
        except BaseException as error:
            self._off()
            left = ", ".join(one.facts.name for one in self.left_on if one.known)
            if not left or not isinstance(error, ServoError):
                raise
            told = f"Torque off of {left} could not be read back: switch the power off."
            more = type(error)(Problem(str(error), advice=told, mark=" "))
            more.id = error.id
            raise more from error.__cause__
        traffic = self.traffic
        traffic.longest_s = self._polls.longest_s
        traffic.counts = []
        for one in servos:
            one.station.counts = BusCounts()
            traffic.counts.append(one.station.counts)
        self.running = True
        chosen.append(Check("watched while it runs", True, *self._polls.describe()))
        return [[*checks, *chosen] for checks in ready]

    def _started(self) -> tuple[list[list[Check]], float]:
        """Check every servo, then enable every one; return checks and the longest reply [s]."""
        servos, exchange, several = self.servos, self.exchange, len(self.servos) > 1
        ready, checked, longest_ns = [], dict[Driven, Startup](), 0
        for one in servos:
            self._go_on()
            exchange.select([one.station])
            with _about(one):
                startup = Startup(one)
                longest_ns = max(longest_ns, startup.check())
                if several:
                    one.obeys_only_itself(exchange.by_id)
            checked[one] = startup
            self._keep(list(checked))
        for one, startup in checked.items():
            self._go_on()
            self._keep([other for other in servos if other is not one])
            exchange.select([one.station])
            with _about(one):
                if several:
                    one.look(0)  # the checks of others may have taken longer than its watchdog
                ready.append(startup.enable())
        self._keep(servos)
        return ready, longest_ns * 1e-9

    def request(self) -> None:
        """Request all positions, without waiting unless a Bus Watchdog may have tripped.

        Raises:
            ServoLostError: The port is gone, or a servo no longer answers.
            TorqueLostError: A Bus Watchdog has ended a torque.
        """
        now_ns = self._now_ns()
        for one in self.servos:
            if now_ns - one.heard_ns > one.silence_ns:
                with _about(one):
                    one.resume(now_ns)
        polls = self._polls
        polls.asked = None
        wide = polls.length(now_ns) if now_ns >= polls.due_ns and self.running else 0
        self.exchange.request(wide, polls.asked)

    def collect(self, deadline_ns: int) -> list[Reading]:
        """Return the replies to the last ``request``; wait until ``deadline_ns`` [ns] at most.

        Raises:
            ServoError: The port is gone, or a servo has lost its torque or is in no state to be
                driven any longer.
        """
        exchange, polls, readings = self.exchange, self._polls, []
        asked = polls.asked
        polls.patience_s = (deadline_ns - exchange.sent_ns) * 1e-9
        samples = exchange.collect(deadline_ns)
        self.traffic.waited_ns = exchange.waited_ns
        for one, sample in zip(self.servos, samples):  # noqa: B905 - quicker
            outcome, counts, current, alert, sampled_ns = sample
            if outcome is not _OK:
                if asked is one.station and polls.silent(asked):
                    with _about(one):
                        raise one.silent()
                readings.append(Reading(outcome, _NAN, 0, sampled_ns, _NAN, False))
                continue
            # A latched error explains more than its consequences.
            if asked is one.station and not alert:
                with _about(one):
                    one.judge(polls.values(asked.block))
            one.heard_ns = sampled_ns
            one.alert |= alert
            position, torque = counts * POSITION_UNIT, one.law.torque(current)
            readings.append(Reading(outcome, position, counts, sampled_ns, torque, alert))
        return readings

    def write(self, torques: Sequence[float]) -> list[float]:
        """Send the torques of all servos [N·m] in one frame, limited and rounded.

        A servo that senses its supply current gives this torque only at a standstill: it gives less
        when it moves with the torque, more when it moves against it.

        Returns:
            The torques really sent [N·m].

        Raises:
            ServoLostError: The port is gone.
            ValueError: A torque is not a finite number, or there is not one for each; nothing was
                sent.
            RuntimeError: The group is not started.
        """
        if not self.running:
            raise RuntimeError("a torque was written while torque is off; call start first")
        goals = []
        for one, torque in zip(self.servos, torques, strict=True):
            most = one.facts.torque_limit
            fine = torque if -most <= torque <= most else one.limited(torque)
            goals.append(one.law.goal(fine))
        self.exchange.send(goals)
        sent = []
        for one, goal in zip(self.servos, goals):  # noqa: B905 - checked
            one.goal = goal
            sent.append(one.law.torque(goal))
        return sent

    def stop(self) -> bool:
        """Send zero torque to all, switch all torques off and read them back.

        If no known model has replied as one of them, nothing was written to that one.

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

    def _choose_way(self) -> Check:
        """Select the fastest instruction to which all servos reply, among those asked for.

        Raises:
            UnfitServoError: There is none.
        """
        exchange, wanted = self.exchange, self._read
        ways: tuple[Read, ...] = ("fast", "sync") if wanted == "auto" else (wanted,)
        found = ""
        for way in ways:
            exchange.select(exchange.stations, way)
            samples = zip(self.servos, exchange.sampled(), strict=True)
            silent = [one for one, (outcome, *_) in samples if outcome]
            if not silent:
                return Check("read", True, f"{way}{found}", wanted)
            if way == "fast":  # an old one silences others too
                old = [one for one in silent if not one.model.knows_fast_reads(one.firmware)]
                silent = old or silent
            told = [f"id {one.station.id} (firmware {one.firmware})" for one in silent]
            found += f", as a {way} read is not answered by {' and '.join(told)}"
        raise UnfitServoError(
            f"The servos answer one by one but not in one cycle{found}",
            advice="check the cable, and that no two have the same id"
            + (f", or set bus.read=auto instead of {wanted}." if wanted == "fast" else "."),
        )

    def _go_on(self) -> None:
        if self.given_up():
            raise GivenUpError("The start was given up")

    def _off(self) -> None:
        """Send zero goals if this driver has the torque on; switch it off and read it back.

        Nothing is written to a servo with an unknown control table.
        """
        self._keep([])
        known = [one for one in self.servos if one.known]
        left: Collection[Table] = [one.table for one in known]
        for one in self.servos:
            one.silence_ns = NEVER_NS
        with suppress(ServoLostError):
            if self.running:
                self.running = False
                with suppress(ServoLostError):  # torque off, which follows, is what counts
                    self.exchange.rest()
            left = torque_off(list(left))
        self.left_on = [one for one in self.servos if not one.known or one.table in left]

    def _keep(self, some: Sequence[Driven]) -> None:
        """While one of several is examined, none pushes on, and no other's watchdog trips."""
        if len(self.servos) > 1:
            zero = SyncWrite(GOAL_CURRENT, [one.station.id for one in some])
            self.exchange.kept = zero.encode([0] * len(some)) if some else b""
