"""Switches the torque off and reads it back: when the driver stops, and after its process died."""

from __future__ import annotations

from typing import Final

from haptic_wall.hw.dynamixel.link import Link
from haptic_wall.hw.dynamixel.register_access import QUICK_NS, confirmed
from haptic_wall.hw.dynamixel.tables import REGISTERS
from haptic_wall.hw.errors import ServoLostError
from haptic_wall.hw.serialport.line import Line

_TORQUE_ENABLE: Final = REGISTERS["torque_enable"]
_PATIENCE_NS: Final = (*QUICK_NS[2:], QUICK_NS[-1])
"""Time allowed for each reply of each attempt [ns]; two attempts outlast a 16 ms timer"""
_SIZES: Final = range(4, 16)
"""Sizes of the blocks that are read: of no other process's requests, whose replies may be late"""
_GAP_NS: Final = 2_000_000
"""Silence after which every servo looks for a new header (they do after 1.5 ms)"""
_GAP_END_NS: Final = 20_000_000
"""Longest wait for a silence: a busy bus must not keep the torque on"""


def cut_torque(line: Line, servo_id: int, baud: int = 0) -> bool:
    """Switch the torque off on a bus whose driver has died or hangs, even in the middle of a frame.

    It waits for a gap between frames: otherwise the servo could take this request for the rest of a
    truncated frame. It never writes a goal: a servo may be set to switch its torque on at any goal.
    It does not check the model: the driver has done so, and each further reply may fail.

    Args:
        line: The bus, now used by this process alone.
        servo_id: The servo.
        baud: The bus's rate [bit/s], for the time that bytes take; 0: negligible.

    Returns:
        Whether torque off was read back. False too when the port is gone.
    """
    try:
        now_ns = line.clock.now_ns
        end = now_ns() + _GAP_END_NS
        line.read()
        while line.wait(min(now_ns() + _GAP_NS, end)) and now_ns() < end:
            line.read()
        return torque_off(Link(line, servo_id, baud=baud))
    except ServoLostError:
        return False


def torque_off(link: Link) -> bool:
    """Write Torque Enable 0 and read it back; try several times.

    It takes at most 100 ms; a slow bus adds its wire time. Only what is read back counts, in a
    block of a size that no other request has: a late reply must not be taken for the answer.

    Returns:
        Whether torque off was read back.

    Raises:
        ServoLostError: The port is gone.
    """
    return confirmed(link, _TORQUE_ENABLE, 0, _PATIENCE_NS, _SIZES) == 0
