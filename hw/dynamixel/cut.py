"""Switches torques off and reads them back: when the driver stops, and after its process died."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Final

from haptic_wall.hw.dynamixel.codec import BROADCAST, Instruction, encode
from haptic_wall.hw.dynamixel.exchange import Exchange
from haptic_wall.hw.dynamixel.register_access import Table
from haptic_wall.hw.dynamixel.tables import REGISTERS
from haptic_wall.hw.errors import ServoLostError
from haptic_wall.hw.serialport.line import Line

_QUICK_NS: Final = 4_000_000
"""Time allowed for a reply [ns]"""
_SLOW_NS: Final = 20_000_000
"""The same where replies took longer, or nobody replies: longer than an adapter's 16 ms timer"""
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
        exchange = Exchange(line, [servo_id], baud=baud)
        return not torque_off([Table(exchange, exchange.stations[0], "", REGISTERS)])
    except ServoLostError:
        return False


def torque_off(servos: Sequence[Table]) -> list[Table]:
    """Write Torque Enable 0 to all at once, twice, and read it back from each; try several times.

    Only what is read back counts, in a block of a size that no other request has: a late reply must
    not be taken for the answer. A lost one among many takes 16 ms, a single one 56 ms, as its
    adapter may be slow; a slow bus adds its wire time.

    Args:
        servos: The servos, on one line.

    Returns:
        Those whose torque off was not read back.

    Raises:
        ServoLostError: The port is gone.
    """
    left = list(servos)
    slow = any(one.station.longest_ns > _QUICK_NS for one in servos)
    for patience_ns in 4 * (_SLOW_NS if slow else _QUICK_NS,) + 2 * (_SLOW_NS,):
        heard = len(left) < len(servos)
        if not left or (patience_ns == _SLOW_NS and heard and not slow):
            break
        off = b"".join(struct.pack("<BB", one.station.id, 0) for one in left)
        params = struct.pack("<HH", REGISTERS["torque_enable"].address, 1) + off
        frame = encode(BROADCAST, Instruction.SYNC_WRITE, params)
        exchange = left[0].exchange
        for _ in range(2):
            exchange.line.write(frame)
        allowed_ns = (patience_ns + exchange.wire_ns(2 * len(frame)),)
        left = [one for one in left if one.try_read("torque_enable", allowed_ns, _SIZES) != 0]
    return left
