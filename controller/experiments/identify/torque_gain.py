"""Torque that the servo measures per torque commanded, where it measures its current."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

_BLOCK = 250
"""Samples whose errors are taken to belong together"""
_STEADY_S, _STEADY = 0.005, 0.05
"""How long before and after, and by what share of the largest, a steady torque may differ"""
_EXPLAINED = 0.9
"""Share of the measured torque's variance that the commanded one must explain"""


class TorqueGain(NamedTuple):
    """The gain and its standard error."""

    value: float
    stderr: float


def torque_gain(rows: NDArray[np.void], delay: float) -> TorqueGain | None:
    """Slope of the measured over the commanded torque.

    Args:
        rows: Of a log, dtype ``telemetry.ROW``.
        delay: From a torque's sending to its action [s].

    Returns:
        None where the servo measures no current, or one that does not follow the torque (that of
        the supply, which goes with the power).
    """
    good = rows[np.isfinite(rows["measured_torque"]) & (rows["sampled_ns"] > 0)]
    if good.size < 10 * _BLOCK:
        return None
    around = np.array([_acting(good, delay + away) for away in (-_STEADY_S, 0.0, _STEADY_S)])
    # Where it changes, an error of the delay would pass for one of the gain.
    steady = np.ptp(around, axis=0) <= _STEADY * np.max(np.abs(around))
    commanded, measured = around[1][steady], good["measured_torque"][steady]
    power = float(commanded @ commanded)
    total = float(measured @ measured)
    if power == 0.0 or total == 0.0:
        return None
    value = float(commanded @ measured) / power
    left = measured - value * commanded
    if value <= 0.0 or float(left @ left) > (1.0 - _EXPLAINED) * total:
        return None
    blocks = np.add.reduceat(commanded * left, np.arange(0, commanded.size, _BLOCK))
    return TorqueGain(value, float(np.sqrt(np.sum(blocks**2))) / power)


def _acting(rows: NDArray[np.void], delay: float) -> NDArray[np.float64]:
    """The torque that was in force at each sample [N·m]."""
    sent_ns = rows["sampled_ns"] + rows["age_ns"]
    index = np.searchsorted(sent_ns, rows["sampled_ns"] - round(delay * 1e9), side="right") - 1
    return np.where(index < 0, 0.0, rows["torque"][np.maximum(index, 0)])
