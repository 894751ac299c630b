"""Runs the doctor's checks in order, from the port to the processor.

Checks that depend on a failed one are left out. No check enables torque. Without consent the checks
only read registers. They do not read in a loop from a servo whose torque is on, because this may
keep its Bus Watchdog from tripping.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Final

from haptic_wall.controller.doctor import machine, timing
from haptic_wall.controller.doctor.adapter import examine_port
from haptic_wall.controller.doctor.cycles import Phase, Series
from haptic_wall.controller.doctor.locate import Locator, name_of
from haptic_wall.controller.doctor.measure import measure
from haptic_wall.controller.doctor.replies import Replies
from haptic_wall.controller.doctor.report import Consent, Report, Tell, question, told
from haptic_wall.controller.doctor.search import FoundServo, opened
from haptic_wall.controller.doctor.wall import judge_wall
from haptic_wall.controller.processes.emulator import emulated_bus, emulator_arguments
from haptic_wall.controller.runtime.lateness.machine_setup import machine_setup
from haptic_wall.controller.runtime.realtime import Setting, pick_cores
from haptic_wall.controller.settings.config import Config
from haptic_wall.hw.clock import MonotonicClock
from haptic_wall.hw.dynamixel.drivable import drivable
from haptic_wall.hw.dynamixel.examine.finding import Change, Finding, not_applicable, of_error
from haptic_wall.hw.dynamixel.examine.judgement import Judgement, in_order_of_repair, judge
from haptic_wall.hw.dynamixel.examine.registers import ServoAccess, mend, read_all, set_status_level
from haptic_wall.hw.dynamixel.inspection import WATCHDOG_FIRMWARE
from haptic_wall.hw.dynamixel.tables import MODELS, RETURN_DELAY_UNIT_NS, Model, model_by_number
from haptic_wall.hw.dynamixel.torque_law import torque_law
from haptic_wall.hw.errors import (
    PortBusyError,
    PortError,
    ServoError,
    ServoLostError,
    UnfitServoError,
)
from haptic_wall.hw.serialport.port import kept_settings, open_port
from haptic_wall.hw.settings import DriverSettings, ServoSettings

_CABLE: Final = "check the cable and the power supply"
_EMULATOR: Final = "check that the emulated bus runs and gets processor time"
_OF_THE_SERVO: Final = ("model", "firmware", "registers")
_ON_THE_BUS: Final = (
    "port",
    "rights",
    "adapter",
    "used by",
    "latency timer",
    "baud rate",
    "servo answers",
    "model",
    "firmware",
    "registers",
    "reply time",
    "schedule",
)


def examine(config: Config, tell: Tell, consent: Consent | None, change_baud: bool) -> Report:
    """Examine the testbed that a configuration describes.

    Args:
        config: The configuration. If its port is an emulated bus, the bus is started and ended
            here.
        tell: Called with the current step.
        consent: Asked before each change; None: nothing is changed.
        change_baud: Whether the servo's baud rate may be changed too.

    Raises:
        ServoError: The emulated bus did not start.
    """
    checkup = _Checkup(config, tell, consent, change_baud)
    settings = config.servo_settings()
    if config.servo.backend == "dynamixel":
        with _port_of(config, settings) as path:
            checkup.bus(replace(settings.driver(), port=path))
    else:
        why = f"a servo of the backend {config.servo.backend} is not examined"
        if config.servo.kind == "simulated":
            why = "the servo is simulated in this process"
        checkup.report.findings.add(*(not_applicable(name, why) for name in _ON_THE_BUS))
        checkup.machine(measure(config, None))
    return checkup.report


@contextlib.contextmanager
def _port_of(config: Config, settings: ServoSettings) -> Iterator[str]:
    """Yield the configured port, or that of an emulated bus that runs meanwhile."""
    if config.servo.kind != "emulated":
        yield settings.port
        return
    cores = pick_cores(config.realtime.core)[1]
    with emulated_bus(emulator_arguments(settings), cores) as (_, path):
        assert path is not None  # nobody stops it while it starts
        yield path


class _Checkup:
    def __init__(
        self, config: Config, tell: Tell, consent: Consent | None, change_baud: bool
    ) -> None:
        self.report = Report()
        self._config = config
        self._tell = tell
        self._consent = consent
        self._clock = MonotonicClock()
        self._return_delay_ns = 0
        self._locator = Locator(self.report, self._clock, tell, consent, change_baud)
        self._add = self.report.findings.add
        self._check = _EMULATOR if config.servo.is_emulated else _CABLE

    # The bus

    def bus(self, settings: DriverSettings) -> None:
        """Run all checks from the port to the processor."""
        self._tell(f"port {settings.port}")
        self._add(*examine_port(settings.port))
        measured = None
        if self.report.findings.wrong:
            self.report.reached = False
            self.report.leave_out("latency timer", "baud rate", "servo answers", *_OF_THE_SERVO)
        else:
            with kept_settings(settings.port):
                measured = self._servo(settings)
        if measured is None:
            self.report.leave_out("reply time", "schedule")
            if any(finding.name == "used by" for finding in self.report.findings.wrong):
                # A measurement would take the core from the program that drives the servo there.
                self.report.leave_out("wake-up lateness", "real-time rights")
                self._core()
                return
            measured = measure(self._config, None)
        self.machine(measured)

    def _servo(self, settings: DriverSettings) -> dict[str, Any] | None:
        """Run the servo's checks; return the measurements, if possible."""
        try:
            found = self._locator.find(settings)
            if found is None:
                self.report.leave_out(*_OF_THE_SERVO)
                return None
            quiet = self._set_up(settings, found)
            if not quiet or found.baud != settings.baud:
                return None
            self._tell("reply time, and both schedules at every phase: about 5 s")
            descriptor = open_port(settings.port, settings.baud)
            try:
                return measure(self._config, descriptor)
            finally:
                os.close(descriptor)
        except PortBusyError as error:  # by a process whose open files this user may not see
            self.report.reached = False
            self._add(of_error("used by", error, "nobody", "end that program"))
            self.report.leave_out("latency timer", "baud rate", "servo answers", *_OF_THE_SERVO)
        except PortError as error:
            self.report.reached = False
            self._add(of_error("port", error, "a port that stays", "check the adapter"))
        except ServoError as error:
            self._add(of_error("servo answers", error, "answers always", self._check))
        return None

    # The servo

    def _set_up(self, settings: DriverSettings, found: FoundServo) -> bool:
        """Check model, firmware and registers; return whether torque is off."""
        model = self._model(settings, found)
        if model is None:
            self.report.leave_out("firmware", "registers")
            return False
        self._tell(f"registers of {name_of(found)}")
        self._firmware(model, found.firmware)
        with opened(settings.port, found.baud, self._clock) as line:
            servo = ServoAccess.of(line, found.baud, found.id, settings.port, model)
            if not self._status_level(servo):
                self.report.leave_out("registers")
                return False
            judged = self._judge(servo, settings, model, found.firmware)
            if self._consent is not None and self._mend(servo, judged):
                again = self._judge(servo, settings, model, found.firmware)
                before = {judgement.finding.name: judgement.finding for judgement in judged}
                judged = [told(judgement, before) for judgement in again]
        self._add(*(judgement.finding for judgement in judged))
        return next(j.finding.ok for j in judged if j.finding.name == "torque")

    def _model(self, settings: DriverSettings, found: FoundServo) -> Model | None:
        """Return the found model, judged against the configured one; None if it is unknown."""
        model = model_by_number(found.model_number)
        number = found.model_number
        text = f"{model.name} ({number})" if model else f"unknown model ({number})"
        fix, ok = "", model is not None and model.name == settings.model
        if model is not None and not model.current_mode:
            fix = "it has no current mode, so it cannot follow a torque: use another model"
            ok = False
        elif not ok:
            known = f", or set servo.model={model.name}" if model else ""
            fix = f"connect an {settings.model}{known}"
        elif settings.model in MODELS:
            try:
                drivable(settings)
            except UnfitServoError as error:
                ok, fix = False, str(error)
        self._add(Finding("model", ok, text, settings.model, fix))
        return model

    def _firmware(self, model: Model, firmware: int) -> None:
        ok = firmware >= WATCHDOG_FIRMWARE
        fix = ""
        if not ok:
            fix = (
                "update it with Dynamixel Wizard:"
                f" from {WATCHDOG_FIRMWARE} on it has a Bus Watchdog"
            )
        elif not model.knows_fast_reads(firmware):
            fix = f"{model.fast_sync_read_firmware} or later reads several servos in one reply"
        wanted = f"at least {WATCHDOG_FIRMWARE}"
        self._add(Finding("firmware", ok, str(firmware), wanted, fix))

    def _status_level(self, servo: ServoAccess) -> bool:
        """Whether the servo replies to reads and writes; otherwise no other check is possible."""
        register = servo.table.registers["status_return_level"]
        try:
            found = str(level := servo.table.read(register.name))
        except ServoLostError:
            found, level = "no replies to reads", 0
        if level != register.default and self._may(f"status return level: {found} -> 2"):
            change = set_status_level(servo)
            self._note(change)
            if change.verified:
                found, level = f"{found}, now {change.after}", register.default
        ok = level == register.default
        fix = "" if ok else "it does not confirm writes: write 2 to Status Return Level (68)"
        wanted = str(register.default)
        self._add(Finding("status return level", ok, found, wanted, fix, fixable=not ok))
        return level > 0

    def _judge(
        self, servo: ServoAccess, settings: DriverSettings, model: Model, firmware: int
    ) -> list[Judgement]:
        constant = settings.torque_constant or model.torque_constant or 0.0
        examined = read_all(servo, model, firmware)
        delay = examined.values["return_delay_time"] or 0
        self._return_delay_ns = delay * RETURN_DELAY_UNIT_NS
        judged = judge(examined, settings.torque_limit, constant)
        current, volts = (
            examined.values[name] or 0 for name in ("current_limit", "present_input_voltage")
        )
        if 0 < current <= model.current_limit:
            law = torque_law(model, constant, volts / 10)
            judged.append(Judgement(judge_wall(self._config, current, model.current_limit, law)))
        return judged

    def _mend(self, servo: ServoAccess, judged: list[Judgement]) -> bool:
        """Repair the registers for which there is consent; return whether any repair was tried."""
        tried = False
        for finding, repair in in_order_of_repair(judged):
            if repair is None or not self._may(question(finding, repair)):
                continue
            tried = True
            self._note(mend(servo, finding.name, repair))
        return tried

    def _may(self, question: str) -> bool:
        return self._consent is not None and self._consent(question)

    def _note(self, change: Change) -> None:
        self.report.changes.append(change)
        self._tell(f"{change}")  # at once: after an interrupt the user should know what was changed

    # The machine

    def machine(self, measured: dict[str, Any]) -> None:
        """Judge the measurements of the bus, if any, and of the machine."""
        config = self._config
        lateness = machine.judge_lateness(measured["lateness_ns"], config.period_ns)
        if measured["failed"] is not None:
            error = ServoError(measured["failed"])
            self._add(of_error("reply time", error, "answers always", self._check))
            self.report.leave_out("schedule")
        elif measured["replies"] is not None:
            replies, series = Replies(**measured["replies"]), _series(measured["series"])
            self._timing(replies, series, stalls=not lateness.ok)
        settings = [Setting(**setting) for setting in measured["realtime"]]
        self._add(lateness)
        self._add(*machine.judge_rights(settings, config.realtime.profile))
        self._core()

    def _core(self) -> None:
        core, _ = pick_cores(self._config.realtime.core)
        self._add(*machine.judge_setup(machine_setup(core)))

    def _timing(self, replies: Replies, series: list[Series], stalls: bool) -> None:
        config = self._config
        assert config.servo.baud is not None
        most_missed = min(timing.MOST_MISSED, config.safety.max_loss)
        schedule = config.servo.schedule
        if schedule == "auto":
            schedule = timing.suits(series, most_missed) or "immediate"
        wanted = timing.Wanted(
            schedule,
            config.loop.rate_hz,
            config.servo.baud,
            most_missed,
            self._return_delay_ns,
            stalls,
        )
        self._add(*timing.judge_timing(replies, series, wanted))
        self.report.cycles = series
        self.report.suits = timing.suits(series, wanted.most_missed)


def _series(found: list[dict[str, Any]]) -> list[Series]:
    return [
        Series(**{**one, "phases": [Phase(**phase) for phase in one["phases"]]}) for one in found
    ]
