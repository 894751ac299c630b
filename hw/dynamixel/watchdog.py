"""Sets the Bus Watchdog, examines it after a pause, and arms it again if no torque was lost."""

from __future__ import annotations

from enum import Enum
from typing import Final

from haptic_wall.hw.dynamixel.link import Link
from haptic_wall.hw.dynamixel.register_access import QUICK_NS, confirmed, read_patiently
from haptic_wall.hw.dynamixel.tables import REGISTERS, WATCHDOG_TRIPPED, WATCHDOG_UNIT_NS
from haptic_wall.hw.errors import ServoLostError, TorqueLostError, UnfitServoError
from haptic_wall.hw.settings import DriverSettings

_TORQUE_ENABLE: Final = REGISTERS["torque_enable"]
_BUS_WATCHDOG: Final = REGISTERS["bus_watchdog"]
_GOAL_CURRENT: Final = REGISTERS["goal_current"]
_MOST_UNITS: Final = 127


class Armed(Enum):
    """The state of a Bus Watchdog."""

    YES = "armed"
    """It has its setting, or has been armed again at zero torque"""
    NO = "not armed"
    """It has tripped or was changed, and there was a torque to lose"""
    UNKNOWN = "unknown"
    """The servo does not reply"""


def watchdog_units(settings: DriverSettings) -> int:
    """Return the configured Bus Watchdog in the register's unit.

    Raises:
        UnfitServoError: The register cannot hold it.
    """
    units = round(settings.watchdog_s * 1e9 / WATCHDOG_UNIT_NS)
    if not 1 <= units <= _MOST_UNITS:
        raise UnfitServoError(
            f"A Bus Watchdog of {settings.watchdog_s:g} s is requested, but servos "
            "have 0.02 to 2.54 s",
            advice="set servo.watchdog_s in this range.",
        )
    return units


def rearm(link: Link, units: int, *, under_torque: bool) -> Armed:
    """Check whether the servo still accepts goals; arm it again if no torque was lost.

    A tripped watchdog silently refuses every goal. Under torque it is left tripped: the return of
    the torque after an unobserved motion would be an impact. It is written only after it was read.

    A tripped watchdog accepts no goal before it is cleared, and the old torque may then return with
    nothing to end it: so torque is off meanwhile. Every write is read back.

    Args:
        link: The servo.
        units: Its setting [20 ms].
        under_torque: The last goal was not zero.

    Raises:
        ServoLostError: The port is gone.
    """
    found = read_patiently(link, _BUS_WATCHDOG, QUICK_NS)
    if found is None:  # unknown whether there is a torque to lose
        return Armed.UNKNOWN
    if found == units:
        return Armed.YES
    if under_torque:
        return Armed.NO
    steps = [(_GOAL_CURRENT, 0), (_BUS_WATCHDOG, units)]
    if found == WATCHDOG_TRIPPED:
        steps = [(_TORQUE_ENABLE, 0), (_BUS_WATCHDOG, 0), *steps, (_TORQUE_ENABLE, 1)]
    armed = all(
        confirmed(link, register, value, 2 * QUICK_NS[-1:]) == value for register, value in steps
    )
    return Armed.YES if armed else Armed.UNKNOWN


def lost(found: Armed, name: str, silence_ns: int, watchdog_s: float) -> ServoLostError:
    """Return the error for a watchdog that was not armed.

    Args:
        found: Its state.
        name: Name of the servo.
        silence_ns: Time without an instruction [ns]; 0: there was none.
        watchdog_s: Its setting [s].
    """
    silence = f"{silence_ns * 1e-6:.0f} ms"
    if found is Armed.UNKNOWN:
        return ServoLostError(
            f"The {name} no longer answers, after {silence} without an answered request",
            advice="check the cable and the power supply.",
        )
    if not silence_ns:
        return TorqueLostError(
            f"The Bus Watchdog of the {name} has another setting than the driver wrote",
            advice="look for another program on this bus.",
        )
    return TorqueLostError(
        f"The {name} heard nothing for {silence}, so its Bus Watchdog "
        f"({watchdog_s * 1e3:.0f} ms) has dropped the torque",
        advice="find the cause of this machine's stalls, or raise servo.watchdog_s.",
    )
