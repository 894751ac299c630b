"""Estimates the wall of a recording from its torques and its positions."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.detector.detection import KnownWall
from haptic_wall.controller.detector.tuning import TUNING, RecordingTuning

Array = NDArray[np.float64]

MOST_DELAY: Final = 40
"""Largest delay of a torque after its position [samples]"""
_EXACT: Final = 1e-6
"""Fraction at which no other delay need be tried"""
_NOTHING: Final = 1e-9
"""Damping over stiffness that is only rounding [s]"""
_MOST: Final = 100_000
"""Largest number of fitted samples; more add no information"""


def fitted_wall(
    positions: Array, torques: Array, period: float, tuning: RecordingTuning = TUNING.recording
) -> KnownWall | None:
    """Estimate the wall; None: the torques are no wall's, or stiffness and place change.

    ``torque = -K (x - x0) - B dx/T``, of a position up to 40 samples before, not limited; zero
    outside a one-sided wall.

    Args:
        positions: Shape (n,) [rad]; NaN where one is missing.
        torques: Commanded with each sample, shape (n,) [N·m]; NaN where not known.
        period: T [s]
        tuning: Numbers for recordings
    """
    least = tuning.wall_samples
    positions, torques = positions[:_MOST], torques[:_MOST]
    acts = np.isfinite(torques) & (torques != 0.0)
    if np.count_nonzero(acts) < least:
        return None
    sign = _side(torques, acts, tuning.wall_free)
    largest = np.abs(torques[acts]).max()
    limited = acts & (np.abs(torques) >= largest * (1.0 - 1e-9))
    if np.count_nonzero(limited) > 2:  # one value at many positions is the torque limit
        acts &= ~limited
    moved = np.concatenate([[np.nan], np.diff(positions)]) / period
    best: tuple[float, Array, int] | None = None
    for late in range(min(MOST_DELAY, positions.size - least) + 1):
        found = _fit(positions, moved, torques, acts, late, least)
        if found is not None and (best is None or found[0] < 0.9 * best[0]):
            best = *found, late
            if found[0] < _EXACT:
                break
    if best is None or best[0] > tuning.wall_unexplained:
        return None
    (stiffness, damping, middle), late = best[1].tolist(), best[2]
    if abs(damping) < _NOTHING * abs(stiffness):
        damping = 0.0
    if not stiffness > 0.0:
        return None
    return KnownWall(stiffness, damping, middle / stiffness, side=sign, inserted=late * period)


def _side(torques: Array, acts: NDArray[np.bool_], least: float) -> int:
    """Return the direction in which it continues; 0: it has no outside."""
    free = np.count_nonzero(np.isfinite(torques) & ~acts)
    if free < least * torques.size:
        return 0
    if np.all(torques[acts] < 0.0):
        return 1
    return -1 if np.all(torques[acts] > 0.0) else 0


def _fit(
    positions: Array, moved: Array, torques: Array, acts: NDArray[np.bool_], late: int, least: int
) -> tuple[float, Array] | None:
    """Unexplained fraction, and K, B, K x0, of a torque ``late`` samples behind."""
    end = positions.size - late
    x, v, u = positions[:end], moved[:end], torques[late:]
    use = acts[late:] & np.isfinite(x) & np.isfinite(v)
    if np.count_nonzero(use) < least:
        return None
    x, v, u = x[use], v[use], u[use]
    size = math.sqrt(float(np.mean(u * u)))
    spread = float(np.std(x)), float(np.std(v))
    if not (size > 0.0 and min(spread) > 0.0):
        return None
    middle = float(np.mean(x))
    columns = np.column_stack([-(x - middle) / spread[0], -v / spread[1], np.ones(x.size)])
    solved, _, rank, _ = np.linalg.lstsq(columns, u, rcond=None)
    if rank < 3:
        return None
    left = u - columns @ solved
    stiffness, damping = solved[0] / spread[0], solved[1] / spread[1]
    constant = solved[2] + stiffness * middle
    unexplained = math.sqrt(float(np.mean(left * left))) / size
    return unexplained, np.array([stiffness, damping, constant])
