"""Judges registers that make a good wall bad or a safe one dangerous, and names the repair.

Pure functions: values in, findings out. The names are those of the checked start-up where it has
them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Final, NamedTuple

from haptic_wall.hw.dynamixel.examine.finding import Finding
from haptic_wall.hw.dynamixel.hardware_errors import error_names, what_to_do
from haptic_wall.hw.dynamixel.inspection import WATCHDOG_FIRMWARE
from haptic_wall.hw.dynamixel.tables import (
    CURRENT_MODE,
    POSITION_UNIT,
    RETURN_DELAY_UNIT_NS,
    WATCHDOG_TRIPPED,
    Model,
)
from haptic_wall.hw.dynamixel.torque_law import torque_law

_MODES: Final = {
    0: "current",
    1: "velocity",
    3: "position",
    4: "extended position",
    5: "current-based position",
    16: "PWM",
}
_WARM: Final = 10
"""Distance to the temperature limit from which it is reported [°C]"""


class Repair(NamedTuple):
    """The repair of a finding: bits of a register, or a reboot where no register is named."""

    register: str = ""
    value: int = 0
    mask: int = 0xFFFF
    """The affected bits of ``value``"""


class Judgement(NamedTuple):
    """A finding, and its repair."""

    finding: Finding
    repair: Repair | None = None


def in_order_of_repair(judged: Iterable[Judgement]) -> list[Judgement]:
    """Return the repairable findings: torque first, which locks EEPROM, and a reboot last.

    A reboot follows Startup Configuration, so that is repaired before.
    """
    repairs = [one for one in judged if one.repair is not None]
    return sorted(repairs, key=lambda one: one.repair == Repair())


class Examined(NamedTuple):
    """A servo's registers as read; None: it has no such register, or did not reply."""

    model: Model
    firmware: int
    values: Mapping[str, int | None]


def judge(examined: Examined, torque_limit: float, constant: float) -> list[Judgement]:
    """Judge the registers, and name the repairs.

    Args:
        examined: The registers.
        torque_limit: The configured one [N·m]; 0: the servo's own.
        constant: Torque per current of the motor [N·m/A].
    """
    return [
        *_torque(examined),
        *_error(examined),
        *_drive_mode(examined),
        *_startup(examined),
        *_bus(examined),
        *_limits(examined, torque_limit, constant),
        *_state(examined),
    ]


def _torque(examined: Examined) -> Iterator[Judgement]:
    on = bool(examined.values["torque_enable"])
    yield Judgement(
        Finding(
            "torque",
            not on,
            "on" if on else "off",
            "off",
            "a program left it on: end that program, hold any load on the shaft, and switch "
            "its power off and on"
            if on
            else "",
            fixable=on,
        ),
        Repair("torque_enable", 0) if on else None,
    )


def _error(examined: Examined) -> Iterator[Judgement]:
    error = examined.values["hardware_error_status"] or 0
    names = error_names(error) or "unknown"
    yield Judgement(
        Finding(
            "hardware error",
            not error,
            f"{names} (0x{error:02x})" if error else "none",
            "none",
            what_to_do(error) if error else "",
            fixable=error != 0,
        ),
        Repair() if error else None,
    )


def _drive_mode(examined: Examined) -> Iterator[Judgement]:
    mode = examined.values["drive_mode"]
    if mode is None:
        return
    for bit, name, bad, good, why in (
        (0x01, "direction", "reverse", "normal", "a wall might push the wrong way"),
        (0x02, "dual joint", "slave", "no slave", "another servo commands its torque"),
        (0x08, "torque on by goal update", "on", "off", "a late goal switches torque back on"),
    ):
        found = bool(mode & bit)
        if bit == 0x02 and examined.model.family != "X540":
            continue
        yield Judgement(
            Finding(
                name,
                not found,
                bad if found else good,
                good,
                f"{why}: clear bit {bit.bit_length() - 1} of Drive Mode (10)" if found else "",
                fixable=found,
            ),
            Repair("drive_mode", 0, bit) if found else None,
        )


def _startup(examined: Examined) -> Iterator[Judgement]:
    startup = examined.values["startup_configuration"]
    if startup is None:
        return
    dangers = [
        danger
        for bit, danger in ((1, "torque on at power-up"), (2, "old goals restored"))
        if startup & bit
    ]
    yield Judgement(
        Finding(
            "start-up configuration",
            not dangers,
            " and ".join(dangers) or "0",
            "0",
            "write 0 to Startup Configuration (60)" if dangers else "",
            fixable=bool(dangers),
        ),
        Repair("startup_configuration", 0) if dangers else None,
    )


def _bus(examined: Examined) -> Iterator[Judgement]:
    values = examined.values
    delay = values["return_delay_time"] or 0
    yield Judgement(
        Finding(
            "return delay",
            delay == 0,
            f"{delay} ({delay * RETURN_DELAY_UNIT_NS // 1000} µs)",
            "0",
            "it delays every reply: write 0 to Return Delay Time (9); a run does so itself"
            if delay
            else "",
            fixable=delay != 0,
        ),
        Repair("return_delay_time", 0) if delay else None,
    )
    mode = values["operating_mode"]
    right = mode == CURRENT_MODE
    name = _MODES.get(-1 if mode is None else mode, "unknown")
    fix = "" if right else "a run changes it to current mode itself"
    yield Judgement(Finding("operating mode", True, f"{mode} ({name})", "0 (current)", fix))
    secondary = values["secondary_id"]
    if secondary is not None:
        shared = secondary <= 252
        yield Judgement(
            Finding(
                "secondary id",
                not shared,
                str(secondary) if shared else "none",
                "none",
                f"it also obeys writes to id {secondary}, without a reply: write 255 to "
                "Secondary ID (12)"
                if shared
                else "",
                fixable=shared,
            ),
            Repair("secondary_id", 255) if shared else None,
        )
    watchdog = values["bus_watchdog"]
    tripped = watchdog == WATCHDOG_TRIPPED
    yield Judgement(
        Finding(
            "bus watchdog",
            watchdog is not None,
            "missing" if watchdog is None else "tripped" if tripped else f"{watchdog}",
            "present",
            f"update the firmware: {WATCHDOG_FIRMWARE} or later has one"
            if watchdog is None
            else "a run arms it again"
            if tripped
            else "",
        )
    )


def _limits(examined: Examined, torque_limit: float, constant: float) -> Iterator[Judgement]:
    values, model = examined.values, examined.model
    shutdown = values["shutdown"] or 0
    factory = model.registers_at(examined.firmware)["shutdown"].default
    missing = factory & ~shutdown
    names = error_names(missing)
    yield Judgement(
        Finding(
            "shutdown",
            not missing,
            f"{shutdown}, without {names}" if missing else str(shutdown),
            f"{factory}, the factory setting",
            f"it does not protect itself from {names}: write {factory} to Shutdown (63)"
            if missing
            else "",
            fixable=missing != 0,
        ),
        Repair("shutdown", factory) if missing else None,
    )
    current = values["current_limit"]
    if current is not None:
        volts = (values["present_input_voltage"] or 0) / 10
        torque = torque_law(model, constant, volts).torque(current)
        fix = ""
        if current == 0:
            fix = "it can make no torque: raise Current Limit (38)"
        elif current > model.current_limit:
            fix = (
                f"an {model.name} has at most {model.current_limit}: examine it again, and replace "
                "the servo if the value remains"
            )
        elif torque < torque_limit:
            fix = (
                f"servo.torque_limit is {torque_limit:g} N·m: raise Current Limit (38), or accept "
                "the servo's lower limit"
            )
        found = f"{current} ({torque:.2f} N·m)"
        ok = 0 < current <= model.current_limit
        yield Judgement(Finding("current limit", ok, found, f"1 to {model.current_limit}", fix))
    pwm = values["pwm_limit"]
    if pwm is not None:
        full = model.registers_at(examined.firmware)["pwm_limit"].default
        fix = "" if pwm >= full else "the torque at high speed is lower: raise PWM Limit (36)"
        yield Judgement(Finding("PWM limit", pwm > 0, str(pwm), str(full), fix))
    offset = values["homing_offset"]
    if offset is not None:
        fix = "" if offset == 0 else "all positions are shifted by it, wall.position included"
        found = f"{offset} ({offset * POSITION_UNIT:.3f} rad)"
        yield Judgement(Finding("homing offset", True, found, "0", fix))


def _state(examined: Examined) -> Iterator[Judgement]:
    values, model = examined.values, examined.model
    voltage, low, high = (
        (values[name] or 0) / 10
        for name in ("present_input_voltage", "min_voltage_limit", "max_voltage_limit")
    )
    inside = low <= voltage <= high
    fix = "" if inside else "check the supply; outside these limits it reports an error"
    if inside and abs(voltage - model.voltage) > 0.15 * model.voltage:
        fix = f"its stall torque holds at {model.voltage:g} V; here the largest torque differs"
    wanted = f"{low:.1f} to {high:.1f} V"
    yield Judgement(Finding("supply", inside, f"{voltage:.1f} V", wanted, fix))
    now, limit = values["present_temperature"] or 0, values["temperature_limit"] or 0
    fix = ""
    if now >= limit:
        fix = "let it cool down; it shuts down at its limit"
    elif now > limit - _WARM:
        fix = "it is close to the limit at which it shuts down"
    yield Judgement(Finding("temperature", now < limit, f"{now} °C", f"below {limit} °C", fix))
