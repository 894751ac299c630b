"""Runs the start-up: checks and records every condition, line by line, before torque is enabled.

The order matters. Torque goes off first, since EEPROM is locked while it is on. Settings that only
a person should change (drive mode, start-up configuration) are checked before anything is written.
The goal current is zeroed *after* the mode change, which sets it to Current Limit. Torque goes on
last, and then a small push verifies its sign.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from haptic_wall.hw.dynamixel.checklist import Checklist, remedy
from haptic_wall.hw.dynamixel.health import DrivingRange
from haptic_wall.hw.dynamixel.inspection import (
    identify,
    judge_supply_and_heat,
    judge_what_only_a_person_changes,
    torque_off,
)
from haptic_wall.hw.dynamixel.link import Link
from haptic_wall.hw.dynamixel.register_access import ECHOES, Table
from haptic_wall.hw.dynamixel.samples import Sample
from haptic_wall.hw.dynamixel.sign import prove_the_sign
from haptic_wall.hw.dynamixel.tables import CURRENT_MODE, POSITION_UNIT, Model
from haptic_wall.hw.dynamixel.torque_law import TorqueLaw, torque_law
from haptic_wall.hw.dynamixel.watchdog import watchdog_units
from haptic_wall.hw.errors import ServoLostError
from haptic_wall.hw.serialport.line import FdLine, Line
from haptic_wall.hw.serialport.timer import describe, timer_file, timer_ms
from haptic_wall.hw.servo import Check, Outcome
from haptic_wall.hw.settings import DriverSettings

_SAMPLE_PATIENCE_NS: Final = 100_000_000
_SAMPLE_ATTEMPTS: Final = 3
_REPLIES: Final = 5
"""Number of replies whose median decides whether replies come in time"""
_IN_TIME: Final = 1.8
"""Periods that a reply may take: the one of its request, and 0.8 of the next"""


@dataclass(frozen=True, slots=True)
class Ready:
    """A servo with torque enabled at zero torque."""

    checks: list[Check]
    current_limit: int
    """The servo's own, in the model's current unit"""
    bounds: DrivingRange
    """The range in which it may be driven"""
    law: TorqueLaw
    """Between torque and goal current, at the present supply"""
    volts: float
    """Present supply [V]"""
    reply_ns: int
    """Time of a reply, if longer than the schedules allow [ns]; else 0"""
    longest_ns: int
    """Usual time of a reply at the worst phase of an adapter's timer [ns]"""


class Startup:
    """The start-up of one servo. The caller switches the torque off when it raises.

    Args:
        settings: The wanted settings.
        model: The configured model.
        line: The bus, for the set-up.
        link: The same bus, for positions and the probe.
        constant: Torque per current of the motor [N·m/A].
    """

    def __init__(
        self,
        settings: DriverSettings,
        model: Model,
        line: Line,
        link: Link,
        constant: float,
    ) -> None:
        where = settings.port or "the emulated bus in memory"
        self.current_limit = 0
        self._settings = settings
        self._model = model
        self._timer_file = timer_file(settings.port)
        self._descriptor = line.descriptor if isinstance(line, FdLine) else None
        self._link = link
        self._clock = line.clock
        self._constant = constant
        self.volts = model.voltage
        self.law = torque_law(model, constant, model.voltage)
        name = f"id {settings.id} at {settings.baud} baud on {where}"
        self.table = Table(link, name, model.registers)
        self._name = f"servo with id {settings.id} on {where}"
        self.list = Checklist(self._name)

    def model_number(self) -> int:
        """Return the model number; nothing else is requested from a servo of unknown kind.

        Raises:
            ServoMissingError: No reply.
            UnfitServoError: It refuses.
        """
        return self.table.ping()

    def run(self, number: int, watch: tuple[str, str]) -> Ready:
        """Check everything, set what the driver may set, and enable torque at zero torque.

        Args:
            number: Number from ``model_number``.
            watch: Descriptions of what is watched, and of what would be with enough time.

        Raises:
            ServoLostError: It stops replying.
            UnfitServoError: One or more checks failed; the message has a sentence for each.
        """
        self.report_adapter()
        if self._link.echoes:
            self.list.add("echo", True, f"{ECHOES}: switch its echo off", "none")
        self.table = identify(self.table, self._model, number, self.list)
        torque_off(self.table, self.list)
        judge_what_only_a_person_changes(self.table, self.list)
        bounds = judge_supply_and_heat(self.table, self.list, watchdog_units(self._settings))
        self.list.refuse_if_unfit()
        self.set_up()
        self.judge_limits_and_position()
        longest_ns, reply_ns = self.measure_reply()
        self.list.add("watched while it runs", True, *watch)
        self.list.refuse_if_unfit()
        self.torque_on()
        self.prove_the_sign()
        self.list.refuse_if_unfit()
        return Ready(
            self.list.checks,
            self.current_limit,
            bounds,
            self.law,
            self.volts,
            reply_ns,
            longest_ns,
        )

    def report_adapter(self) -> None:
        """Report how long the adapter holds short replies; the samples' age shows the effect."""
        port = self._settings.port
        latency_ms, found = None, "none"
        if port:
            latency_ms, found = timer_ms(port), describe(port, descriptor=self._descriptor)
        if latency_ms is not None and latency_ms > 1:
            found += f", which delays replies; `echo 1 | sudo tee {self._timer_file}` sets 1 ms"
        self.list.add("latency timer", True, found, "1 ms, or none")

    # Settings of the driver

    def set_up(self) -> None:
        """Set mode, return delay, goal and watchdog where they differ, and read them back."""
        self.table.write("bus_watchdog", 0)  # a tripped watchdog refuses every goal, 0 included
        self._settle_at("operating mode", "operating_mode", CURRENT_MODE)
        self._settle_at("return delay", "return_delay_time", 0)
        self.table.write("goal_current", 0)  # the mode change has set it to Current Limit
        self._settle_at("goal current", "goal_current", 0)
        # It limits the current in this mode too, and keeps another program's value.
        self._settle_at("goal pwm", "goal_pwm", self.table.read("pwm_limit"))
        self._settle_at("bus watchdog", "bus_watchdog", watchdog_units(self._settings))

    def judge_limits_and_position(self) -> None:
        """Check the servo's own torque limit, and its position."""
        self.current_limit = self.table.read("current_limit")
        self.volts = self.table.read("present_input_voltage") / 10
        if self._model.senses_supply_current:
            self.law = torque_law(self._model, self._constant, self.volts)
        most = self._model.current_limit
        self.list.add(
            "current limit",
            0 < self.current_limit <= most,
            f"{self.current_limit} ({self.law.torque(self.current_limit):.2f} N·m)",
            f"1 to {most}",
            remedy(
                f"Its Current Limit (38) reads {self.current_limit}, but an "
                f"{self._model.name} has at most {most}",
                "start again, and replace the servo if it still reads so.",
            )
            if self.current_limit > most
            else remedy(
                "Its Current Limit is 0, so it can make no torque",
                "raise Current Limit (38) with Dynamixel Wizard.",
            ),
        )
        self._report_speed()
        asked = self._settings.torque_limit
        origin = "configured" if self._settings.torque_constant else "stall torque over current"
        if self._model.senses_supply_current:
            origin += (
                f"; of the motor's current: the servo senses that of its supply, so goals go with "
                f"the square of the torque, in steps of at most {self.law.step:.2g} N·m"
            )
        found = f"{self._constant:.3g} N·m/A, {origin}"
        self.list.add(
            "torque per current",
            asked <= 0.0 or self.law.within(asked) > 0,
            found,
            "measured",
            remedy(
                f"Its smallest torque is {self.law.step:.2g} N·m at this supply, more "
                f"than servo.torque_limit, {asked:g} N·m",
                "raise servo.torque_limit.",
            ),
        )
        position = self._sample().counts * POSITION_UNIT
        self.list.add("position", True, f"{position:.3f} rad", "known")

    def _report_speed(self) -> None:
        """Report the speed it reaches by itself, and whether the trip speed is below that."""
        alone, most = self._model.no_load_at(self.volts), self._settings.max_speed
        found = f"{alone:.3g} rad/s at {self.volts:g} V"
        if self._settings.speed_asked and most is not None and most > alone:
            found += (
                f", below safety.max_speed {most:g}: a wall that drives the shaft does not trip; "
                "with null it does"
            )
        self.list.add("no-load speed", True, found, "above the speed that trips")

    def measure_reply(self) -> tuple[int, int]:
        """Return the time of a reply [ns], and again if longer than the schedules allow; else 0.

        Each is requested right after another has come, when an adapter's timer has just started, so
        that it takes the longest possible time. The median is used, because a machine may stall.
        """
        times = []
        for _ in range(_REPLIES):
            sampled_ns = self._sample().sampled_ns
            times.append(self._clock.now_ns() - sampled_ns)
        middle = sorted(times)[_REPLIES // 2]
        most_ns = _IN_TIME * self._settings.period_s * 1e9
        found = f"{middle * 1e-6:.1f} ms, longest {max(times) * 1e-6:.1f} ms"
        slow = middle > most_ns
        if slow:
            periods = round(middle * 1e-9 / self._settings.period_s)
            found += (
                f": one sample in {periods} periods, so a softer wall; set the adapter's latency "
                "timer to 1 ms"
            )
        self.list.add("adapter reply", True, found, f"at most {most_ns * 1e-6:.1f} ms")
        return middle, middle if slow else 0

    # Torque

    def torque_on(self) -> None:
        """Enable torque; the goal is zero."""
        on = self.table.write("torque_enable", 1) == 1
        self.list.add(
            "torque",
            on,
            "on" if on else "off",
            "on",
            remedy(
                "Its torque stays off", "check its supply voltage and Hardware Error Status (70)."
            ),
        )
        self.list.refuse_if_unfit()

    def prove_the_sign(self) -> None:
        """Check that a small torque away from the wall moves the shaft away from the wall."""
        prove_the_sign(
            self._settings,
            self.law,
            self.current_limit,
            self.table,
            self._link,
            self.list,
            clock=self._clock,
            name=self._name,
        )

    # Tools

    def _settle_at(self, name: str, register_name: str, wanted: int) -> None:
        """Write a register where it differs, and read it back."""
        before = after = self.table.read(register_name)
        if before != wanted:
            after = self.table.write(register_name, wanted)
        found = str(after) if after == before else f"{before}, set to {after}"
        title = self.table.label(register_name)
        self.list.add(
            name,
            after == wanted,
            found,
            str(wanted),
            remedy(
                f"Its {title} stays {after} when {wanted} is written",
                "reboot it, and look for another program on this bus.",
            ),
        )

    def _sample(self) -> Sample:
        """Return a position, over the same path as the running cycle."""
        for _ in range(_SAMPLE_ATTEMPTS):
            self._link.request()
            sample = self._link.collect(self._clock.now_ns() + _SAMPLE_PATIENCE_NS)
            if sample.outcome is Outcome.OK:
                return sample
        raise ServoLostError(
            f"The {self._name} answers single registers but not the block of its "
            "sample (120 to 135)",
            advice="check the cable.",
        )
