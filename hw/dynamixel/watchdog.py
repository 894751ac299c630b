"""The Bus Watchdog of a running servo: looked at after a pause, armed again if nothing was lost."""

from __future__ import annotations

from enum import Enum
from typing import Final

from hw.clock import Clock
from hw.dynamixel.link import Link
from hw.dynamixel.tables import MODELS

_BUS_WATCHDOG: Final = MODELS["XM430-W350"].registers["bus_watchdog"]
"""The same in every model"""
_PATIENCE_NS: Final = (3_000_000, 3_000_000, 4_000_000, 6_000_000, 20_000_000)
"""For each reply of each attempt [ns], beside its time on the wire; the last outlasts an adapter's
16 ms timer"""
_LOOK_BYTES: Final = 11
"""Read from Bus Watchdog on, one more at each attempt: lengths of no other request, so that no late
reply to one, and none to an earlier attempt, is taken for the answer"""
_FRAME_BYTES: Final = 28
"""Of a read and its reply without data, or of a write and its reply"""


class Armed(Enum):
    """How a Bus Watchdog was found."""

    YES = "armed"
    """It is as it was set, or has been armed again at zero torque"""
    NO = "not armed"
    """It has tripped or was changed, and there was a torque to lose"""
    UNKNOWN = "unknown"
    """The servo does not answer"""


def rearm(link: Link, clock: Clock, units: int, *, under_torque: bool) -> Armed:
    """See whether the servo still takes goals; make it so if nothing was lost.

    A watchdog that has tripped refuses every goal without a word. Under torque it is left so: to
    bring the torque back after motion that nobody watched would be a blow. It is written to only
    after it was read.

    Args:
        link: The servo.
        clock: Tells the time.
        units: What it was set to [20 ms].
        under_torque: The last goal was not zero.

    Raises:
        ServoLostError: The port is gone.
    """
    now_ns = clock.now_ns
    result = Armed.UNKNOWN
    for attempt, least_ns in enumerate(_PATIENCE_NS):
        size = _LOOK_BYTES + attempt
        patience = least_ns + link.wire_ns(_FRAME_BYTES + size)
        block = link.read_block(_BUS_WATCHDOG.address, size, now_ns() + patience)
        if block is None:  # whether there is a torque to bring back is not known
            continue
        if block[0] == units:
            return Armed.YES
        result = Armed.NO
        if under_torque:
            break
        link.write_register(_BUS_WATCHDOG, 0, now_ns() + patience)
        link.send_current(0)  # the goal may have been kept, and the last zero lost
        link.write_register(_BUS_WATCHDOG, units, now_ns() + patience)
    return result
