"""Linear least squares of a motion in pieces, each with values of its own beside the shared ones.

A piece's own values (where it begins, and how fast) affect that piece alone, and are eliminated
piece by piece.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from haptic_wall.controller.theory.checks import FloatArray

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

    def step(self, away: FloatArray | float = 0.0) -> FloatArray:
        """Return the change of the shared values to the least squares of the linear model.

        Args:
            away: How far each is from what is known of it beforehand.
        """
        root, count = np.sqrt(self.weights), len(self.shared)
        rest = (root * self.without_own(self.shared)).reshape(count, -1)
        columns = np.concatenate([rest.T, np.diag(np.sqrt(self.precision))])
        right = np.concatenate([(root * self.left).ravel(), np.sqrt(self.precision) * away])
        # With the prior, or one of a value known exactly would hide all other values.
        scale = np.linalg.norm(columns, axis=0)
        scale[scale == 0.0] = 1.0
        found: FloatArray = np.linalg.lstsq(columns / scale, -right, rcond=_ALIKE)[0] / scale
        return found


NO_LINES = Linear(*(np.zeros(shape) for shape in ((0, 0), (0, 0, 0), (0, 0, 0), (0, 0), (0,))))
"""Of no samples"""
