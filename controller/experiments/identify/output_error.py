"""Minimises the squared difference between measured and simulated positions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from haptic_wall.controller.experiments.identify.motion_model import Pieces, simulated
from haptic_wall.controller.experiments.identify.separable import Linear, fit_pieces
from haptic_wall.controller.experiments.identify.standard_errors import CORRELATED
from haptic_wall.controller.theory.checks import FloatArray

_RUN = 8
"""A run of this many equal samples counts in full; a longer one counts no more"""
_ROUNDS, _FEW_ROUNDS = 40, 8
_ENOUGH, _ENOUGH_LOADED, _NEARLY = 1e-7, 1e-4, 1e-3
"""Relative improvement of the squares below which the iteration ends"""
_PER_INERTIA = 1e-4
"""Step of a torque's value for its derivative, over the inertia: small compared with the values,
large compared with rounding"""
_STEPS = {"delay": 1e-7, "backlash": 1e-5, "fading": 1e-3, "gear": 1e-4, "periods": 1e-3}
_STEPS["gear_rest"] = _STEPS["gear"]
_LOW = {
    "damping": 0.0,
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


class OutputError:
    """Computes residuals, and derivatives by the shared values and each piece's initial speed.

    Args:
        pieces: The recorded motion.
        values: Initial values by name: those of ``Fit`` and ``Effects``.
        names: Of those that are fitted; the others stay.
        priors: Priors of values, by name.
        noise: Residual of a fit that leaves nothing but rounding [rad]: the weight of the priors.

    Attributes:
        begin: Initial values of those that are fitted.
        low: The least of each.
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
    ) -> None:
        self.pieces = pieces
        self.names = tuple(names)
        self._loaded = any(name in names for name in ("gear", "excess", "sine"))
        self._values = dict(values)
        inertia = values["inertia"]
        low = {**_LOW, "inertia": 0.05 * inertia}
        self.low = np.array([low.get(name, -np.inf) for name in names])
        self.begin = np.maximum([values[name] for name in names], self.low)
        steps = {**_STEPS, "inertia": 0.1 * _PER_INERTIA * inertia}
        usual = _PER_INERTIA * inertia
        self._steps = np.array([*(steps.get(name, usual) for name in names), 1e-5])
        known = priors or {}
        each = [known.get(name, NO_PRIOR) for name in names]
        self.mean = np.array([prior.mean for prior in each])
        self.precision = np.array([prior.precision(noise) for prior in each])
        self._weights = weights_of(pieces)
        self._means = self._weights / self._weights.sum(axis=1, keepdims=True)

    def fitted(self, speeds: FloatArray, *, thorough: bool = True) -> tuple[FloatArray, FloatArray]:
        """Return values and initial speeds with the least weighted squares.

        Args:
            speeds: Initial guess of each piece's initial speed [rad/s], shape (s,).
            thorough: Iterate to convergence; else until an iteration brings little.
        """
        rounds, enough = (_ROUNDS, _ENOUGH) if thorough else (_FEW_ROUNDS, _NEARLY)
        if self._loaded:
            enough = max(enough, _ENOUGH_LOADED)
        values, own = fit_pieces(
            lambda values, own: self.linear(values, own[0]),
            self.begin,
            speeds[None],
            bounds=(self.low, np.full(self.low.shape, np.inf)),
            mean=self.mean,
            rounds=rounds,
            enough=enough,
        )
        return values, own[0]

    def linear(self, values: FloatArray, speeds: FloatArray) -> Linear:
        """Return residuals and derivatives, from variants with one value increased each."""
        count = values.size
        variants = np.tile(values, (count + 2, 1))
        variants[1 : count + 1] += np.diag(self._steps[:-1])
        starts = np.tile(speeds, (count + 2, 1))
        starts[-1] += self._steps[-1]
        shown = self.left(variants, starts)
        slopes = (shown[1:] - shown[0]) / self._steps[:, None, None]
        return Linear(shown[0], slopes[:-1], slopes[-1:], self._weights, self.precision)

    def costs(self, name: str, tried: FloatArray, speeds: FloatArray) -> FloatArray:
        """Return the weighted squares for each value of one that is not fitted, shape (v,)."""
        variants = np.tile(self.begin, (tried.size, 1))
        starts = np.tile(speeds, (tried.size, 1))
        shown = self.left(variants, starts, {name: tried[:, None]})
        squares: FloatArray = np.sum(self._weights * shown**2, axis=(1, 2))
        return squares

    def left(
        self,
        variants: FloatArray,
        starts: FloatArray,
        other: Mapping[str, FloatArray] | None = None,
    ) -> FloatArray:
        """Return fitted minus measured for each variant of the values, shape (v, s, n)."""
        columns: dict[str, FloatArray] = {
            name: np.full((variants.shape[0], 1), value) for name, value in self._values.items()
        }
        columns.update(
            {name: variants[:, n : n + 1] for n, name in enumerate(self.names)}, **(other or {})
        )
        with np.errstate(over="ignore", invalid="ignore"):  # a step too far is not taken
            shown = simulated(self.pieces, columns, starts)
        shown -= self.pieces.position
        shown -= np.sum(shown * self._means, axis=2, keepdims=True)
        return shown


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
