"""Measures how fast a wall oscillates, from the torque in the last rows of a run."""

from __future__ import annotations

from typing import Final

import numpy as np

from haptic_wall.controller.theory.checks import FloatArray

STRETCH_S: Final = 1.0
"""Time over which it is measured [s]"""
LEAST_CYCLES: Final = 3
_BAND: Final = 0.15
"""Of the range: a crossing of the middle counts once the value was so far on both sides [1]"""
_REGULAR: Final = 0.35
"""Largest standard deviation of the cycles over their mean [1]"""


def rhythm(torque: FloatArray, rate_hz: float, least: float) -> float | None:
    """Return the frequency of an oscillation [Hz]; None: there is none, or it is not regular.

    Args:
        torque: Of the last stretch, evenly spaced [N·m], shape (n,).
        rate_hz: Its samples per second.
        least: Smallest range of the torque that counts [N·m].
    """
    found = torque[np.isfinite(torque)]
    if len(found) < LEAST_CYCLES:
        return None
    low, high = float(found.min()), float(found.max())
    if high - low < least:
        return None
    middle = 0.5 * (low + high)
    band = _BAND * (high - low)
    # +1 above the band, -1 below, and within it as before
    side = np.where(found > middle + band, 1, np.where(found < middle - band, -1, 0))
    sides = side[side != 0]
    rises = np.flatnonzero(side != 0)[1:][np.diff(sides) > 0]
    if len(rises) < LEAST_CYCLES + 1:
        return None
    cycles = np.diff(rises) / rate_hz
    if float(cycles.std()) > _REGULAR * float(cycles.mean()):
        return None
    return 1.0 / float(cycles.mean())
