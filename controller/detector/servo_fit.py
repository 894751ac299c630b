"""Estimates the servo of a recording from its torques and its motion."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_LEAST_CYCLES: Final = 1.5
_WINDOW: Final = 0.6
"""Length of the weighting window [cycles]"""
_MOST: Final = 200_000
"""Largest number of used samples; more add no information"""
_FINITE: Final = 0.95
"""Least fraction of valid samples"""
_UNEXPLAINED: Final = 0.15
"""Largest fraction of the torque that inertia and damping may leave unexplained, rms"""


@dataclass(frozen=True, slots=True)
class FittedServo:
    """The inertia that moves like this under these torques alone."""

    inertia: float
    """J [kg·m²]"""
    speed: float
    """Of the oscillation [rad/s]"""
    balance: float
    """b - J w sin(w t_d): the motion decays above 0, and is fed below [N·m·s/rad]"""

    def lag(self, damping: float = 0.0) -> float:
        """Return the delay from a sample until its torque acts [s].

        Args:
            damping: b [N·m·s/rad]; neglected friction makes the delay seem shorter.
        """
        sine = (damping - self.balance) / (self.inertia * self.speed)
        return math.asin(min(1.0, max(0.0, sine))) / self.speed

    def damping(self, lag: float) -> float:
        """Return b for a known delay [s]; at least 0 [N·m·s/rad]."""
        return max(0.0, self.balance + self.inertia * self.speed * math.sin(self.speed * lag))


def fitted_servo(positions: Array, torques: Array, period: float) -> FittedServo | None:
    """Estimate the servo from these torques alone; None: a hand moves it, or it does not oscillate.

    ``torque = J a + b v``. Every term is weighted by a smooth window and integrated by parts, so
    that counted positions are not differentiated. An oscillation does not determine delay and
    damping separately, only their difference.

    Args:
        positions: Shape (n,) [rad]; NaN where one is missing.
        torques: Commanded with each sample, shape (n,) [N·m]; NaN where not known.
        period: T [s]
    """
    x, u = _whole(positions[:_MOST]), _whole(torques[:_MOST])
    if x is None or u is None:
        return None
    above = x > 0.0
    passed = np.count_nonzero(above[1:] != above[:-1])
    if passed < 2.0 * _LEAST_CYCLES:
        return None
    cycle = 2.0 * x.size / float(passed)
    n = max(5, round(_WINDOW * cycle)) | 1
    if x.size < 2 * n:
        return None
    t = np.linspace(-1.0, 1.0, n + 2)[1:-1]
    half = 0.5 * (n + 1) * period
    inside = 1.0 - t * t
    fed = np.convolve(u, inside**3, "valid")
    columns = np.column_stack(
        [
            np.convolve(x, (24.0 * t * t * inside - 6.0 * inside**2) / half**2, "valid"),
            np.convolve(x, -6.0 * t * inside**2 / half, "valid"),
            np.ones(fed.size),
        ]
    )
    size = np.sqrt(np.mean(columns * columns, axis=0))
    spread = float(np.std(fed))
    if not (size.all() and spread > 0.0):
        return None
    solved, _, rank, _ = np.linalg.lstsq(columns / size, fed, rcond=None)
    left = fed - columns / size @ solved
    inertia, balance = float(solved[0] / size[0]), float(solved[1] / size[1])
    unexplained = math.sqrt(float(np.mean(left * left))) / spread
    if rank < 3 or unexplained > _UNEXPLAINED or not inertia > 0.0:
        return None
    return FittedServo(inertia, math.tau / (cycle * period), balance)


def _whole(values: Array) -> Array | None:
    """Return values about their mean, missing ones interpolated; None: too many are missing."""
    fine = np.isfinite(values)
    if np.count_nonzero(fine) < max(1.0, _FINITE * values.size):
        return None
    places = np.arange(values.size)
    filled: Array = np.interp(places, places[fine], values[fine])
    about: Array = filled - filled.mean()
    return about
