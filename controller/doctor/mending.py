"""Repairs one fault of a servo on request: writes one register, or reboots, and reads back.

It never writes Torque Enable 1, and never reboots a servo that may start with its torque on.
"""

from __future__ import annotations

from typing import Final

from haptic_wall.controller.doctor.report import Change
from haptic_wall.hw.clock import Clock
from haptic_wall.hw.dynamixel.register_access import Table
from haptic_wall.hw.dynamixel.rules import Rule
from haptic_wall.hw.errors import ServoError, ServoLostError, ServoMissingError
from haptic_wall.hw.servo import Check

_BOOT_NS: Final = 3_000_000_000
_BOOT_STEP_NS: Final = 100_000_000


def question(check: Check, rule: Rule) -> str:
    """Return the question to ask before a rule."""
    if rule.register == "torque_enable":
        return "torque: on -> off (a load on the shaft will fall)"
    return f"{check.name}: {check.found} -> {check.wanted if rule.register else 'reboot'}"


def mend(table: Table, clock: Clock, name: str, rule: Rule) -> Change:
    """Write one register, or reboot, and read back the result.

    Args:
        table: The servo.
        clock: Tells the time.
        name: Name of the check.
        rule: The one that tells how.
    """
    told, before = "", 0
    try:
        if not rule.register:
            return _reboot(table, clock, name)
        before = table.read(rule.register)
        told = str(before)
        factory = table.registers[rule.register].default
        value = factory if rule.value is None else rule.value
        wanted = before & ~rule.mask | value & rule.mask
        after = table.write(rule.register, wanted)
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
