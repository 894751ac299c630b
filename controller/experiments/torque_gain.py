"""Torque that the servo measures per torque commanded, where it measures its current."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

_BLOCK = 250
"""Samples whose errors are taken to belong together"""
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
    sent_ns = good["sampled_ns"] + good["age_ns"]
    acting = np.searchsorted(sent_ns, good["sampled_ns"] - round(delay * 1e9), side="right") - 1
    commanded = np.where(acting < 0, 0.0, good["torque"][np.maximum(acting, 0)])
    measured = good["measured_torque"]
    power = float(commanded @ commanded)
    total = float(measured @ measured)
    if power == 0.0 or total == 0.0:
        return None
    value = float(commanded @ measured) / power
    left = measured - value * commanded
    if value <= 0.0 or float(left @ left) > (1.0 - _EXPLAINED) * total:
        return None
    blocks = np.add.reduceat(commanded * left, np.arange(0, good.size, _BLOCK))
    return TorqueGain(value, float(np.sqrt(np.sum(blocks**2))) / power)
