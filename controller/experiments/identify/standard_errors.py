"""Computes standard errors of fitted values when errors of successive samples are correlated."""

from __future__ import annotations

import numpy as np

from haptic_wall.controller.experiments.identify.separable import Linear
from haptic_wall.controller.theory.checks import FloatArray

CORRELATED_S = 0.05
"""Default of ``correlated_s``"""
CORRELATED = 9.0
"""Variance of correlated errors over that of independent ones, by which a prior is weighed"""
_FEW = 1.25
"""Correction of standard errors from some twenty pieces, few of which dominate"""


def standard_covariance(
    linear: Linear, period: float, correlated_s: float = CORRELATED_S
) -> FloatArray:
    """Return the covariance of the shared values, robust to correlated errors.

    Of three estimates each variance is the largest: independent errors; errors correlated
    over ``correlated_s`` (Bartlett's weights); errors correlated within a whole piece. The
    correlation is that of the first.

    Args:
        linear: About the fitted values.
        period: Period from sample to sample [s].
        correlated_s: Assumed correlation time of errors [s].

    Source: W. K. Newey, K. D. West, Econometrica 55(3), 1987; K.-Y. Liang, S. L. Zeger,
    Biometrika 73(1), 1986.
    """
    rest, weights, left = linear.without_own(linear.shared), linear.weights, linear.left
    count, groups = rest.shape[0], rest.shape[1]
    scale = np.sqrt(np.sum(weights * rest**2, axis=(1, 2)) + linear.precision)
    unit = np.where(scale > 0.0, scale, 1.0)
    rest = rest / unit[:, None, None]
    known = np.diag(linear.precision / unit**2)
    inverse = np.linalg.pinv(_products(rest * weights, rest) + known)
    scores = rest * weights * left
    samples = float(np.sum(weights))
    free = max(1.0, samples - count - 2 * groups)
    sums = scores.sum(axis=2)
    level = linear.cost / free
    independent = level * inverse
    prior = inverse @ (CORRELATED * level * known) @ inverse
    clustered = inverse @ (sums @ sums.T) @ inverse * groups / max(1, groups - count) + prior
    lags = round(correlated_s / period)
    meat = _products(scores, scores)
    for lag in range(1, lags + 1):
        cross = _products(scores[:, :, lag:], scores[:, :, :-lag])
        meat += (1.0 - lag / (lags + 1)) * (cross + cross.T)
    correlated = inverse @ meat @ inverse * samples / free + prior
    variance = np.max([np.diag(c) for c in (independent, clustered, correlated)], axis=0)
    errors = _FEW * np.sqrt(np.maximum(variance, 0.0)) / unit
    own = np.sqrt(np.maximum(np.diag(inverse), 1e-300))
    covariance: FloatArray = inverse / np.outer(own, own) * np.outer(errors, errors)
    covariance[np.diag_indices_from(covariance)] = errors**2
    return covariance


def _products(one: FloatArray, other: FloatArray) -> FloatArray:
    """Return the sums over pieces and samples of the products of two sets of slopes."""
    summed: FloatArray = np.tensordot(one, other, axes=((1, 2), (1, 2)))
    return summed
