"""Computes standard errors of a fit to recorded motions, by residuals and by leaving parts out."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.experiments.recorded.shooting import Shot
from haptic_wall.controller.theory.checks import FloatArray

_PART_S = 0.25
"""Length of the parts that are left out in turn [s]"""
_MOST_PARTS = 200
_FEW = 1.25
"""Factor, because the parts are few"""


def covariance(shot: Shot, of: NDArray[np.intp]) -> FloatArray:
    """Return the covariance of the parameters, per inertia.

    It is the sum of what leaving out parts of 0.25 s, and leaving out whole pieces, in turn changes
    (the larger of the two), by one step of the fit, and of errors that are independent.

    Args:
        shot: The fit.
        of: The stretch of each piece.
    """
    flat = shot.slopes.reshape(len(shot.names), -1)
    left = shot.left.ravel()
    square = flat @ flat.T
    scale = np.sqrt(np.maximum(np.diag(square), 1e-300))
    told = np.linalg.pinv(square / np.outer(scale, scale), rcond=1e-10) / np.outer(scale, scale)
    free = max(1, np.count_nonzero(shot.pieces.held) - len(shot.names) - 2 * len(shot.pieces.time))
    independent = told * float(left @ left) / free
    time = shot.pieces.time
    since = np.floor((time - time[:, :1]) / max(_PART_S, float(np.ptp(time)) / _MOST_PARTS))
    each = since + 1e6 * np.arange(len(time))[:, None]
    parts = _jackknife(shot, np.where(shot.pieces.held, each, -1.0), square)
    found = parts
    if np.unique(of).size >= 3:
        whole = np.where(shot.pieces.held, of[:, None].astype(float), -1.0)
        found = _larger(parts, _jackknife(shot, whole, square))
    elif len(time) >= 4:
        whole = np.where(shot.pieces.held, np.arange(float(len(time)))[:, None], -1.0)
        found = _larger(parts, _jackknife(shot, whole, square))
    return _FEW**2 * _larger(found, independent)


def _larger(one: FloatArray, other: FloatArray) -> FloatArray:
    """Return ``one``, scaled up where a variance of ``other`` is larger."""
    ratio = np.sqrt(np.maximum(np.diag(other), 0.0) / np.maximum(np.diag(one), 1e-300))
    factor = np.clip(np.maximum(1.0, np.where(np.isfinite(ratio), ratio, 1.0)), 1.0, 1e6)
    out: FloatArray = one * np.outer(factor, factor)
    return out


def _jackknife(shot: Shot, groups: FloatArray, square: FloatArray) -> FloatArray:
    """Return the covariance by leaving out one group of rows after the other."""
    left = shot.left
    steps = []
    for group in np.unique(groups[groups >= 0.0]):
        inside = groups == group
        own = shot.slopes[:, inside]
        rest = square - own @ own.T
        gradient = -(own @ left[inside])
        scale = np.sqrt(np.maximum(np.diag(rest), 1e-300))
        part = np.linalg.lstsq(rest / np.outer(scale, scale), gradient / scale, rcond=1e-8)[0]
        steps.append(part / scale)
    changes = np.array(steps)
    count = len(changes)
    if count < 2:
        return np.zeros((len(shot.names), len(shot.names)))
    around = changes - changes.mean(axis=0)
    out: FloatArray = (count - 1) / count * around.T @ around
    return out


def stderr_of(covariance_: FloatArray, gradient: FloatArray) -> float:
    """Return the standard error of a function of the parameters.

    Args:
        covariance_: Covariance of the parameters.
        gradient: Gradient of the function.
    """
    return math.sqrt(max(float(gradient @ covariance_ @ gradient), 0.0))
