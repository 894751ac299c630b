"""Executes the sign check at the start-up: runs ``probe``, repeats it, and records the result."""

from __future__ import annotations

from typing import Final

from haptic_wall.hw.clock import Clock
from haptic_wall.hw.dynamixel.checklist import Checklist, remedy
from haptic_wall.hw.dynamixel.link import Link
from haptic_wall.hw.dynamixel.probe import Push, probe_sign
from haptic_wall.hw.dynamixel.register_access import Table
from haptic_wall.hw.dynamixel.tables import WATCHDOG_TRIPPED
from haptic_wall.hw.dynamixel.torque_law import TorqueLaw
from haptic_wall.hw.dynamixel.watchdog import Armed, rearm, watchdog_units
from haptic_wall.hw.errors import Problem
from haptic_wall.hw.settings import DriverSettings

_PUSHES: Final = 3
"""Number of attempts: without real-time settings a stall may exceed the Bus Watchdog"""


def prove_the_sign(
    settings: DriverSettings,
    law: TorqueLaw,
    current_limit: int,
    table: Table,
    link: Link,
    checklist: Checklist,
    *,
    clock: Clock,
    name: str,
) -> None:
    """Check that a small torque away from the wall moves the shaft away from the wall.

    Args:
        settings: Contains torque and direction of the push.
        law: Converts torque to goal current.
        current_limit: Current limit of the servo.
        table: The servo, with torque on at zero torque.
        link: Link to the same servo, for goals and positions.
        checklist: Receives the result.
        clock: Tells the time.
        name: Name of the servo, for messages.

    Raises:
        ServoLostError: The servo stops replying.
    """
    if settings.probe_torque <= 0.0:
        checklist.add("torque sign", True, "not probed", "not asked for")
        return
    wanted = settings.probe_torque
    if settings.torque_limit > 0.0:
        wanted = min(wanted, settings.torque_limit)
    limit = min(law.within(wanted), current_limit)
    direction = 1 if settings.probe_direction > 0 else -1
    for _ in range(_PUSHES):
        push = probe_sign(link, clock, direction * max(1, limit), name)
        tripped = not push.moved and table.read("bus_watchdog") == WATCHDOG_TRIPPED
        if (
            not tripped
            or rearm(link, watchdog_units(settings), under_torque=False) is not Armed.YES
        ):
            break
    found, fault = _told(push, law.torque(push.peak), tripped, settings.watchdog_s)
    checklist.add("torque sign", push.sign_is_right, found, "motion with the torque", fault)


def _told(push: Push, torque: float, tripped: bool, watchdog_s: float) -> tuple[str, Problem]:
    """Return the result, and the fault if it is wrong."""
    if push.moved:
        found = f"{push.moved:+d} counts at {torque:+.3f} N·m"
        return found, remedy(
            f"Its shaft moved the wrong way ({found}), so a wall would pull instead of push",
            "keep the shaft free during the start, then check Drive Mode (10).",
        )
    if tripped:
        return "no motion, because the Bus Watchdog tripped", remedy(
            f"Its Bus Watchdog ({watchdog_s * 1e3:.0f} ms) ended the probe of the torque's sign",
            "find the cause of this machine's stalls, or raise servo.watchdog_s.",
        )
    return f"no motion at {torque:+.3f} N·m", remedy(
        f"Its shaft did not move at {abs(torque):.2g} N·m",
        "free it if it is blocked or held, or raise servo.probe_torque; 0 skips the probe.",
    )
