"""Least squares of a motion in pieces, each of which has values of its own beside the shared ones.

A piece's own values (where it begins, and how fast) affect that piece alone. They are eliminated
piece by piece, and scipy fits the shared values to the rest (variable projection).

Source: G. H. Golub, V. Pereyra, SIAM J. Numer. Anal. 10(2), 1973; L. Kaufman, BIT 15(1), 1975.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from haptic_wall.controller.theory.checks import FloatArray

_FELT_S = 3e-3
"""Change of position per unit of an own value, below which that value is not fitted"""
_ALIKE = 3e-7
"""Largest relative difference of values whose effects on the motion cannot be told apart"""
_SETTLED = 1e-4
"""Relative improvement of the squares that is not worth another step"""
_FAR = 1e3
"""Stands for the residuals of values with which no motion is finite [rad]"""


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


Linearised = Callable[[FloatArray, FloatArray], Linear]
"""From shared values, shape (p,), and own values, shape (q, s)"""


def fit_pieces(
    linearised: Linearised,
    begin: FloatArray,
    own: FloatArray,
    *,
    bounds: tuple[FloatArray, FloatArray],
    mean: FloatArray | float = 0.0,
    rounds: int,
    enough: float,
) -> tuple[FloatArray, FloatArray]:
    """Return the shared and the own values with the least squares.

    Args:
        linearised: The model.
        begin: Shared values at the start, shape (p,).
        own: Own values at the start, shape (q, s).
        bounds: Least and largest of each shared value.
        mean: What is known of each shared value beforehand, with the precision of the model.
        rounds: Largest number of tried values.
        enough: Relative improvement of the squares at which it ends.
    """
    at: tuple[FloatArray, FloatArray, Linear | None] = (begin, own, None)
    tried = at

    def left(values: FloatArray) -> FloatArray:
        nonlocal tried
        base, near, now = at
        if now is not None:
            moved = now.left + np.tensordot(values - base, now.shared, axes=1)
            near = near - now.own_part(moved[None])[0]
        found = _finite(linearised(values, near))
        tried = (values.copy(), near, found)
        known = np.sqrt(found.precision) * (values - mean)
        return np.concatenate([(np.sqrt(found.weights) * found.left).ravel(), known])

    def slopes(values: FloatArray) -> FloatArray:
        nonlocal at
        _, near, now = tried  # scipy asks for the slopes where it tried last, if that was better
        assert now is not None
        at = (values.copy(), near, now)
        rest = np.sqrt(now.weights) * now.without_own(now.shared)
        return np.concatenate([rest.reshape(len(values), -1).T, np.diag(np.sqrt(now.precision))])

    least_squares(
        left, np.clip(begin, *bounds), slopes, bounds=bounds, method="dogbox", x_scale="jac",
        ftol=enough, xtol=1e-12, gtol=None, max_nfev=rounds,
    )  # fmt: skip
    values, own, now = at
    if now is not None:  # they are those before the last step
        best = own - now.own_part(now.left[None])[0]
        own = best if linearised(values, best).cost < now.cost else own
    return values, own


def _finite(linear: Linear) -> Linear:
    """Return residuals as they are, or large ones where values are far from any servo's."""
    if np.isfinite(linear.cost):
        return linear
    return replace(
        linear,
        left=np.full_like(linear.left, _FAR),
        shared=np.zeros_like(linear.shared),
        own=np.zeros_like(linear.own),
    )
