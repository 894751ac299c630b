"""Minimises the squared difference between measured and simulated positions.

Each piece's own values are eliminated from the residuals, and scipy fits the shared values to the
rest (variable projection).

Source: G. H. Golub, V. Pereyra, SIAM J. Numer. Anal. 10(2), 1973; L. Kaufman, BIT 15(1), 1975.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from haptic_wall.controller.experiments.identify.fit import Fit
from haptic_wall.controller.experiments.identify.motion import Pieces
from haptic_wall.controller.experiments.identify.motion_model import simulated
from haptic_wall.controller.experiments.identify.separable import CORRELATED, CORRELATED_S, Linear
from haptic_wall.controller.theory.checks import FloatArray

_RUN = 8
"""A run of this many equal samples counts in full; a longer one counts no more"""
_ROUNDS, _FEW_ROUNDS = 40, 8
_ENOUGH, _ENOUGH_LOADED, _NEARLY, _ENOUGH_SWUNG = 1e-7, 1e-4, 1e-3, 1e-6
"""Relative improvement of the squares below which the iteration ends"""
_FAR = 1e3
"""Stands for the residuals of values with which no motion is finite [rad]"""
_POSITION, _SPEED = 1e-5, 1e-5
"""Steps of a piece's own values for derivatives [rad], [rad/s]"""
_PER_INERTIA = 1e-4
"""Step of a torque's value for its derivative, over the inertia: small compared with the values,
large compared with rounding"""
_STEPS = {"delay": 1e-7, "backlash": 1e-5, "fading": 1e-3, "gear": 1e-4, "periods": 1e-3}
_LOW = {
    "coulomb": 0.0,
    "delay": -0.005,
    "backlash": 0.0,
    "fading": 0.02,
    "dead_band": 0.0,
    "excess": 0.0,
    "drag": 0.0,
    "periods": 1.0,
}


class Prior(NamedTuple):
    """Prior knowledge of a value: mean and standard deviation."""

    mean: float
    deviation: float

    def precision(self, noise: float) -> float:
        """Return its weight beside squares whose root mean is ``noise``."""
        return CORRELATED * (noise / self.deviation) ** 2


NO_PRIOR = Prior(0.0, np.inf)
"""No prior knowledge"""


class Sizes(NamedTuple):
    """Limits of each fitted value, and its step for derivatives, shape (p,)."""

    low: FloatArray
    high: FloatArray
    step: FloatArray


class OutputError:
    """Computes residuals, and derivatives by the shared values and each piece's own ones.

    A piece's own values are its initial position and speed. The position only shifts a piece, and
    is eliminated by its mean, except where the piece swings in a weight that is simulated too.

    Args:
        pieces: The recorded motion.
        values: Initial values by name, as those of a ``Fit``.
        names: Of those that are fitted; the others stay.
        priors: Priors of values, by name.
        noise: Residual of a fit that leaves nothing but rounding [rad]: the weight of the priors.
        sizes: Limits and steps of the fitted values, of pieces that swing; None: they do not, and
            limits and steps follow from the inertia.

    Attributes:
        begin: Initial values of those that are fitted.
        low: The least of each.
        high: The largest of each.
        precision: Weight of the prior of each [rad² per unit²]; 0: none.
        mean: Of the prior of each.
    """

    def __init__(
        self,
        pieces: Pieces,
        values: Mapping[str, float],
        names: Sequence[str],
        priors: Mapping[str, Prior] | None = None,
        noise: float = 0.0,
        sizes: Sizes | None = None,
    ) -> None:
        self.pieces = pieces
        self._swings = sizes is not None
        self.names = tuple(names)
        self._loaded = any(name in names for name in ("gear", "excess", "sine"))
        self._values = dict(values)
        self.low, self.high, steps = sizes or _sizes(values["inertia"], names)
        self.begin = np.clip([values[name] for name in names], self.low, self.high)
        own = (_POSITION, _SPEED) if self._swings else (_SPEED,)
        self._steps = np.array([*steps, *own])
        known = priors or {}
        each = [known.get(name, NO_PRIOR) for name in names]
        self.mean = np.array([prior.mean for prior in each])
        self.precision = np.array([prior.precision(noise) for prior in each])
        # Rows of a record are thinned, so that equal ones are few.
        self._weights = pieces.held.astype(float) if self._swings else weights_of(pieces)
        self._means = self._weights / self._weights.sum(axis=1, keepdims=True)

    def fitted(
        self,
        own: FloatArray,
        *,
        thorough: bool = True,
        rounds: int | None = None,
        correlated_s: float = CORRELATED_S,
    ) -> Fit:
        """Return the fit with the least weighted squares.

        Args:
            own: Initial guess of each piece's speed [rad/s], shape (1, s); of pieces that swing,
                of position [rad] and speed, shape (2, s).
            thorough: Iterate to convergence; else until an iteration brings little.
            rounds: Largest number of tried values; None: by ``thorough``.
            correlated_s: Correlation time of the residuals [s].
        """
        usual, enough = (_ROUNDS, _ENOUGH) if thorough else (_FEW_ROUNDS, _NEARLY)
        if self._loaded:
            enough = max(enough, _ENOUGH_LOADED)
        at: tuple[FloatArray, FloatArray, Linear | None] = (self.begin, own, None)
        tried = at

        def left(values: FloatArray) -> FloatArray:
            nonlocal tried
            base, near, now = at
            if now is not None:
                moved = now.left + np.tensordot(values - base, now.shared, axes=1)
                near = near - now.own_part(moved[None])[0]
            found = _finite(self.linear(values, near))
            tried = (values.copy(), near, found)
            known = np.sqrt(found.precision) * (values - self.mean)
            return np.concatenate([(np.sqrt(found.weights) * found.left).ravel(), known])

        def slopes(values: FloatArray) -> FloatArray:
            nonlocal at
            _, near, now = tried  # scipy asks for the slopes where it tried last, if better
            assert now is not None
            at = (values.copy(), near, now)
            rest = np.sqrt(now.weights) * now.without_own(now.shared)
            known = np.diag(np.sqrt(now.precision))
            return np.concatenate([rest.reshape(len(values), -1).T, known])

        least_squares(
            left, self.begin, slopes, bounds=(self.low, self.high), method="dogbox",
            x_scale="jac", ftol=_ENOUGH_SWUNG if self._swings else enough, xtol=1e-12, gtol=None,
            max_nfev=rounds or usual,
        )  # fmt: skip
        values, own, now = at
        if now is not None:  # they are those before the last step
            best = own - now.own_part(now.left[None])[0]
            own = best if self.linear(values, best).cost < now.cost else own
        every = {**self._values, **dict(zip(self.names, values.tolist(), strict=True))}
        linear = self.linear(values, own)
        return Fit(every, self.names, self.pieces, own, linear, correlated_s)

    def linear(self, values: FloatArray, own: FloatArray) -> Linear:
        """Return residuals and derivatives, from variants with one value changed each."""
        count, each = values.size, own.shape[0]
        steps = self._steps.copy()
        steps[:count] *= np.where(values + steps[:count] > self.high, -1.0, 1.0)
        variants = np.tile(values, (count + each + 1, 1))
        variants[1 : count + 1] += np.diag(steps[:count])
        owned = np.tile(own[:, None], (1, count + each + 1, 1))
        for n in range(each):
            owned[n, count + 1 + n] += steps[count + n]
        shown = self.left(variants, owned)
        slopes = (shown[1:] - shown[0]) / steps[:, None, None]
        return Linear(shown[0], slopes[:count], slopes[count:], self._weights, self.precision)

    def costs(self, name: str, tried: FloatArray, own: FloatArray) -> FloatArray:
        """Return the weighted squares for each value of one that is not fitted, shape (v,)."""
        variants = np.tile(self.begin, (tried.size, 1))
        owned = np.tile(own[:, None], (1, tried.size, 1))
        shown = self.left(variants, owned, {name: tried[:, None]})
        squares: FloatArray = np.sum(self._weights * shown**2, axis=(1, 2))
        return squares

    def left(
        self,
        variants: FloatArray,
        own: FloatArray,
        other: Mapping[str, FloatArray] | None = None,
    ) -> FloatArray:
        """Return fitted minus measured for each variant of the values, shape (v, s, n).

        Args:
            variants: Of the fitted values, shape (v, p).
            own: Of the own values, shape (q, v, s).
            other: Of values that are not fitted, by name.
        """
        columns: dict[str, FloatArray] = {
            name: np.full((variants.shape[0], 1), value) for name, value in self._values.items()
        }
        columns.update(
            {name: variants[:, n : n + 1] for n, name in enumerate(self.names)}, **(other or {})
        )
        with np.errstate(over="ignore", invalid="ignore"):  # a step too far is not taken
            shown = simulated(self.pieces, columns, own[-1], own[0] if self._swings else None)
        shown -= self.pieces.position
        if self._swings:
            return shown
        shown -= np.sum(shown * self._means, axis=2, keepdims=True)
        return shown


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


def _sizes(inertia: float, names: Sequence[str]) -> Sizes:
    """Return limits and steps of values of a servo with this inertia."""
    low = {**_LOW, "inertia": 0.05 * inertia}
    usual = _PER_INERTIA * inertia
    steps = {**_STEPS, "inertia": 0.1 * usual}
    return Sizes(
        np.array([low.get(name, -np.inf) for name in names]),
        np.full(len(names), np.inf),
        np.array([steps.get(name, usual) for name in names]),
    )


def weights_of(pieces: Pieces) -> FloatArray:
    """Weight each sample: one in a long run of equal samples adds little information.

    The rounding of a shaft at rest is one error, however often it is read.
    """
    weights = pieces.held.astype(float)
    for position, weight, held in zip(pieces.position, weights, pieces.held, strict=True):
        changes = np.flatnonzero(np.diff(position[held])) + 1
        edges = np.concatenate([[0], changes, [int(held.sum())]])
        runs = np.diff(edges)
        weight[held] = np.repeat(np.minimum(1.0, _RUN / runs), runs)
    return weights
