"""Runs the doctor's checks in order, from the port to the processor.

Checks that depend on a failed one are left out. No check enables torque. Without consent the checks
only read registers. They do not read in a loop from a servo whose torque is on, because this may
keep its Bus Watchdog from tripping.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from haptic_wall.controller.doctor.adapter import kind_of_port
from haptic_wall.controller.doctor.locate import Locator, name_of
from haptic_wall.controller.doctor.measure import measure
from haptic_wall.controller.doctor.mending import mend, question
from haptic_wall.controller.doctor.replies import Replies
from haptic_wall.controller.doctor.report import Consent, Report, Tell, not_applicable, of_error
from haptic_wall.controller.doctor.search import FoundServo, opened
from haptic_wall.controller.doctor.timing import judge_lateness, judge_replies, judge_rights
from haptic_wall.controller.processes.emulator import emulated_bus, emulator_arguments
from haptic_wall.controller.runtime.machine_setup import machine_setup
from haptic_wall.controller.runtime.realtime import pick_cores
from haptic_wall.controller.settings.axes_rules import UNLIKE_ADVICE, unlike_model
from haptic_wall.controller.settings.config import Config
from haptic_wall.hw.clock import MonotonicClock
from haptic_wall.hw.dynamixel.register_access import Table
from haptic_wall.hw.dynamixel.rules import (
    STATUS_LEVEL,
    Rule,
    judge,
    judge_firmware,
    judge_model,
    read_servo,
)
from haptic_wall.hw.dynamixel.tables import Model, model_by_number
from haptic_wall.hw.errors import (
    WIRING,
    PortBusyError,
    PortError,
    ServoError,
)
from haptic_wall.hw.serialport.port import open_port
from haptic_wall.hw.servo import Check
from haptic_wall.hw.settings import DriverSettings, ServoSettings


def examine(
    config: Config,
    tell: Tell,
    consent: Consent | None,
    change_baud: bool,
) -> Report:
    """Examine the testbed that a configuration describes, with all of its axes.

    Args:
        config: The configuration. If its port is an emulated bus, the bus is started and ended
            here.
        tell: Called with the current step.
        consent: Asked before each change; None: nothing is changed.
        change_baud: Whether the servo's baud rate may be changed too.

    Raises:
        ServoError: The emulated bus did not start.
    """
    report = Report(tell, consent)
    checkup = _Checkup(config, report, change_baud)
    if config.servo.backend == "dynamixel":
        servos = config.servos()
        with _port_of(config, servos) as path:
            axes = zip(config.each, servos, strict=True)
            checkup.bus({name: replace(one, port=path) for name, one in axes})
    else:
        why = f"a servo of the backend {config.servo.backend} is not examined"
        if config.servo.kind == "simulated":
            why = "the servo is simulated in this process"
        report.add(not_applicable("bus", why))
        checkup.machine(measure(config, None))
    return report


@contextlib.contextmanager
def _port_of(config: Config, servos: Sequence[ServoSettings]) -> Iterator[str]:
    """Yield the configured port, or that of an emulated bus that runs meanwhile."""
    if config.servo.kind != "emulated":
        yield servos[0].port
        return
    cores = pick_cores(config.realtime.core)[1]
    with emulated_bus(emulator_arguments(servos), cores) as (_, path):
        assert path is not None  # nobody stops it while it starts
        yield path


class _Checkup:
    def __init__(self, config: Config, report: Report, change_baud: bool) -> None:
        self.report = report
        self._add = report.add
        self._config = config
        self._clock = MonotonicClock()
        self._locator = Locator(report, self._clock, change_baud)

    # The bus

    def bus(self, axes: Mapping[str, DriverSettings]) -> None:
        """Run all checks from the port to the processor, for the axes of one bus."""
        port = next(iter(axes.values())).port
        self.report.tell(f"port {port}")
        self._add(Check("port", True, f"{port}: {kind_of_port(port)}", "a serial port"))
        measured = self._servos(axes)
        self.report.axis = ""
        if measured is None:
            if "used by" in (check.name for check in self.report.wrong):
                # A measurement would take the core from the program that drives the servo there.
                self._core()
                return
            measured = measure(self._config, None)
        self.machine(measured)

    def _servos(self, axes: Mapping[str, DriverSettings]) -> dict[str, Any] | None:
        """Run the checks of each servo; return the measurements, if possible."""
        report, ready, fast = self.report, True, True
        try:
            for name, settings in axes.items():
                report.axis = name
                found = self._examined(settings) if report.reached else None
                if found is None:
                    ready = False
                    continue
                model = model_by_number(found.model_number)
                fast &= model is not None and model.knows_fast_reads(found.firmware)
            report.axis = ""
            if not ready:
                return None
            report.tell("reply time")
            wanted = settings.read
            read = "plain" if len(axes) == 1 else wanted
            if read == "auto":
                read = "fast" if fast else "sync"
            descriptor = open_port(settings.port, settings.baud)
            try:
                return measure(self._config, descriptor, [one.id for one in axes.values()], read)
            finally:
                os.close(descriptor)
        except PortBusyError as error:
            self.report.reached = False
            self._add(of_error("used by", error, "nobody", "end that program"))
        except PortError as error:
            self.report.reached = False
            self._add(of_error("port", error, "a serial port", "check the adapter"))
        except ServoError as error:  # of the measurement
            self._add(_lost(error))
        return None

    # The servo

    def _examined(self, settings: DriverSettings) -> FoundServo | None:
        """Find a servo and check it; None: it is not ready to be timed.

        Raises:
            PortError: The port cannot be used any more.
        """
        try:
            found = self._locator.find(settings)
            if found is not None and self._set_up(settings, found):
                return found if found.baud == settings.baud else None
        except PortError:
            raise
        except ServoError as error:  # of this one: the others may be well
            self._add(_lost(error))
        return None

    def _set_up(self, settings: DriverSettings, found: FoundServo) -> bool:
        """Check model, firmware and registers; return whether torque is off."""
        report, number = self.report, found.model_number
        self._add(judge_model(number, settings.model))
        if unlike := unlike_model(self._config.each[report.axis]):
            self._add(Check("belief", False, unlike, f"that of {settings.model}", UNLIKE_ADVICE))
        model = model_by_number(number)
        if model is None:
            return False
        report.tell(f"registers of {name_of(found)}")
        self._add(judge_firmware(model, found.firmware))
        with opened(settings.port, found.baud, self._clock) as line:
            table = Table.on(line, found.baud, found.id, settings.port, model)
            if report.consent is not None:  # as a start: a silent second servo takes it too
                table.write("status_return_level", STATUS_LEVEL)
            table.be_alone()
            table.registers = model.registers_at(found.firmware)
            checks, repairs = self._judge(table, settings, model)
            if self._mend(table, checks, repairs):
                checks, _ = self._judge(table, settings, model)
        self._add(*checks.values())
        return checks["torque"].ok

    def _judge(
        self, table: Table, settings: DriverSettings, model: Model
    ) -> tuple[dict[str, Check], dict[str, Rule]]:
        """Return all checks of the registers, and the rules that can mend those that fail."""
        constant = settings.torque_constant or model.torque_constant or 0.0
        seen = read_servo(table, model, constant, settings.torque_limit)
        checks, repairs = {}, {}
        for rule, check in judge(seen):
            checks[check.name] = check
            if check.fixable:
                repairs[check.name] = rule
        return checks, repairs

    def _mend(self, table: Table, checks: Mapping[str, Check], repairs: Mapping[str, Rule]) -> bool:
        """Make the repairs for which there is consent; return whether any was tried.

        A reboot comes last.
        """
        tried = False
        for name, rule in sorted(repairs.items(), key=lambda item: not item[1].register):
            if self.report.may(question(checks[name], rule)):
                tried = True
                self.report.note(mend(table, self._clock, name, rule))
        return tried

    # The machine

    def machine(self, measured: dict[str, Any]) -> None:
        """Judge the measurements of the bus, if any, and of the machine."""
        config = self._config
        settings = [Check(**setting) for setting in measured["realtime"]]
        granted = any(each.name == "scheduler" and each.ok for each in settings)
        if measured["failed"] is not None:
            error = ServoError(measured["failed"])
            self._add(of_error("reply time", error, "answers always", f"check {WIRING}"))
        elif measured["replies"] is not None:
            replies = Replies(**measured["replies"])
            baud = config.servo.baud or 0
            asked, rate = config.servo.schedule, config.loop.rate_hz
            self._add(*judge_replies(replies, asked, rate, baud, config.safety.max_loss))
        self._add(judge_lateness(measured["lateness_ns"], config.period_ns, granted=granted))
        self._add(*judge_rights(settings, config.realtime.profile))
        self._core()

    def _core(self) -> None:
        core, _ = pick_cores(self._config.realtime.core)
        self._add(*machine_setup(core))


def _lost(error: ServoError) -> Check:
    """Return the check of a servo whose replies do not come, or are not its own."""
    return of_error("servo answers", error, "answers always", f"check {WIRING}")
