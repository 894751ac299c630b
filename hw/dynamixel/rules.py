"""What a servo must be set to, in one table: a start refuses by it, ``doctor`` prints and mends.

A rule reads registers and gives a verdict on them. Settings that a person made are changed only by
a person, or by a person's ``doctor --fix``. Reading changes nothing in the servo.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

from haptic_wall.hw.dynamixel.hardware_errors import error_names, what_to_do
from haptic_wall.hw.dynamixel.health import DrivingRange
from haptic_wall.hw.dynamixel.register_access import Table
from haptic_wall.hw.dynamixel.tables import (
    CURRENT_MODE,
    POSITION_UNIT,
    RETURN_DELAY_UNIT_NS,
    WATCHDOG_TRIPPED,
    Model,
    model_by_number,
)
from haptic_wall.hw.dynamixel.torque_law import TorqueLaw, torque_law
from haptic_wall.hw.errors import Problem, ServoLostError
from haptic_wall.hw.servo import Check

WATCHDOG_FIRMWARE: Final = 38
"""First firmware with a Bus Watchdog"""
STATUS_LEVEL: Final = 2
"""Status Return Level at which the servo replies to everything"""
_FIX: Final = "`haptic-wall doctor CONFIG --fix`"
_MODES: Final = ("current", "velocity", "", "position", "extended position")
_WARM: Final = 8
"""Distance to the highest temperature from which it is reported [°C]"""


class Verdict(NamedTuple):
    """The judgement of one thing.

    With ``ok``, ``advice`` says what could be better, unless it belongs to a fault, ``why``.
    """

    ok: bool
    found: str
    wanted: str
    why: str = ""
    """The fault as the begin of a sentence, which ``advice`` completes after a colon"""
    advice: str = ""
    """The remedy; empty: none is needed"""

    def check(self, name: str, *, fixable: bool = False) -> Check:
        """Return the line for people.

        Args:
            name: Name of the check.
            fixable: Whether ``doctor --fix`` can repair the fault.
        """
        why = "" if self.ok else self.why
        advice = "" if self.ok and self.why else self.advice
        fix = str(Problem(why, advice=advice, mark=": "))
        return Check(name, self.ok, self.found, self.wanted, fix, fixable=fixable and not self.ok)


class Repair(NamedTuple):
    """The repair of a fault: bits of a register, or a reboot where no register is named."""

    register: str = ""
    value: int | None = 0
    """None: the factory's"""
    mask: int = 0xFFFF
    """The affected bits of ``value``"""


@dataclass(frozen=True, slots=True)
class Seen:
    """The registers of a servo as read; missing ones do not exist in it."""

    table: Table
    values: Mapping[str, int]
    model: Model
    constant: float
    """Torque per current of the motor [N·m/A]"""
    torque_limit: float
    """The configured one [N·m]; 0: the servo's own"""

    @classmethod
    def of(
        cls, table: Table, model: Model, constant: float, torque_limit: float, *, start: bool
    ) -> Seen:
        """Read the registers that the rules need.

        Args:
            table: The servo.
            model: Its model.
            constant: Torque per current of the motor [N·m/A].
            torque_limit: The configured one [N·m]; 0: the servo's own.
            start: Only what a start refuses is judged.

        Raises:
            ServoLostError: It stops replying.
            UnfitServoError: It refuses.
        """
        names = dict.fromkeys(n for rule in RULES if rule.refuses or not start for n in rule.reads)
        values = {name: table.read(name) for name in names if name in table.registers}
        return cls(table, values, model, constant, torque_limit)

    def __getitem__(self, name: str) -> int:
        """Return the value of a register, which must exist."""
        return self.values[name]

    @property
    def volts(self) -> float:
        """Return the present supply [V]."""
        return self["present_input_voltage"] / 10

    @property
    def law(self) -> TorqueLaw:
        """Return the relation of goal currents and torques at the present supply."""
        return torque_law(self.model, self.constant, self.volts)

    def factory(self, name: str) -> int:
        """Return the factory setting of a register."""
        return self.table.registers[name].default

    def bounds(self, watchdog: int) -> DrivingRange:
        """Return the range in which the servo may be driven.

        Args:
            watchdog: Setting of Bus Watchdog [20 ms].
        """
        names = ("min_voltage_limit", "max_voltage_limit", "temperature_limit")
        return DrivingRange(watchdog, *(self[name] for name in names))

    def judged(self, *, start: bool = False) -> Iterator[tuple[Rule, Verdict]]:
        """Yield every rule that applies to this servo, with its verdict.

        Args:
            start: Only the rules by which a start is refused.
        """
        for rule in RULES:
            if start and not rule.refuses:
                continue
            if all(name in self.values for name in rule.reads):
                yield rule, rule.judge(self)
            elif rule.missing is not None:
                yield rule, rule.missing


@dataclass(frozen=True, slots=True)
class Rule:
    """One row of the table."""

    name: str
    reads: tuple[str, ...]
    """The registers that it judges; the rule is for servos that have them"""
    judge: Callable[[Seen], Verdict]
    repair: Repair | None = None
    """None: a person's decision"""
    refuses: bool = False
    """Whether a start is refused by it"""
    missing: Verdict | None = None
    """The verdict on a servo without these registers; None: it needs none"""


# Before anything else: without model and firmware no register has a meaning


def judge_model(number: int, name: str) -> Verdict:
    """Judge a model number against the name of the configured model."""
    model = model_by_number(number)
    wanted = f"connect an {name}"
    if model is None:
        return Verdict(
            False,
            f"unknown model ({number})",
            name,
            f"Its model number {number} is not known, so nothing was written to it",
            f"{wanted}, or another model that is known and name it in servo.model; if this one has "
            "torque, switch its power off",
        )
    no_current = "" if model.current_mode else ", which has no current mode"
    advice = wanted if no_current else f"{wanted}, or set servo.model={model.name}"
    ok = model.name == name and not no_current
    why = f"It is an {model.name} (model number {number}){no_current}"
    found = f"{model.name} ({number})"
    return Verdict(ok, found, name, why, advice)


def judge_firmware(model: Model, firmware: int) -> Verdict:
    """Judge a firmware, by its Bus Watchdog."""
    why = advice = ""
    ok = firmware >= WATCHDOG_FIRMWARE
    if not ok:
        why = f"Its firmware {firmware} has no Bus Watchdog ({WATCHDOG_FIRMWARE} or later has)"
        advice = "update it with Dynamixel Wizard"
    elif not model.knows_fast_reads(firmware):
        advice = f"{model.fast_sync_read_firmware} or later reads several servos in one reply"
    return Verdict(ok, str(firmware), f"at least {WATCHDOG_FIRMWARE}", why, advice)


def read_status_level(table: Table) -> tuple[int, str]:
    """Return Status Return Level, and a text; at 0 reads have no reply.

    Raises:
        UnfitServoError: The servo refuses.
    """
    try:
        level = table.read("status_return_level")
    except ServoLostError:
        return 0, "no replies to reads"
    return level, str(level)


def judge_status_level(level: int, found: str) -> Verdict:
    """Judge Status Return Level: below 2 writes have no reply."""
    if level == STATUS_LEVEL:
        return Verdict(True, found, str(STATUS_LEVEL))
    why = f"It does not confirm writes: its Status Return Level (68) is {level}"
    advice = f"set it to {STATUS_LEVEL} with {_FIX} or Dynamixel Wizard"
    return Verdict(False, found, str(STATUS_LEVEL), why, advice)


# The registers


def _torque(seen: Seen) -> Verdict:
    if not seen["torque_enable"]:
        return Verdict(True, "off", "off")
    advice = "end that program, hold any load on the shaft, and switch its power off and on"
    return Verdict(False, "on", "off", "A program has left its torque on", advice)


def _error(seen: Seen) -> Verdict:
    error = seen["hardware_error_status"]
    if not error:
        return Verdict(True, "none", "none")
    names = error_names(error) or "unknown"
    why = f"It has latched a hardware error ({names})"
    return Verdict(False, f"{names} (0x{error:02x})", "none", why, what_to_do(error))


def _drive_mode(bit: int, name: str, bad: str, good: str, why: str, then: str = "") -> Rule:
    def judge(seen: Seen) -> Verdict:
        if not seen["drive_mode"] >> bit & 1:
            return Verdict(True, good, good)
        return Verdict(False, bad, good, why, f"{_FIX} clears bit {bit} of Drive Mode (10){then}")

    return Rule(name, ("drive_mode",), judge, Repair("drive_mode", 0, 1 << bit), True)


def _startup(seen: Seen) -> Verdict:
    dangers = ("torque on at power-up", "old goals restored")
    found = " and ".join(
        danger for bit, danger in enumerate(dangers) if seen["startup_configuration"] >> bit & 1
    )
    if not found:
        return Verdict(True, "0", "0")
    why = f"Its Startup Configuration means {found}"
    return Verdict(False, found, "0", why, f"{_FIX} clears Startup Configuration (60)")


def _return_delay(seen: Seen) -> Verdict:
    delay = seen["return_delay_time"]
    found = f"{delay} ({delay * RETURN_DELAY_UNIT_NS // 1000} µs)"
    if not delay:
        return Verdict(True, found, "0")
    advice = "write 0 to Return Delay Time (9); a run does so itself"
    return Verdict(False, found, "0", "It delays every reply", advice)


def _operating_mode(seen: Seen) -> Verdict:
    mode = seen["operating_mode"]
    names = dict(enumerate(_MODES)) | {5: "current-based position", 16: "PWM"}
    advice = "" if mode == CURRENT_MODE else "a run changes it to current mode itself"
    found = f"{mode} ({names.get(mode) or 'unknown'})"
    return Verdict(True, found, "0 (current)", advice=advice)


def _secondary_id(seen: Seen) -> Verdict:
    second = seen["secondary_id"]
    if second > 252:
        return Verdict(True, "none", "none")
    why = f"It also obeys writes to id {second}, without a reply"
    return Verdict(False, str(second), "none", why, "write 255 to Secondary ID (12)")


def _watchdog(seen: Seen) -> Verdict:
    if seen["bus_watchdog"] == WATCHDOG_TRIPPED:
        return Verdict(True, "tripped", "present", advice="a run arms it again")
    return Verdict(True, str(seen["bus_watchdog"]), "present")


def _shutdown(seen: Seen) -> Verdict:
    shutdown, factory = seen["shutdown"], seen.factory("shutdown")
    wanted = f"{factory}, the factory setting"
    if not (missing := error_names(factory & ~shutdown)):
        return Verdict(True, str(shutdown), wanted)
    why, advice = f"It does not protect itself from {missing}", f"write {factory} to Shutdown (63)"
    return Verdict(False, f"{shutdown}, without {missing}", wanted, why, advice)


def _current_limit(seen: Seen) -> Verdict:
    current, most, name = seen["current_limit"], seen.model.current_limit, seen.model.name
    torque = seen.law.torque(current)
    why = advice = ""
    if current == 0:
        why, advice = "It can make no torque", "raise Current Limit (38) with Dynamixel Wizard"
    elif current > most:
        why = f"Its Current Limit (38) reads {current}, but an {name} has at most {most}"
        advice = "start again, and replace the servo if it still reads so"
    elif torque < seen.torque_limit:
        advice = (
            f"servo.torque_limit is {seen.torque_limit:g} N·m: raise Current Limit (38), or accept "
            "the servo's lower limit"
        )
    return Verdict(not why, f"{current} ({torque:.2f} N·m)", f"1 to {most}", why, advice)


def _pwm_limit(seen: Seen) -> Verdict:
    pwm, full = seen["pwm_limit"], seen.factory("pwm_limit")
    advice = "" if pwm >= full else "the torque at high speed is lower: raise PWM Limit (36)"
    return Verdict(pwm > 0, str(pwm), str(full), advice=advice)


def _homing_offset(seen: Seen) -> Verdict:
    offset = seen["homing_offset"]
    advice = "all positions are shifted by it, wall.position included" if offset else ""
    return Verdict(True, f"{offset} ({offset * POSITION_UNIT:.3f} rad)", "0", advice=advice)


def _supply(seen: Seen) -> Verdict:
    volts, bounds, nominal = seen.volts, seen.bounds(0), seen.model.voltage
    wanted = f"{bounds.lowest / 10:g} to {bounds.highest / 10:g} V"
    if fault := bounds.supply_fault(seen["present_input_voltage"]):
        return Verdict(False, f"{volts:g} V", wanted, f"It {fault.what}", fault.advice.rstrip("."))
    advice = ""
    if abs(volts - nominal) > 0.15 * nominal:
        advice = f"its stall torque holds at {nominal:g} V; here the largest torque differs"
    return Verdict(True, f"{volts:g} V", wanted, advice=advice)


def _temperature(seen: Seen) -> Verdict:
    celsius, bounds = seen["present_temperature"], seen.bounds(0)
    found, wanted = f"{celsius} °C", f"at most {bounds.warmest} °C"
    if fault := bounds.heat_fault(celsius):
        return Verdict(False, found, wanted, f"It {fault.what}", fault.advice.rstrip("."))
    warm = celsius > bounds.warmest - _WARM
    advice = "it is close to the limit at which it shuts down" if warm else ""
    return Verdict(True, found, wanted, advice=advice)


_SUPPLY: Final = ("present_input_voltage", "min_voltage_limit", "max_voltage_limit")
_HEAT: Final = ("present_temperature", "temperature_limit")
RULES: Final = (
    Rule("torque", ("torque_enable",), _torque, Repair("torque_enable")),
    Rule("hardware error", ("hardware_error_status",), _error, Repair(), True),
    _drive_mode(
        0,
        "direction",
        "reverse",
        "normal",
        "Its Drive Mode is reverse, which may reverse the position but not the torque, so that a "
        "wall would push the wrong way",
    ),
    _drive_mode(
        1,
        "dual joint",
        "slave",
        "no slave",
        "It is the slave of a dual joint, which follows another servo and not this program",
        "; then drive the master",
    ),
    _drive_mode(
        3,
        "torque on by goal update",
        "on",
        "off",
        "Any goal, even a late one, would switch its torque back on",
    ),
    Rule(
        "start-up configuration",
        ("startup_configuration",),
        _startup,
        Repair("startup_configuration"),
        True,
    ),
    Rule("return delay", ("return_delay_time",), _return_delay, Repair("return_delay_time")),
    Rule("operating mode", ("operating_mode",), _operating_mode),
    Rule("secondary id", ("secondary_id",), _secondary_id, Repair("secondary_id", 255)),
    Rule(
        "bus watchdog",
        ("bus_watchdog",),
        _watchdog,
        missing=Verdict(
            False,
            "missing",
            "present",
            advice=f"update the firmware: {WATCHDOG_FIRMWARE} or later has one",
        ),
    ),
    Rule("shutdown", ("shutdown",), _shutdown, Repair("shutdown", None)),
    Rule("current limit", ("current_limit", "present_input_voltage"), _current_limit, refuses=True),
    Rule("PWM limit", ("pwm_limit",), _pwm_limit),
    Rule("homing offset", ("homing_offset",), _homing_offset),
    Rule("supply", (*_SUPPLY, *_HEAT), _supply, refuses=True),
    Rule("temperature", (*_HEAT, *_SUPPLY), _temperature, refuses=True),
)
"""In the order in which they are printed, and repaired but for a reboot, which comes last: torque
locks EEPROM, and a reboot follows Startup Configuration"""
