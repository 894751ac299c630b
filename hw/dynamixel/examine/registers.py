"""Reads all registers of a servo without driving it, and repairs them on request.

Reading changes nothing in the servo. ``mend`` writes one register, or reboots, and reads back; it
never writes Torque Enable 1, and never reboots a servo that may start with its torque on.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from haptic_wall.hw.dynamixel.examine.finding import Change
from haptic_wall.hw.dynamixel.examine.judgement import Examined, Repair
from haptic_wall.hw.dynamixel.link import Link
from haptic_wall.hw.dynamixel.register_access import Table
from haptic_wall.hw.dynamixel.tables import Model
from haptic_wall.hw.errors import ServoError, ServoLostError, ServoMissingError
from haptic_wall.hw.serialport.line import Line

READ: Final = (
    "status_return_level",
    "torque_enable",
    "hardware_error_status",
    "drive_mode",
    "startup_configuration",
    "return_delay_time",
    "operating_mode",
    "shutdown",
    "current_limit",
    "pwm_limit",
    "bus_watchdog",
    "secondary_id",
    "homing_offset",
    "temperature_limit",
    "max_voltage_limit",
    "min_voltage_limit",
    "present_input_voltage",
    "present_temperature",
)
_BOOT_NS: Final = 3_000_000_000
_BOOT_STEP_NS: Final = 100_000_000


class ServoAccess(NamedTuple):
    """A servo, and its bus."""

    line: Line
    table: Table

    @classmethod
    def of(cls, line: Line, baud: int, servo_id: int, where: str, model: Model) -> ServoAccess:
        """Return the servo with this id on a line.

        Args:
            line: The bus.
            baud: Its rate [bit/s].
            servo_id: The servo's id.
            where: Names the bus in messages.
            model: Its model.
        """
        link = Link(line, servo_id, baud=baud)
        name = f"id {servo_id} at {baud} baud on {where}"
        return cls(line, Table(link, name, model.registers))


def read_all(servo: ServoAccess, model: Model, firmware: int) -> Examined:
    """Read the registers to judge.

    Raises:
        ServoLostError: It stops replying.
        UnfitServoError: It refuses.
    """
    known = model.registers_at(firmware)
    values = {name: servo.table.read(name) if name in known else None for name in READ}
    return Examined(model, firmware, values)


def mend(servo: ServoAccess, name: str, repair: Repair) -> Change:
    """Write one register, or reboot, and read back the result."""
    table = servo.table
    try:
        if not repair.register:
            return _reboot(servo, name)
        before = table.read(repair.register)
        wanted = before & ~repair.mask | repair.value & repair.mask
        after = table.write(repair.register, wanted)
    except ServoError as error:
        return Change(name, "", str(error), False)
    return Change(name, str(before), str(after), after == wanted)


def _reboot(servo: ServoAccess, name: str) -> Change:
    table, clock = servo.table, servo.line.clock
    before = table.read("hardware_error_status")
    known = "startup_configuration" in table.registers
    if known and table.read("startup_configuration"):  # bit 0 does, bit 1 restores unknown values
        why = "not rebooted: its Startup Configuration (60) may switch its torque on"
        return Change(name, f"0x{before:02x}", why, False)
    begun = clock.now_ns()
    table.reboot()
    end = begun + _BOOT_NS
    while True:
        clock.wait_until(clock.now_ns() + _BOOT_STEP_NS)
        try:
            table.ping()
            after = table.read("hardware_error_status")
        except (ServoMissingError, ServoLostError):
            if clock.now_ns() < end:
                continue
            raise
        took_s = (clock.now_ns() - begun) * 1e-9
        found = f"0x{after:02x}, after a reboot of {took_s:.1f} s"
        return Change(name, f"0x{before:02x}", found, after == 0)


def set_status_level(servo: ServoAccess) -> Change:
    """Make a servo reply to writes, and to reads, which it does not at level 0."""
    table = servo.table
    register = table.registers["status_return_level"]
    try:
        before = str(table.read(register.name))
    except ServoLostError:
        before = "no replies to reads"
    try:
        after = table.write(register.name, register.default)
    except ServoError as error:
        return Change("status return level", before, str(error), False)
    return Change("status return level", before, str(after), after == register.default)
