"""What a servo must be set to, in one table: a start refuses by it, ``doctor`` prints and mends.

A rule reads registers and makes a check of them. Settings that a person made are changed only by
a person, or by a person's ``doctor --fix``. Reading changes nothing in the servo.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

from haptic_wall.hw.dynamixel.codec import MAX_ID
from haptic_wall.hw.dynamixel.health import DrivingRange
from haptic_wall.hw.dynamixel.register_access import Table
from haptic_wall.hw.dynamixel.registers import WATCHDOG_FIRMWARE
from haptic_wall.hw.dynamixel.tables import NO_CURRENT_MODE, Model, model_by_number
from haptic_wall.hw.dynamixel.torque_law import TorqueLaw, torque_law
from haptic_wall.hw.servo import Check

OF_PRESETS: Final = ("XM430-W350", "XL330-M288")
"""Models that a preset is for; its name is that of the model in small letters"""
STATUS_LEVEL: Final = 2
"""Status Return Level at which the servo replies to everything"""
_FIX: Final = "`haptic-wall doctor CONFIG --fix`"
_ERRORS: Final = {
    0: ("input voltage", "bring its supply within Min and Max Voltage Limit (34, 32)"),
    2: ("overheating", "let it cool, and ask for less torque"),
    3: ("motor encoder", "have it repaired if the error comes back: its position may be wrong"),
    4: ("electrical shock", "look for a short circuit or a weak supply"),
    5: ("overload", "free its shaft, or lower servo.torque_limit"),
}
"""Names and remedies of the bits of Hardware Error Status"""


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

    @property
    def bounds(self) -> DrivingRange:
        """Return the range in which the servo may be driven."""
        names = ("min_voltage_limit", "max_voltage_limit", "temperature_limit")
        return DrivingRange(*(self[name] for name in names))


class Verdict(NamedTuple):
    """The finding of a rule; it is a fault if ``why`` is not empty."""

    found: str
    wanted: str
    why: str = ""
    """The fault, a sentence without its point; empty: there is none"""
    advice: str = ""
    """The remedy; without a fault it says what could be better"""

    def check(self, name: str, *, fixable: bool = False) -> Check:
        """Return it as a check, whose remedy is a sentence, ``WHY: ADVICE``.

        Args:
            name: Name of the check.
            fixable: ``doctor --fix`` can mend the fault.
        """
        found, wanted, why, advice = self
        fix = f"{why}: {advice}" if why else advice
        return Check(name, not why, found, wanted, fix, fixable=bool(why) and fixable)


class Rule(NamedTuple):
    """One row of the table, and the repair of its fault: bits of a register, or a reboot."""

    name: str
    reads: tuple[str, ...]
    """The registers that it judges; the rule is for servos that have them"""
    judge: Callable[[Seen], Verdict]
    refuses: bool = False
    """Whether a start is refused by it"""
    register: str | None = None
    """The one to repair; None: a person's decision; empty: a reboot"""
    value: int | None = 0
    """None: the factory's"""
    mask: int = 0xFFFF
    """The affected bits of ``value``"""


# Before anything else: without model and firmware no register has a meaning


def judge_model(number: int, name: str) -> Check:
    """Judge a model number against the name of the configured model."""
    model = model_by_number(number)
    if (other := NO_CURRENT_MODE.get(number)) is not None:
        why = f"It is an {other} (model number {number}), which has no current mode"
        return Verdict(f"{other} ({number})", name, why, f"connect an {name}").check("model")
    if model is None:
        return Verdict(
            f"unknown model ({number})",
            name,
            f"Its model number {number} is not known, so nothing was written to it",
            f"connect an {name}, or another model that is known and name it in servo.model; if "
            "this one has torque, switch its power off",
        ).check("model")
    why = advice = ""
    if model.name != name:
        why = f"It is an {model.name} (model number {number})"
        other = f"set servo.model={model.name} and its own values (`haptic-wall identify`)"
        if model.name in OF_PRESETS:
            other = f"make a new file, `haptic-wall init FILE --from {model.name.lower()}`"
        advice = (
            f"connect an {name}, or {other}: model.* and servo.torque_limit belong to a model too"
        )
    return Verdict(f"{model.name} ({number})", name, why, advice).check("model")


def judge_firmware(model: Model, firmware: int) -> Check:
    """Judge a firmware, by its Bus Watchdog."""
    why = advice = ""
    if firmware < WATCHDOG_FIRMWARE:
        why = f"Its firmware {firmware} has no Bus Watchdog ({WATCHDOG_FIRMWARE} or later has)"
        advice = "update it with Dynamixel Wizard"
    elif not model.knows_fast_reads(firmware):
        advice = f"{model.fast_sync_read_firmware} or later reads several servos in one reply"
    found, wanted = str(firmware), f"at least {WATCHDOG_FIRMWARE}"
    return Verdict(found, wanted, why, advice).check("firmware")


# The registers


def _clear(
    name: str, register: str, good: str, dangers: Mapping[int, str], why: str, advice: str
) -> Rule:
    """Return the rule that bits of a register must be 0.

    Args:
        name: Name of the check.
        register: The register.
        good: What it means that none is set.
        dangers: What each of these bits means.
        why: The fault; the dangers stand in place of ``{}``.
        advice: The remedy.
    """

    def judge(seen: Seen) -> Verdict:
        found = " and ".join(text for bit, text in dangers.items() if seen[register] >> bit & 1)
        return Verdict(found, good, why.format(found), advice) if found else Verdict(good, good)

    mask = sum(1 << bit for bit in dangers)
    return Rule(name, (register,), judge, register != "torque_enable", register, 0, mask)


def _return_delay(seen: Seen) -> Verdict:
    found = seen["return_delay_time"]
    if not found:
        return Verdict("0", "0")
    advice = "write 0 to Return Delay Time (9); a run does so itself"
    return Verdict(str(found), "0", "It delays every reply", advice)


def error_names(error: int) -> str:
    """Return the names of latched errors, for messages; empty if no known bit is set."""
    return ", ".join(name for bit, (name, _) in _ERRORS.items() if error >> bit & 1)


def what_to_do(error: int) -> str:
    """Return advice on latched errors, to be put after a colon."""
    remedies = [remedy for bit, (_, remedy) in _ERRORS.items() if error >> bit & 1]
    remove = "; ".join(remedies) or "remove the cause"
    return f"{remove}; then reboot it, or switch its power off and on; only this clears the error"


def _error(seen: Seen) -> Verdict:
    error = seen["hardware_error_status"]
    if not error:
        return Verdict("none", "none")
    names = error_names(error) or "unknown"
    why = f"It has latched a hardware error ({names})"
    return Verdict(f"{names} (0x{error:02x})", "none", why, what_to_do(error))


def _secondary_id(seen: Seen) -> Verdict:
    second = seen["secondary_id"]
    if second > MAX_ID:
        return Verdict("none", "none")
    why = f"It also obeys writes to id {second}, without a reply"
    return Verdict(str(second), "none", why, "write 255 to Secondary ID (12)")


def _shutdown(seen: Seen) -> Verdict:
    shutdown, factory = seen["shutdown"], seen.factory("shutdown")
    wanted = f"{factory}, the factory setting"
    if not (missing := error_names(factory & ~shutdown)):
        return Verdict(str(shutdown), wanted)
    why, advice = f"It does not protect itself from {missing}", f"write {factory} to Shutdown (63)"
    return Verdict(f"{shutdown}, without {missing}", wanted, why, advice)


def _current_limit(seen: Seen) -> Verdict:
    current, most, name = seen["current_limit"], seen.model.current_limit, seen.model.name
    torque = seen.law.torque(current)
    why = advice = ""
    if current == 0:
        why = "Its Current Limit is 0, so it can make no torque"
        advice = "raise Current Limit (38) with Dynamixel Wizard"
    elif current > most:
        why = f"Its Current Limit (38) reads {current}, but an {name} has at most {most}"
        advice = "start again, and replace the servo if it still reads so"
    elif seen.torque_limit > 0.0 and not seen.law.within(seen.torque_limit):
        why = (
            f"servo.torque_limit is {seen.torque_limit:g} N·m, but its smallest torque at "
            f"{seen.volts:g} V is {seen.law.step:.2g} N·m"
        )
        advice = "raise servo.torque_limit above that"
    elif torque < seen.torque_limit:
        advice = (
            f"servo.torque_limit is {seen.torque_limit:g} N·m: raise Current Limit (38), or accept "
            "the servo's lower limit"
        )
        if (largest := seen.law.torque(most)) < seen.torque_limit:
            advice = (
                f"servo.torque_limit is {seen.torque_limit:g} N·m, but an {name} gives at most "
                f"{largest:.2g} N·m at {seen.volts:g} V: check that the configuration is of this "
                "model"
            )
    return Verdict(f"{current} ({torque:.2f} N·m)", f"1 to {most}", why, advice)


def _supply(seen: Seen) -> Verdict:
    bounds = seen.bounds
    fault, advice = bounds.supply_fault(seen["present_input_voltage"])
    wanted = f"{bounds.lowest / 10:g} to {bounds.highest / 10:g} V"
    return Verdict(f"{seen.volts:g} V", wanted, fault and f"It {fault}", advice)


def _temperature(seen: Seen) -> Verdict:
    celsius, bounds = seen["present_temperature"], seen.bounds
    fault, advice = bounds.heat_fault(celsius)
    wanted = f"at most {bounds.warmest} °C"
    return Verdict(f"{celsius} °C", wanted, fault and f"It {fault}", advice)


_SUPPLY: Final = ("present_input_voltage", "min_voltage_limit", "max_voltage_limit")
_HEAT: Final = ("present_temperature", "temperature_limit")
RULES: Final = (
    _clear(
        "torque",
        "torque_enable",
        "off",
        {0: "on"},
        "A program has left its torque on",
        "end that program, hold any load on the shaft, and switch its power off and on",
    ),
    Rule("hardware error", ("hardware_error_status",), _error, refuses=True, register=""),
    _clear(
        "drive mode",
        "drive_mode",
        "normal",
        {0: "reverse", 1: "slave of a dual joint", 3: "torque on by goal update"},
        "Its Drive Mode is {}: reverse may reverse the position but not the torque, so that a wall "
        "would push the wrong way; a slave follows another servo and not this program; and any "
        "goal, even a late one, would switch a torque back on",
        f"{_FIX} clears these bits of Drive Mode (10)",
    ),
    _clear(
        "start-up configuration",
        "startup_configuration",
        "0",
        {0: "torque on at power-up", 1: "old goals restored"},
        "Its Startup Configuration means {}",
        f"{_FIX} clears these bits of Startup Configuration (60)",
    ),
    Rule("return delay", ("return_delay_time",), _return_delay, register="return_delay_time"),
    Rule("secondary id", ("secondary_id",), _secondary_id, register="secondary_id", value=255),
    Rule("shutdown", ("shutdown",), _shutdown, register="shutdown", value=None),
    Rule("current limit", ("current_limit", "present_input_voltage"), _current_limit, True),
    Rule("supply", (*_SUPPLY, *_HEAT), _supply, True),
    Rule("temperature", (*_HEAT, *_SUPPLY), _temperature, True),
)
"""In the order in which they are printed, and repaired but for a reboot, which comes last: torque
locks EEPROM, and a reboot follows Startup Configuration"""


def read_servo(
    table: Table, model: Model, constant: float, torque_limit: float, *, start: bool = False
) -> Seen:
    """Read the registers that the rules need.

    Args:
        table: The servo.
        model: Its model.
        constant: Torque per current of the motor [N·m/A].
        torque_limit: The configured one [N·m]; 0: the servo's own.
        start: Only those by which a start is refused.

    Raises:
        ServoLostError: It stops replying.
        UnfitServoError: It refuses.
    """
    names = dict.fromkeys(n for rule in RULES if rule.refuses or not start for n in rule.reads)
    values = {name: table.read(name) for name in names if name in table.registers}
    return Seen(table, values, model, constant, torque_limit)


def judge(seen: Seen, *, start: bool = False) -> Iterator[tuple[Rule, Check]]:
    """Yield every rule that applies to a servo, with its check.

    Args:
        seen: The servo.
        start: Only the rules by which a start is refused.
    """
    for rule in RULES:
        if (rule.refuses or not start) and all(name in seen.values for name in rule.reads):
            yield rule, rule.judge(seen).check(rule.name, fixable=rule.register is not None)
