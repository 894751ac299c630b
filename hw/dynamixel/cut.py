"""Torque off, confirmed: by the driver at its end, and by another process if the driver is dead."""

from __future__ import annotations

from typing import Final

from hw.dynamixel.line import Line
from hw.dynamixel.link import Link
from hw.dynamixel.tables import MODELS
from hw.errors import ServoLostError

_TORQUE_ENABLE: Final = MODELS["XM430-W350"].registers["torque_enable"]
"""The same in every model"""
_PATIENCE_NS: Final = (3_000_000, 6_000_000, 12_000_000, 24_000_000)
"""For each reply of each attempt [ns]: short first, since a lost frame is the likely reason; the
last also outlasts an adapter's 16 ms timer"""
_GAP_NS: Final = 2_000_000
"""Silence after which every servo looks for a new header (they do after 1.5 ms)"""
_GAP_END_NS: Final = 20_000_000
"""A bus that is never silent must not keep the torque on"""


def cut_torque(line: Line, servo_id: int) -> bool:
    """Switch the torque off on a line whose user is dead or hung, in the middle of anything.

    Waits for a gap between frames, so that a frame cut short by the user's death does not swallow
    this one. Never writes a goal: a servo may be set to switch its torque on at any goal.

    Args:
        line: The bus, now this process's alone.
        servo_id: Whose torque.

    Returns:
        Whether torque off was read back. False too when the port is gone.
    """
    try:
        now_ns = line.clock.now_ns
        end = now_ns() + _GAP_END_NS
        line.read()
        while line.wait(min(now_ns() + _GAP_NS, end)) and now_ns() < end:
            line.read()
        return torque_off(line, Link(line, servo_id))
    except ServoLostError:
        return False


def torque_off(line: Line, link: Link) -> bool:
    """Write Torque Enable 0 and read it back, a few times if need be (90 ms at most).

    Returns:
        Whether torque off was read back.

    Raises:
        ServoLostError: The port is gone.
    """
    now_ns = line.clock.now_ns
    for patience in _PATIENCE_NS:
        link.write_register(_TORQUE_ENABLE, 0, now_ns() + patience)
        if link.read_register(_TORQUE_ENABLE, now_ns() + patience) == 0:
            return True
    return False
