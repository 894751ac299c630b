"""Repairs one fault of a servo on request: writes one register, or reboots, and reads back.

It never writes Torque Enable 1, and never reboots a servo that may start with its torque on.
"""

from __future__ import annotations

from typing import Final

from haptic_wall.controller.doctor.report import Change
from haptic_wall.hw.clock import Clock
from haptic_wall.hw.dynamixel.register_access import Table
from haptic_wall.hw.dynamixel.verdict import Repair
from haptic_wall.hw.errors import ServoError, ServoLostError, ServoMissingError

_BOOT_NS: Final = 3_000_000_000
_BOOT_STEP_NS: Final = 100_000_000


def question(name: str, found: str, wanted: str, repair: Repair) -> str:
    """Return the question to ask before a repair."""
    if not repair.register:
        return f"{name}: {found} -> reboot"
    if repair.register == "torque_enable":
        return "torque: on -> off (a load on the shaft will fall)"
    return f"{name}: {found} -> {wanted}"


def mend(table: Table, clock: Clock, name: str, repair: Repair) -> Change:
    """Write one register, or reboot, and read back the result.

    Args:
        table: The servo.
        clock: Tells the time.
        name: Name of the check.
        repair: The repair.
    """
    told, before = "", 0
    try:
        if not repair.register:
            return _reboot(table, clock, name)
        before = table.read(repair.register)
        told = str(before)
        factory = table.registers[repair.register].default
        value = factory if repair.value is None else repair.value
        wanted = before & ~repair.mask | value & repair.mask
        after = table.write(repair.register, wanted)
    except ServoError as error:
        return Change(name, told, str(error), False)
    return Change(name, told, str(after), after == wanted)


def _reboot(table: Table, clock: Clock, name: str) -> Change:
    before = table.read("hardware_error_status")
    known = "startup_configuration" in table.registers
    if known and table.read("startup_configuration"):  # bit 0 does, bit 1 restores unknown values
        why = "not rebooted: its Startup Configuration (60) may switch its torque on"
        return Change(name, f"0x{before:02x}", why, False)
    begun = clock.now_ns()
    table.reboot()
    while True:
        clock.wait_until(clock.now_ns() + _BOOT_STEP_NS)
        took_ns = clock.now_ns() - begun
        try:
            table.ping()
            after = table.read("hardware_error_status")
        except (ServoMissingError, ServoLostError):
            if took_ns < _BOOT_NS:
                continue
            raise
        found = f"0x{after:02x}, after a reboot of {took_ns * 1e-9:.1f} s"
        return Change(name, f"0x{before:02x}", found, after == 0)
