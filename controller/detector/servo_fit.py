"""Estimates the servo of a recording from its torques and its motion."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.detector.tuning import TUNING, RecordingTuning

Array = NDArray[np.float64]

_MOST: Final = 200_000
"""Largest number of used samples; more add no information"""


@dataclass(frozen=True, slots=True)
class FittedServo:
    """The inertia that moves like this under these torques alone."""

    inertia: float
    """J [kg·m²]"""
    speed: float
    """Speed of the oscillation [rad/s]"""
    balance: float
    """b - J w sin(w (t_d + h)): the motion decays above 0, and is fed below [N·m·s/rad]"""
    held: float
    """h, half the period for which a torque is held: it acts later by so much on the mean [s]"""

    def lag(self, damping: float = 0.0) -> float:
        """Return the delay from a sample until its torque acts [s].

        Args:
            damping: b [N·m·s/rad]; neglected friction makes the delay seem shorter.
        """
        sine = (damping - self.balance) / (self.inertia * self.speed)
        return max(0.0, math.asin(min(1.0, max(0.0, sine))) / self.speed - self.held)

    def damping(self, lag: float) -> float:
        """Return b for a known delay [s]; at least 0 [N·m·s/rad]."""
        late = self.speed * (lag + self.held)
        return max(0.0, self.balance + self.inertia * self.speed * math.sin(late))


def fitted_servo(
    positions: Array, torques: Array, period: float, tuning: RecordingTuning = TUNING.recording
) -> FittedServo | None:
    """Estimate the servo from these torques alone; None: a hand moves it, or it does not oscillate.

    ``torque = J a + b v``. Every term is weighted by a smooth window and integrated by parts, so
    that counted positions are not differentiated. An oscillation does not determine delay and
    damping separately, only their difference.

    Args:
        positions: Shape (n,) [rad]; NaN where one is missing.
        torques: Commanded with each sample, shape (n,) [N·m]; NaN where not known.
        period: T [s]
        tuning: Numbers for recordings
    """
    least = tuning.servo_finite
    x, u = _whole(positions[:_MOST], least), _whole(torques[:_MOST], least)
    if x is None or u is None:
        return None
    above = x > 0.0
    passed = np.count_nonzero(above[1:] != above[:-1])
    if passed < 2.0 * tuning.servo_cycles:
        return None
    cycle = 2.0 * x.size / float(passed)
    n = max(5, round(tuning.servo_window * cycle)) | 1
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
    if rank < 3 or unexplained > tuning.servo_unexplained or not inertia > 0.0:
        return None
    return FittedServo(inertia, math.tau / (cycle * period), balance, 0.5 * period)


def _whole(values: Array, least: float) -> Array | None:
    """Return values about their mean, missing ones interpolated; None: too many are missing."""
    fine = np.isfinite(values)
    if np.count_nonzero(fine) < max(1.0, least * values.size):
        return None
    places = np.arange(values.size)
    filled: Array = np.interp(places, places[fine], values[fine])
    about: Array = filled - filled.mean()
    return about
