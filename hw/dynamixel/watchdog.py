"""Examines the Bus Watchdog after a pause, and arms it again if no torque was lost."""

from __future__ import annotations

from typing import Final

from haptic_wall.hw.dynamixel.register_access import QUICK_NS, Table
from haptic_wall.hw.dynamixel.registers import WATCHDOG_TRIPPED, WATCHDOG_UNIT_NS
from haptic_wall.hw.errors import TorqueLostError, UnfitServoError

_MOST_UNITS: Final = 127
_NEVER_NS: Final = 1 << 62


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

    Raises:
        ServoLostError: The port is gone.
    """
    steps = (
        ("torque_enable", 0),
        ("bus_watchdog", 0),
        ("goal_current", 0),
        ("bus_watchdog", units),
        ("torque_enable", 1),
    )
    return all(table.try_write(name, value, 3 * QUICK_NS[-1:]) == value for name, value in steps)


class WatchdogMonitor:
    """Examines the Bus Watchdog of one servo after a pause in which it may have tripped.

    Args:
        watchdog_s: Time of the Bus Watchdog [s].
        table: The servo.
        name: Name of the servo, for messages.

    Raises:
        UnfitServoError: No servo has such a Bus Watchdog.
    """

    __slots__ = (
        "_name",
        "_table",
        "_units",
        "_watchdog_s",
        "heard_ns",
        "limit_ns",
    )

    def __init__(self, watchdog_s: float, table: Table, name: str) -> None:
        self._units = watchdog_units(watchdog_s)
        self._watchdog_s = watchdog_s
        self._table = table
        self._name = name
        self.heard_ns = 0
        """When the last answered request was sent [ns]"""
        self.limit_ns = _NEVER_NS
        """Time since then after which the Bus Watchdog may have tripped [ns]; not reached before
        ``begin``"""

    def begin(self) -> None:
        """Start monitoring: the torque is on from now."""
        # The watchdog counts whole units, so that one set to two may trip soon after the first.
        self.limit_ns = round(max(self._units - 1, 0.75) * WATCHDOG_UNIT_NS)

    def end(self) -> None:
        """Stop monitoring: the torque is off from now, and pauses may have any length."""
        self.limit_ns = _NEVER_NS

    def resume(self, now_ns: int, *, under_torque: bool) -> None:
        """Examine the Bus Watchdog if the last answered request is too long ago; see ``look``."""
        silence_ns = now_ns - self.heard_ns
        if silence_ns > self.limit_ns:
            self.look(silence_ns, under_torque=under_torque)
            self.heard_ns = now_ns

    def look(self, silence_ns: int, *, under_torque: bool) -> None:
        """Check whether the servo still accepts goals; arm it again if no torque was lost.

        A tripped watchdog silently refuses every goal. Under torque it is left tripped: the return
        of the torque after an unobserved motion would be an impact.

        Args:
            silence_ns: Time without an instruction [ns]; 0: there was none.
            under_torque: The last goal was not zero.

        Raises:
            ServoLostError: The port is gone, or there is no reply.
            TorqueLostError: The torque is gone.
        """
        found = self._table.try_read("bus_watchdog", QUICK_NS)
        if found == self._units:
            return
        if found is not None and found != WATCHDOG_TRIPPED:
            raise TorqueLostError(
                f"The Bus Watchdog of the {self._name} has another setting than the driver wrote, "
                f"{found}",
                advice="look for another program on this bus, and check the supply: a restart sets "
                "it to 0.",
            )
        silence = f"{silence_ns * 1e-6:.0f} ms" if silence_ns else "a while"
        if found == WATCHDOG_TRIPPED and under_torque:
            raise TorqueLostError(
                f"The {self._name} heard nothing for {silence}, so its Bus Watchdog "
                f"({self._watchdog_s * 1e3:.0f} ms) has dropped the torque",
                advice="find the cause of this machine's stalls, or raise servo.watchdog_s.",
            )
        if found is None or not rearm(self._table, self._units):
            raise self._table.lost(
                f"The {self._name} no longer answers, after {silence} without an answered request",
                ": a servo that restarts is silent meanwhile",
            )
