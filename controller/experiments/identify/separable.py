"""Linear least squares of a motion in pieces, each with values of its own beside the shared ones.

A piece's own values (where it begins, and how fast) affect that piece alone, and are eliminated
piece by piece. Standard errors hold where errors of successive samples are correlated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from haptic_wall.controller.theory.checks import FloatArray

CORRELATED_S = 0.05
"""Default of ``correlated_s``"""
CORRELATED = 9.0
"""Variance of correlated errors over that of independent ones, by which a prior is weighed"""
_FEW = 1.25
"""Correction of standard errors from some twenty pieces, few of which dominate"""
_FELT_S = 3e-3
"""Change of position per unit of an own value, below which that value is not fitted"""
_ALIKE = 3e-7
"""Largest relative difference of values whose effects on the motion cannot be told apart"""


@dataclass(frozen=True, slots=True)
class Linear:
    """Residuals and their derivatives at some values: arrays of s pieces with n samples."""

    left: FloatArray
    """Fitted minus measured [rad], shape (s, n)"""
    shared: FloatArray
    """Per unit of each shared value, shape (p, s, n)"""
    own: FloatArray
    """Per unit of each of the piece's own values, shape (q, s, n)"""
    weights: FloatArray
    """Shape (s, n)"""
    precision: FloatArray
    """Weight of what is known of each shared value beforehand, shape (p,); 0: nothing is"""

    @property
    def cost(self) -> float:
        """Return the weighted sum of squares [rad²]."""
        return float(np.sum(self.weights * self.left**2))

    def own_part(self, lines: FloatArray) -> FloatArray:
        """Return the own values that make the most of lines of shape (k, s, n): (k, q, s).

        They are 0 where a piece does not feel them, as one at rest its speed.
        """
        weighted = self.weights * self.own
        felt = np.sum(weighted * self.own, axis=2) > _FELT_S**2 * np.sum(self.weights, axis=1)
        weighted = weighted * felt[:, :, None]
        gram = np.einsum("qsn,rsn->sqr", weighted, self.own * felt[:, :, None])
        cross = np.einsum("qsn,ksn->sqk", weighted, lines)
        part: FloatArray = np.einsum("sqr,srk->kqs", np.linalg.pinv(gram, hermitian=True), cross)
        return part

    def without_own(self, lines: FloatArray) -> FloatArray:
        """Return lines of shape (k, s, n) without the part that own values can make."""
        rest: FloatArray = lines - np.einsum("kqs,qsn->ksn", self.own_part(lines), self.own)
        return rest

    def step(self) -> FloatArray:
        """Return the change of the shared values to the least squares, without prior knowledge."""
        root, count = np.sqrt(self.weights), len(self.shared)
        columns = (root * self.without_own(self.shared)).reshape(count, -1).T
        scale = np.linalg.norm(columns, axis=0)
        scale[scale == 0.0] = 1.0
        right = -(root * self.left).ravel()
        found: FloatArray = np.linalg.lstsq(columns / scale, right, rcond=_ALIKE)[0] / scale
        return found


NO_LINES = Linear(*(np.zeros(shape) for shape in ((0, 0), (0, 0, 0), (0, 0, 0), (0, 0), (0,))))
"""Of no samples"""


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
