"""Reads all registers of a servo without driving it, and repairs them on request.

Reading changes nothing in the servo. ``mend`` writes one register, or reboots, and reads back; it
never writes Torque Enable 1, and never reboots a servo that may start with its torque on.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from haptic_wall.hw.dynamixel.examine.finding import Change
from haptic_wall.hw.dynamixel.examine.judgement import Examined, Repair
from haptic_wall.hw.dynamixel.line import Line
from haptic_wall.hw.dynamixel.link import Link
from haptic_wall.hw.dynamixel.sdk import Sdk, Table
from haptic_wall.hw.dynamixel.tables import Model, Register
from haptic_wall.hw.errors import ServoError, ServoLostError, ServoMissingError

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
_PATIENCE_NS: Final = 40_000_000
_ATTEMPTS: Final = 3
_EVERYTHING: Final = Register("everything", 0, 147, False, 0, 0, 0)
"""Model Number to Present Temperature"""
_BOOT_NS: Final = 3_000_000_000
_BOOT_STEP_NS: Final = 100_000_000


class ServoAccess(NamedTuple):
    """A servo, with both ways of access."""

    line: Line
    table: Table
    """Registers of one and two bytes"""
    link: Link
    """Samples, and longer registers"""

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
        table = Table(Sdk(line, baud, servo_id, where), model.registers)
        return cls(line, table, Link(line, servo_id))


def read_all(servo: ServoAccess, model: Model, firmware: int) -> Examined:
    """Read the registers to judge.

    Raises:
        ServoLostError: It stops replying.
    """
    known = model.registers_at(firmware)
    image = _image(servo)
    values = {name: _decode(image, known[name]) if name in known else None for name in READ}
    return Examined(model, firmware, values)


def _image(servo: ServoAccess) -> bytes:
    """Return all registers up to the temperature, in one reply.

    A reply names neither its register nor its request; one of this length can only be the answer to
    this request. A late or repeated reply to a read of one byte would be mistaken for another.

    Raises:
        ServoLostError: No such reply comes.
    """
    for _ in range(_ATTEMPTS):
        deadline_ns = servo.line.clock.now_ns() + _PATIENCE_NS
        found = servo.link.read_register(_EVERYTHING, deadline_ns)
        if found is not None:
            return found.to_bytes(_EVERYTHING.size, "little")
    raise ServoLostError(
        "It answers a ping, but not a read of its registers 0 to "
        f"{_EVERYTHING.size - 1} in one piece",
        advice="check the cable, and for a second servo with this id.",
    )


def _decode(image: bytes, register: Register) -> int:
    return register.decode(image[register.address : register.address + register.size])


def mend(servo: ServoAccess, name: str, repair: Repair) -> Change:
    """Write one register, or reboot, and read back the result."""
    table = servo.table
    try:
        if not repair.register:
            return _reboot(servo, name)
        register = table.registers[repair.register]
        before = _decode(_image(servo), register)
        wanted = before & ~repair.mask | repair.value & repair.mask
        table.write(repair.register, wanted)
        after = _decode(_image(servo), register)
    except ServoError as error:
        return Change(name, "", str(error), False)
    return Change(name, str(before), str(after), after == wanted)


def _reboot(servo: ServoAccess, name: str) -> Change:
    table, clock = servo.table, servo.line.clock
    register = table.registers["hardware_error_status"]
    image = _image(servo)
    before = _decode(image, register)
    startup = table.registers.get("startup_configuration")
    if startup is not None and _decode(image, startup):  # bit 0 does, bit 1 restores unknown values
        why = "not rebooted: its Startup Configuration (60) may switch its torque on"
        return Change(name, f"0x{before:02x}", why, False)
    begun = clock.now_ns()
    table.sdk.reboot()
    end = begun + _BOOT_NS
    while True:
        clock.wait_until(clock.now_ns() + _BOOT_STEP_NS)
        try:
            table.sdk.ping()
            after = _decode(_image(servo), register)
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
        before = str(table.sdk.read(register))
    except ServoLostError:
        before = "no replies to reads"
    table.sdk.write_unanswered(register, register.default)
    try:
        after = table.sdk.read(register)
    except ServoError as error:
        return Change("status return level", before, str(error), False)
    return Change("status return level", before, str(after), after == register.default)
