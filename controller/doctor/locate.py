"""Finds the servo at the configured or another baud rate, and changes its rate on request."""

from __future__ import annotations

import contextlib
from typing import Final

from haptic_wall.controller.doctor.adapter import examine_latency_timer
from haptic_wall.controller.doctor.report import Change, Report
from haptic_wall.controller.doctor.search import (
    IDS,
    LIKELY_FIRST,
    BaudSearch,
    FoundServo,
    opened,
    scan,
    search,
)
from haptic_wall.controller.settings.shares import COLLECT_SHARE
from haptic_wall.hw.clock import Clock
from haptic_wall.hw.dynamixel.register_access import PATIENCE_NS, Table
from haptic_wall.hw.dynamixel.registers import BAUD_RATES
from haptic_wall.hw.dynamixel.tables import model_by_number
from haptic_wall.hw.dynamixel.wire import cycle_s
from haptic_wall.hw.errors import WIRING, BaudRefusedError, ServoLostError, UnfitServoError
from haptic_wall.hw.serialport.line import Line
from haptic_wall.hw.servo import Check
from haptic_wall.hw.settings import DriverSettings

_ASKED: Final = 4
"""Searches before a servo counts as silent: a busy machine, or the process of an emulated bus, can
be late by more than one search waits"""


class Locator:
    """Finds one servo on a usable port.

    Args:
        report: Receives the checks.
        clock: Real time.
        change_baud: Whether the servo's baud rate may be changed too, with consent.
    """

    def __init__(self, report: Report, clock: Clock, change_baud: bool) -> None:
        self._report = report
        self._add = report.add
        self._clock = clock
        self._change_baud = change_baud

    def find(self, settings: DriverSettings) -> FoundServo | None:
        """Return where the servo replies: at the configured rate, else at another; None: nowhere.

        Raises:
            PortError: The port cannot be used any more.
            ServoLostError: The same.
        """
        here = self._look(settings)
        if here.refused:
            fix = "set servo.baud and the servo's Baud Rate (8) to a rate this adapter has"
            self._add(Check("baud rate", False, here.refused, f"{settings.baud} bit/s", fix))
        mine = next((servo for servo in here.servos if servo.id == settings.id), None)
        wanted = f"id {settings.id} at {settings.baud} bit/s"
        if mine is not None:
            others = [name_of(servo) for servo in here.servos if servo is not mine]
            found = "yes" + (f"; beside it {', '.join(others)}" if others else "")
            self._add(Check("baud rate", True, f"{mine.baud} bit/s", f"{settings.baud} bit/s"))
            self._add(Check("servo answers", True, found, wanted))
            return mine
        self._report.tell("no answer: searching the other baud rates")
        rates = [baud for baud in LIKELY_FIRST if baud != settings.baud]
        ids = {*IDS, settings.id}
        searches = [here]
        with contextlib.closing(scan(settings.port, rates, ids, self._clock)) as scanning:
            for one in scanning:
                mine = next((servo for servo in one.servos if servo.id == settings.id), None)
                if mine is not None:
                    return self._elsewhere(settings, mine, wanted, bool(here.refused))
                searches.append(one)
        servos = [servo for one in searches for servo in one.servos]
        self._report.reached = bool(servos)
        listed = ", ".join(map(name_of, servos))
        heard = [here] if servos else searches
        found, fix = "nothing at any rate", f"check {WIRING}"
        if garbled := [str(one.baud) for one in heard if one.garbled]:
            beside = f", beside {listed}" if servos else ""
            found = f"garbage at {', '.join(garbled)} bit/s{beside}"
            fix = (
                f"two servos have one id, perhaps id {settings.id}, or there is noise: connect one "
                "of them, and give it another id"
            )
        elif servos:
            found, fix = f"no, but {listed}", "set servo.id and servo.baud to those found"
        self._add(Check("servo answers", False, found, wanted, fix))
        return None

    def _look(self, settings: DriverSettings) -> BaudSearch:
        """Search at the configured rate; with the port open, check its latency timer as well."""
        try:
            with opened(settings.port, settings.baud, self._clock) as line:
                self._add(examine_latency_timer(settings.port))
                return _asked(line, settings.baud, settings.id)
        except BaudRefusedError as error:
            return BaudSearch(settings.baud, [], 0, str(error))

    def _elsewhere(
        self, settings: DriverSettings, found: FoundServo, wanted: str, refused: bool
    ) -> FoundServo:
        """Report that the servo replies at another rate, and change its rate on request.

        It never sets a rate that the adapter does not support: the servo would be unreachable.
        """
        question = f"baud rate of {name_of(found)} -> {settings.baud}"
        if self._change_baud and not refused and self._report.may(question):
            change, now = self._set_baud(settings, found)
            self._report.note(change)
            if change.verified:
                self._add(Check("baud rate", True, f"{now.baud} bit/s", f"{settings.baud} bit/s"))
                text = f"yes; it was at {found.baud} bit/s"
                self._add(Check("servo answers", True, text, wanted))
                return now
        fixes = []
        if cycle_s(found.baud) <= COLLECT_SHARE * settings.period_s:
            fixes.append(f"set servo.baud={found.baud}")
        if not refused:
            command = "`haptic-wall doctor CONFIG --fix --change-baud`"
            fixes.append(f"change the servo's rate with {command}")
        fix = ", or ".join(fixes) or "set servo.baud to a faster rate that this adapter has"
        self._add(Check("servo answers", False, f"at {found.baud} bit/s", wanted, fix))
        return found

    def _set_baud(self, settings: DriverSettings, found: FoundServo) -> tuple[Change, FoundServo]:
        """Write Baud Rate, and find the servo again."""
        name, before = "baud rate", str(found.baud)
        model = model_by_number(found.model_number)
        value = BAUD_RATES.index(settings.baud)
        if model is None or value > model.registers["baud_rate"].maximum:
            return Change(name, before, f"it cannot have {settings.baud}", False), found
        with opened(settings.port, found.baud, self._clock) as line:
            table = Table.on(line, found.baud, found.id, settings.port, model)
            try:
                if table.read("torque_enable"):
                    return Change(name, before, "its torque is on, so it is locked", False), found
                # It cannot be read back at this rate.
                table.try_write("baud_rate", value, PATIENCE_NS[:1])
            except (ServoLostError, UnfitServoError) as error:
                return Change(name, before, str(error), False), found
        with opened(settings.port, settings.baud, self._clock) as line:
            answered = _asked(line, settings.baud, found.id).servos
        now = next((servo for servo in answered if servo.id == found.id), None)
        if now is None:
            return Change(name, before, f"silent at {settings.baud}", False), found
        return Change(name, before, str(now.baud), True), now


def _asked(line: Line, baud: int, servo_id: int) -> BaudSearch:
    """Search for one servo, up to ``_ASKED`` times until it answers."""
    for _ in range(_ASKED):
        found = search(line, baud, {servo_id}, to_the_end=False)
        if any(servo.id == servo_id for servo in found.servos):
            break
    return found


def name_of(servo: FoundServo) -> str:
    """Return a servo's model, id and baud rate, for people."""
    return f"{servo.model or 'unknown model'} id {servo.id} at {servo.baud} bit/s"
