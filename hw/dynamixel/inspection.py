"""Judges a servo's model and settings before anything is written to it.

It only switches torque off, and enables confirmations of writes: neither survives a power cycle.
Settings that a person made are changed only by a person.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from haptic_wall.hw.dynamixel.checklist import Checklist, remedy
from haptic_wall.hw.dynamixel.hardware_errors import error_names, what_to_do
from haptic_wall.hw.dynamixel.health import DrivingRange
from haptic_wall.hw.dynamixel.register_access import Table
from haptic_wall.hw.dynamixel.tables import Model, model_by_number
from haptic_wall.hw.errors import ServoLostError

WATCHDOG_FIRMWARE: Final = 38
"""First firmware with a Bus Watchdog"""
_MENDS: Final = "`haptic-wall doctor CONFIG --fix`"
_REVERSE: Final = 0x01
_SLAVE: Final = 0x02
_TORQUE_ON_BY_GOAL: Final = 0x08


def identify(table: Table, model: Model, number: int, checklist: Checklist) -> Table:
    """Check model and firmware; return the servo with the registers that this firmware has.

    It raises at once: without model and firmware no other register has a meaning.
    """
    found = model_by_number(number)
    fault = remedy(
        f"Its model number {number} is not known, so nothing was written to it",
        f"connect an {model.name}, or another model that is known and name it in "
        "servo.model; if this one has torque, switch its power off.",
    )
    if found is not None:
        no_current = "" if found.current_mode else ", which has no current mode"
        fault = remedy(
            f"It is an {found.name} (model number {number}){no_current}",
            f"connect an {model.name}, or set servo.model to the connected one.",
        )
    checklist.add(
        "model",
        number == model.number,
        f"{found.name if found else 'unknown model'} ({number})",
        f"{model.name} ({model.number})",
        fault,
    )
    checklist.refuse_if_unfit()
    _have_replies_to_everything(table, checklist)
    firmware = table.read("firmware_version")
    checklist.add(
        "firmware",
        firmware >= WATCHDOG_FIRMWARE,
        str(firmware),
        f"at least {WATCHDOG_FIRMWARE}",
        remedy(
            f"Its firmware {firmware} has no Bus Watchdog ({WATCHDOG_FIRMWARE} or later has)",
            "update it with Dynamixel Wizard.",
        ),
    )
    checklist.refuse_if_unfit()
    return Table(table.link, table.name, model.registers_at(firmware))


def _have_replies_to_everything(table: Table, checklist: Checklist) -> None:
    """Set Status Return Level 2; below it writes have no reply, at 0 reads neither."""
    register = table.registers["status_return_level"]
    try:
        found = str(level := table.read(register.name))
    except ServoLostError:
        found, level = "no replies to reads", 0
    if level != register.default:
        level = table.write(register.name, register.default)
        found += f", set to {level}"
    checklist.add(
        "status return level",
        level == register.default,
        found,
        str(register.default),
        remedy(
            f"Its Status Return Level ({register.address}) stays {level} when "
            f"{register.default} is written",
            "set it with Dynamixel Wizard.",
        ),
    )


def torque_off(table: Table, checklist: Checklist) -> None:
    """Switch off torque left from another run; EEPROM is locked while it is on."""
    was_on = table.read("torque_enable") != 0
    off = not was_on or table.write("torque_enable", 0) == 0
    found = "off" if not was_on else "on, switched off" if off else "on"
    checklist.add(
        "torque at the start",
        off,
        found,
        "off",
        remedy("Its torque stays on", "switch its power off."),
    )


def judge_what_only_a_person_changes(table: Table, checklist: Checklist) -> None:
    """Judge settings that only a person changes: errors, drive mode, start-up configuration."""
    error = table.read("hardware_error_status")
    names = error_names(error)
    checklist.add(
        "hardware error",
        error == 0,
        f"{names or 'unknown'} (0x{error:02x})" if error else "none",
        "none",
        remedy(
            f"It has latched a hardware error ({names or f'0x{error:02x}'})",
            f"{what_to_do(error)}.",
        ),
    )
    drive_mode = table.read("drive_mode")
    checklist.add(
        "direction",
        not drive_mode & _REVERSE,
        "reverse" if drive_mode & _REVERSE else "normal",
        "normal",
        remedy(
            "Its Drive Mode is reverse, which may reverse the position but not "
            "the torque, so that a wall would push the wrong way",
            f"{_MENDS} clears bit 0 of Drive Mode (10).",
        ),
    )
    checklist.add(
        "dual joint",
        not drive_mode & _SLAVE,
        "slave" if drive_mode & _SLAVE else "no slave",
        "no slave",
        remedy(
            "It is the slave of a dual joint, which follows another servo and not this program",
            f"{_MENDS} clears bit 1 of Drive Mode (10); then drive the master.",
        ),
    )
    checklist.add(
        "torque on by goal update",
        not drive_mode & _TORQUE_ON_BY_GOAL,
        "on" if drive_mode & _TORQUE_ON_BY_GOAL else "off",
        "off",
        remedy(
            "Any goal, even a late one, would switch its torque back on",
            f"{_MENDS} clears bit 3 of Drive Mode (10).",
        ),
    )
    if "startup_configuration" not in table.registers:
        return  # it always starts with its torque off
    startup = table.read("startup_configuration")
    dangers = [
        danger
        for bit, danger in ((1, "torque on at power-up"), (2, "old goals restored"))
        if startup & bit
    ]
    checklist.add(
        "start-up configuration",
        not dangers,
        " and ".join(dangers) or "0",
        "0",
        remedy(
            f"Its Startup Configuration means {' and '.join(dangers)}",
            f"{_MENDS} clears these bits of Startup Configuration (60).",
        ),
    )


def judge_supply_and_heat(table: Table, checklist: Checklist, watchdog: int) -> DrivingRange:
    """Judge supply and temperature by the servo's own limits; return the limits for the run.

    Args:
        table: The servo.
        checklist: Receives the checks.
        watchdog: Setting of Bus Watchdog [20 ms].
    """
    bounds = DrivingRange(
        watchdog=watchdog,
        lowest=table.read("min_voltage_limit"),
        highest=table.read("max_voltage_limit"),
        hottest=table.read("temperature_limit"),
    )
    volts, celsius = table.read("present_input_voltage"), table.read("present_temperature")
    fault = bounds.supply_fault(volts)
    checklist.add(
        "supply",
        not fault,
        f"{volts / 10:g} V",
        f"{bounds.lowest / 10:g} to {bounds.highest / 10:g} V",
        fault and replace(fault, what=f"It {fault.what}"),
    )
    fault = bounds.heat_fault(celsius)
    checklist.add(
        "temperature",
        not fault,
        f"{celsius} °C",
        f"at most {bounds.warmest} °C",
        fault and replace(fault, what=f"It {fault.what}"),
    )
    return bounds
