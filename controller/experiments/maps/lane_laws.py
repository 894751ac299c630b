"""Computes the torques of a law in lanes; as ``many_walls`` with a ``tables.Table``.

Each lane keeps the piece of the table in which its wall was measured. Most walls are still in it a
period later; those that have left it are rare and search from there, one by one.
"""

from __future__ import annotations

import math

from haptic_wall.controller.experiments.maps.lane_rows import (
    EARLIER,
    FIRST,
    FLAG,
    FROM,
    LANES,
    MEASURED,
    NUMBER,
    OVER,
    RISE,
    RUN,
    SOFTNESS,
    START,
    TO,
    TORQUE,
    VIRTUAL,
)
from haptic_wall.controller.theory.checks import FloatArray


def follow_table(
    w: FloatArray, table: FloatArray, kept: FloatArray, in_contact: bool, back: int
) -> None:
    """Compute the torques from the measured positions.

    Args:
        w: The workspace.
        table: Positions and elongations [rad], shape (2, rows).
        kept: The piece of each lane; zeros at first, in which there is no position.
        in_contact: The law acts in contact only, and never pulls.
        back: Periods between the two positions of the velocity estimate; 0: there is none yet.
    """
    few = 0
    for i in range(LANES):
        measured = w[MEASURED * LANES + i]
        stays = (measured >= kept[FROM * LANES + i]) & (measured < kept[TO * LANES + i])
        few += 0 if stays else 1
        w[FLAG * LANES + i] = 0.0 if stays else 1.0
    for i in range(LANES if few else 0):
        if w[FLAG * LANES + i] != 0.0:
            keep(kept, table, i, w[MEASURED * LANES + i])
    last = table.shape[1] - 1
    bottom, top = table[0, 0], table[0, last]
    lowest, highest = table[1, 0], table[1, last]
    for i in range(LANES):
        measured = w[MEASURED * LANES + i]
        into, rise = measured - kept[START * LANES + i], kept[RISE * LANES + i]
        away = kept[FIRST * LANES + i] + rise * into / kept[RUN * LANES + i]
        away = lowest if measured <= bottom else away
        away = highest if measured >= top else away
        torque = w[SOFTNESS * LANES + i] * away
        if back:
            estimate = (measured - w[EARLIER * LANES + i]) / w[OVER * LANES + i]
            torque = torque - w[VIRTUAL * LANES + i] * estimate
        released = in_contact & ((away == 0.0) | (away * torque >= 0.0))
        w[TORQUE * LANES + i] = 0.0 if released else torque


def keep(kept: FloatArray, table: FloatArray, i: int, measured: float) -> None:
    """Keep the piece of lane ``i`` at this position [rad]."""
    last = table.shape[1] - 1
    low = piece(table, int(kept[NUMBER * LANES + i]), measured)
    kept[NUMBER * LANES + i] = low
    kept[FROM * LANES + i] = table[0, low] if low else -math.inf
    kept[TO * LANES + i] = table[0, low + 1] if low + 1 < last else math.inf
    kept[START * LANES + i], kept[FIRST * LANES + i] = table[0, low], table[1, low]
    kept[RUN * LANES + i] = table[0, low + 1] - table[0, low]
    kept[RISE * LANES + i] = table[1, low + 1] - table[1, low]


def piece(table: FloatArray, near: int, measured: float) -> int:
    """Return the number of the last row at or below a position [rad]; the last row has no piece.

    It looks further and further from the piece ``near``, and then between the last two looks.
    """
    last, low, high, step = table.shape[1] - 1, near, near + 1, 1
    while low > 0 and not table[0, low] <= measured:
        low, high, step = max(low - step, 0), low, 2 * step
    while high < last and table[0, high] <= measured:
        low, high, step = high, min(high + step, last), 2 * step
    while high - low > 1:
        middle = (low + high) // 2
        if table[0, middle] <= measured:
            low = middle
        else:
            high = middle
    return low
