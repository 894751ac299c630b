"""Minimises the squared difference between measured and simulated positions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from haptic_wall.controller.experiments.identify.motion_model import Parameters, Pieces, simulated
from haptic_wall.controller.experiments.identify.standard_errors import CORRELATED, Linear
from haptic_wall.controller.theory.checks import FloatArray

_RUN = 8
"""A run of this many equal samples counts in full; a longer one counts no more"""
_ROUNDS, _FEW_ROUNDS = 40, 8
_EXACT = 1e-7
"""Residual below the resolution of any encoder [rad]"""
_ENOUGH, _ENOUGH_LOADED, _NEARLY = 1e-7, 1e-4, 1e-3
"""Relative improvement of the squares below which the iteration ends"""
_PER_INERTIA = 1e-4
"""Step of a torque's value for its derivative, over the inertia: small compared with the values,
large compared with rounding"""
_STEPS = {"delay": 1e-7, "backlash": 1e-5, "fading": 1e-3, "gear": 1e-4, "periods": 1e-3}
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
        center: Position at which the cogging's angle is zero [rad].
        priors: Priors of values, by name.
        noise: Residual of a fit that leaves nothing but rounding [rad]: the weight of the priors.

    Attributes:
        begin: Initial values of those that are fitted.
        low: The least of each.
        loaded: Effects are fitted too.
        precision: Weight of the prior of each [rad² per unit²]; 0: none.
        mean: Of the prior of each.
    """

    def __init__(
        self,
        pieces: Pieces,
        values: Mapping[str, float],
        names: Sequence[str],
        center: float = 0.0,
        priors: Mapping[str, Prior] | None = None,
        noise: float = 0.0,
    ) -> None:
        self.pieces = pieces
        self.names = tuple(names)
        self.loaded = any(name in names for name in ("gear", "excess", "sine"))
        self._values = dict(values)
        self._center = center
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
        self._between = 0.5 * (pieces.position[:, 1:] + pieces.position[:, :-1])
        self._waves = np.sin(self._between), np.cos(self._between)

    def linear(self, values: FloatArray, speeds: FloatArray) -> Linear:
        """Return residuals and derivatives, from variants with one value increased each."""
        count = values.size
        variants = np.tile(values, (count + 2, 1))
        variants[1 : count + 1] += np.diag(self._steps[:-1])
        starts = np.tile(speeds, (count + 2, 1))
        starts[-1] += self._steps[-1]
        shown = self.left(variants, starts)
        slopes = (shown[1:] - shown[0]) / self._steps[:, None, None]
        return Linear(shown[0], slopes[:-1], slopes[-1], self._weights, self.precision)

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
            shown = simulated(self.pieces, self._parameters(columns), starts)
        shown -= self.pieces.position
        shown -= np.sum(shown * self._means, axis=2, keepdims=True)
        return shown

    def _parameters(self, values: Mapping[str, FloatArray]) -> Parameters:
        def used(name: str) -> FloatArray | None:
            return values[name] if np.any(values[name]) or name in self.names else None

        coulomb = values["coulomb"]
        slow = coulomb + values["excess"]
        weight = load = None
        if "sine" in self.names or np.any(values["sine"]) or np.any(values["cosine"]):
            sine, cosine = self._waves
            load = weight = (
                values["sine"][:, :, None] * sine + values["cosine"][:, :, None] * cosine
            )
        if "periods" in self.names or np.any(values["cogging_sine"]):
            angle = values["periods"][:, :, None] * (self._between - self._center)
            cogging = values["cogging_sine"][:, :, None] * np.sin(angle)
            cogging += values["cogging_cosine"][:, :, None] * np.cos(angle)
            load = cogging if load is None else load + cogging
        return Parameters(
            values["inertia"],
            values["damping"],
            coulomb,
            values["delay"],
            values["backlash"],
            slow=None if used("excess") is None else slow,
            fading=used("fading"),
            static=np.maximum(values["static"], slow),
            load=load,
            weight=weight,
            gear=used("gear"),
            uneven=used("uneven"),
            drag=used("drag"),
            dead_band=used("dead_band"),
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


def least_squares(
    model: OutputError, speeds: FloatArray, thorough: bool = True
) -> tuple[FloatArray, FloatArray]:
    """Return values and speeds with the least weighted squares; Levenberg's method, with bounds.

    A piece's initial speed affects that piece alone, so it is eliminated piece by piece.

    Args:
        model: The model.
        speeds: Initial guess of each piece's initial speed [rad/s], shape (s,).
        thorough: Iterate to convergence; else until an iteration brings little.
    """
    rounds, enough = (_ROUNDS, _ENOUGH) if thorough else (_FEW_ROUNDS, _NEARLY)
    if model.loaded:
        enough = max(enough, _ENOUGH_LOADED)
    values, damped = model.begin, 1e-3
    now = model.linear(values, speeds)
    cost = now.cost + _of_priors(model, values)
    for _ in range(rounds):
        if now.cost < _EXACT**2 * now.left.size:
            break
        weighted = now.weights * now.left
        away = model.precision * (values - model.mean)
        gradient = np.sum(now.shared * weighted, axis=(1, 2)) + away
        free = (values > model.low) | (gradient < 0.0)
        rest = now.without_own()[free]
        normal = np.einsum("psn,qsn->pq", rest * now.weights, rest)
        normal[np.diag_indices_from(normal)] += model.precision[free]
        right = np.sum(rest * weighted, axis=(1, 2)) + away[free]
        normal[np.diag_indices_from(normal)] *= 1.0 + damped
        scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
        step = np.zeros(values.shape)
        step[free] = (
            -np.linalg.lstsq(normal / np.outer(scale, scale), right / scale, rcond=1e-12)[0] / scale
        )
        step = np.maximum(values + step, model.low) - values
        moved = now.left + np.tensordot(step, now.shared, axes=1)
        pull = np.sum(now.weights * now.own * moved, axis=1)
        after = speeds - pull / (now.own_square() * (1.0 + damped))
        tried = model.linear(values + step, after)
        its_cost = tried.cost + _of_priors(model, values + step)
        gain = cost - its_cost
        if gain > 0.0:
            values, speeds, now, damped = values + step, after, tried, 0.1 * damped
            cost = its_cost
            if gain < enough * cost:
                break
        elif damped > 1e3 or abs(gain) < enough * cost:
            break
        else:
            damped *= 10.0
    return values, speeds


def _of_priors(model: OutputError, values: FloatArray) -> float:
    return float(np.sum(model.precision * (values - model.mean) ** 2))
