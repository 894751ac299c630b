"""Converts and arms the Bus Watchdog, by which a servo drops its torque when it hears nothing."""

from __future__ import annotations

from typing import Final

from haptic_wall.hw.dynamixel.register_access import QUICK_NS, Table
from haptic_wall.hw.dynamixel.registers import WATCHDOG_UNIT_NS
from haptic_wall.hw.errors import UnfitServoError

_MOST_UNITS: Final = 127


def watchdog_units(watchdog_s: float) -> int:
    """Return the configured Bus Watchdog [s] in the register's unit.

    Raises:
        UnfitServoError: The register cannot hold it.
    """
    units = round(watchdog_s * 1e9 / WATCHDOG_UNIT_NS)
    if not 1 <= units <= _MOST_UNITS:
        raise UnfitServoError(
            f"A Bus Watchdog of {watchdog_s:g} s is requested, but servos have 0.02 to 2.54 s",
            advice="set servo.watchdog_s in this range.",
        )
    return units


def rearm(table: Table, units: int) -> bool:
    """Arm a tripped Bus Watchdog again, at zero torque; return whether that was read back.

    A tripped watchdog accepts no goal before it is cleared, and the old torque may then return with
    nothing to end it: so torque is off meanwhile. Every write is read back.

    Args:
        table: The servo.
        units: Its setting [20 ms].
    """
    steps = (
        ("torque_enable", 0),
        ("bus_watchdog", 0),
        ("goal_current", 0),
        ("bus_watchdog", units),
        ("torque_enable", 1),
    )
    return all(table.try_write(name, value, 3 * QUICK_NS[-1:]) == value for name, value in steps)
