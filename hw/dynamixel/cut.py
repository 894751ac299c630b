"""Switches torques off and reads them back: when the driver stops, and after its process died."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Final

from haptic_wall.hw.dynamixel.exchange import Exchange
from haptic_wall.hw.dynamixel.register_access import Table, sync_write
from haptic_wall.hw.dynamixel.tables import REGISTERS
from haptic_wall.hw.errors import ServoLostError
from haptic_wall.hw.serialport.line import Line

_QUICK_NS: Final = 4_000_000
"""Time of a reply from which on the line is slow [ns]"""
_PATIENCE_NS: Final = (2_000_000,) * 3 + (_QUICK_NS,) * 3
"""Time allowed for a reply in each round [ns]: short at first, as torque off is written once more
before each"""
_SLOW_NS: Final = 20_000_000
"""The same where replies took longer, or nobody replies: longer than an adapter's 16 ms timer"""
_SIZES: Final = range(4, 16)
"""Sizes of the blocks that are read: of no other process's requests, whose replies may be late"""
_GAP_NS: Final = 2_000_000
"""Silence after which every servo looks for a new header (they do after 1.5 ms)"""
_GAP_END_NS: Final = 20_000_000
"""Longest wait for a silence: a busy bus must not keep the torque on"""


def cut_torque(line: Line, ids: Sequence[int], baud: int = 0) -> bool:
    """Switch all torques off where the driver has died or hangs, even in the middle of a frame.

    It waits for a gap between frames: otherwise the servo could take this request for the rest of a
    truncated frame. It never writes a goal: a servo may be set to switch its torque on at any goal.
    It does not check the model: the driver has done so, and each further reply may fail.

    Args:
        line: The bus, now used by this process alone.
        ids: The servos.
        baud: The bus's rate [bit/s], for the time that bytes take; 0: negligible.

    Returns:
        Whether torque off was read back from each. False too when the port is gone.
    """
    try:
        now_ns = line.clock.now_ns
        end = now_ns() + _GAP_END_NS
        line.read()
        while line.wait(min(now_ns() + _GAP_NS, end)) and now_ns() < end:
            line.read()
        exchange = Exchange(line, ids, baud=baud)
        servos = [Table(exchange, station, "", REGISTERS) for station in exchange.stations]
        return not torque_off(servos)
    except ServoLostError:
        return False


def torque_off(servos: Sequence[Table]) -> Collection[Table]:
    """Write Torque Enable 0 to all at once, and read it back from each; try several times.

    It is written again before each read: a bad cable may lose frame after frame, and a lost read
    takes as long as twenty writes. A lost servo among many takes 18 ms, a single one 58 ms, as its
    adapter may be slow; a slow bus adds its wire time.

    Args:
        servos: The servos, on one line.

    Returns:
        Those whose torque off was not read back.
    """
    left = list(servos)
    if not left:
        return left
    exchange = left[0].exchange
    exchange.kept = sync_write(left, "torque_enable", 0)
    slow = any(one.station.longest_ns > _QUICK_NS for one in left)
    try:
        for each_ns in 6 * (_SLOW_NS,) if slow else _PATIENCE_NS:
            left = _still_on(left, each_ns)
        if not slow and len(left) == len(servos):
            for each_ns in 2 * (_SLOW_NS,):
                left = _still_on(left, each_ns)
    finally:
        exchange.kept = b""
    return left


def _still_on(servos: Sequence[Table], patience_ns: int) -> list[Table]:
    """Return those that do not reply that their torque is off."""
    return [one for one in servos if one.try_read("torque_enable", (patience_ns,), _SIZES) != 0]
