"""Estimates the measured torque per commanded torque, where the servo measures its current."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.experiments.estimated import Estimated

_BLOCK = 250
"""Samples with correlated errors"""
_STEADY_S, _STEADY = 0.005, 0.05
"""Time before and after, and largest relative change, of a steady torque"""
_EXPLAINED = 0.9
"""Least fraction of the measured torque's variance that the commanded one must explain"""


def torque_gain(rows: NDArray[np.void], delay: float, dead_band: float = 0.0) -> Estimated | None:
    """Return the slope of the measured over the commanded torque.

    Args:
        rows: Rows of a log, dtype ``telemetry.ROW``.
        delay: Delay from sending a torque until it acts [s].
        dead_band: Torque that is missing of what is commanded [N·m].

    Returns:
        None where the servo measures no current, or one that does not follow the torque (that of
        the supply, which follows the power).
    """
    good = rows[np.isfinite(rows["measured_torque"]) & (rows["sampled_ns"] > 0)]
    if good.size < 10 * _BLOCK:
        return None
    around = np.array([_acting(good, delay + away) for away in (-_STEADY_S, 0.0, _STEADY_S)])
    # Where it changes, an error of the delay would look like one of the gain.
    steady = np.ptp(around, axis=0) <= _STEADY * np.max(np.abs(around))
    commanded, measured = around[1][steady], good["measured_torque"][steady]
    commanded = commanded - np.clip(commanded, -dead_band, dead_band)
    power = float(commanded @ commanded)
    total = float(measured @ measured)
    if power == 0.0 or total == 0.0:
        return None
    value = float(commanded @ measured) / power
    left = measured - value * commanded
    if value <= 0.0 or float(left @ left) > (1.0 - _EXPLAINED) * total:
        return None
    blocks = np.add.reduceat(commanded * left, np.arange(0, commanded.size, _BLOCK))
    return Estimated(value, float(np.sqrt(np.sum(blocks**2))) / power)


def _acting(rows: NDArray[np.void], delay: float) -> NDArray[np.float64]:
    """Return the acting torque at each sample [N·m]."""
    sent_ns = rows["sampled_ns"] + rows["age_ns"]
    index = np.searchsorted(sent_ns, rows["sampled_ns"] - round(delay * 1e9), side="right") - 1
    return np.where(index < 0, 0.0, rows["torque"][np.maximum(index, 0)])
