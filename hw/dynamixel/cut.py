"""Torque off, confirmed: by the driver at its end, and by another process if the driver is dead."""

from __future__ import annotations

from typing import Final

from haptic_wall.hw.dynamixel.line import Line
from haptic_wall.hw.dynamixel.link import Link
from haptic_wall.hw.dynamixel.tables import REGISTERS
from haptic_wall.hw.dynamixel.wire import ASKING_BYTES
from haptic_wall.hw.errors import ServoLostError

_TORQUE_ENABLE: Final = REGISTERS["torque_enable"]
_PATIENCE_NS: Final = (3_000_000, 6_000_000, 12_000_000, 24_000_000)
"""For each reply of each attempt [ns]: short first, since a lost frame is the likely reason; the
last also outlasts an adapter's 16 ms timer"""
_UNIQUE_BYTES: Final = 7
"""A length that no other request has"""
_GAP_NS: Final = 2_000_000
"""Silence after which every servo looks for a new header (they do after 1.5 ms)"""
_GAP_END_NS: Final = 20_000_000
"""A bus that is never silent must not keep the torque on"""


def cut_torque(line: Line, servo_id: int, baud: int = 0) -> bool:
    """Switch the torque off on a line whose user is dead or hung, in the middle of anything.

    Waits for a gap between frames, so that a frame cut short by the user's death does not swallow
    this one. Never writes a goal: a servo may be set to switch its torque on at any goal.
    Does not ask who it is, as the driver did before it had torque: a cut that needs one reply more
    is one that may fail.

    Args:
        line: The bus, now this process's alone.
        servo_id: Whose torque.
        baud: The bus's rate [bit/s], for the time that bytes take; 0: none worth counting.

    Returns:
        Whether torque off was read back. False too when the port is gone.
    """
    try:
        now_ns = line.clock.now_ns
        end = now_ns() + _GAP_END_NS
        line.read()
        while line.wait(min(now_ns() + _GAP_NS, end)) and now_ns() < end:
            line.read()
        return torque_off(line, Link(line, servo_id, baud=baud))
    except ServoLostError:
        return False


def torque_off(line: Line, link: Link) -> bool:
    """Write Torque Enable 0 and read it back, a few times if need be.

    Takes 90 ms at most, on a slow bus its wire time more. A late reply to somebody's
    earlier question must not be taken for the answer. Replies come in order and at most one was
    under way, so once the write is confirmed it has passed. Else as many registers are read from
    Torque Enable on as nobody else asks for.

    Returns:
        Whether torque off was read back.

    Raises:
        ServoLostError: The port is gone.
    """
    now_ns = line.clock.now_ns
    for least_ns in _PATIENCE_NS:
        patience = least_ns + link.wire_ns(ASKING_BYTES + _UNIQUE_BYTES)
        confirmed = link.write_register(_TORQUE_ENABLE, 0, now_ns() + patience)
        size = 1 if confirmed else _UNIQUE_BYTES
        found = link.read_block(_TORQUE_ENABLE.address, size, now_ns() + patience)
        if found is not None and found[0] == 0:
            return True
    return False
