"""Minimises the squared difference between measured and simulated positions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from haptic_wall.controller.experiments.identify.loads import Loads
from haptic_wall.controller.experiments.identify.motion_model import Parameters, Pieces, simulated
from haptic_wall.controller.experiments.identify.standard_errors import Linear
from haptic_wall.controller.theory.checks import FloatArray

_RUN = 8
"""A run of this many equal samples counts in full; a longer one counts no more"""
_STATIC_STEP = 0.02
"""Relative step of the friction at rest for its derivative"""
_ROUNDS, _FEW_ROUNDS = 40, 8
_EXACT = 1e-7
"""Residual below the resolution of any encoder [rad]"""
_ENOUGH, _ENOUGH_LOADED, _NEARLY = 1e-7, 1e-5, 1e-3
"""Relative improvement of the squares below which the iteration ends"""


class OutputError:
    """Computes residuals, and derivatives by the shared values and each piece's initial speed.

    Args:
        pieces: The recorded motion.
        values: Initial inertia, damping, Coulomb friction, delay and, if fitted, backlash.
        loads: Fitted too, starting from these; None: there are none.

    Attributes:
        begin: Those values, the friction at rest, its fading, the weights of the loads.
        low: The least of each.
        loaded: There are loads.
    """

    def __init__(self, pieces: Pieces, values: FloatArray, loads: Loads | None = None) -> None:
        self.pieces = pieces
        self.loaded = loads is not None
        self._count = count = values.size
        self.begin = values
        inertia, coulomb = float(values[0]), float(values[2])
        self.low = np.array([0.05 * inertia, 0.0, 0.0, -0.005, 0.0])[:count]
        self._weights = weights_of(pieces)
        self._means = self._weights / self._weights.sum(axis=1, keepdims=True)
        # Small compared with the values, large compared with rounding.
        steps = [1e-5 * inertia, 1e-4 * inertia, 1e-4 * inertia, 1e-7, 1e-5][:count]
        self._waves: FloatArray | None = None
        if loads is not None:
            self.begin = np.array([*values, loads.static, loads.fading, *loads.weights])
            self.low = np.array([*self.low, 0.0, 0.0, *[-np.inf] * len(loads.weights)])
            # Friction at rest decides where the shaft stops: only a larger step has an effect.
            steps += [max(_STATIC_STEP * coulomb, 1e-3 * inertia), 0.01 * loads.fading or 1e-12]
            steps += [1e-4 * inertia] * len(loads.weights)
            self.low[count + 1] = 0.2 * loads.fading
            between = 0.5 * (pieces.position[:, 1:] + pieces.position[:, :-1])
            self._waves = loads.waves(between)
        self._steps = np.array([*steps, 1e-5])

    def linear(self, values: FloatArray, speeds: FloatArray) -> Linear:
        """Return residuals and derivatives, from variants with one value increased each."""
        count = values.size
        variants = np.tile(values, (count + 2, 1))
        variants[1 : count + 1] += np.diag(self._steps[:-1])
        starts = np.tile(speeds, (count + 2, 1))
        starts[-1] += self._steps[-1]
        shown = self._left(variants, starts)
        slopes = (shown[1:] - shown[0]) / self._steps[:, None, None]
        return Linear(shown[0], slopes[:-1], slopes[-1], self._weights)

    def costs(self, variants: FloatArray, speeds: FloatArray) -> FloatArray:
        """Return the weighted squares of each variant of the values, shape (v, values)."""
        shown = self._left(variants, np.tile(speeds, (variants.shape[0], 1)))
        squares: FloatArray = np.sum(self._weights * shown**2, axis=(1, 2))
        return squares

    def _left(self, variants: FloatArray, starts: FloatArray) -> FloatArray:
        """Return fitted minus measured for each variant of the values, shape (v, s, n)."""
        five = np.pad(variants[:, : self._count], ((0, 0), (0, 5 - self._count)))
        parameters = Parameters(*(five[:, n : n + 1] for n in range(5)))
        if self._waves is not None:
            static, fading, weights = np.split(variants[:, self._count :], [1, 2], axis=1)
            load = np.tensordot(weights, self._waves, axes=1)
            parameters = replace(parameters, static=static, fading=fading, load=load)
        shown = simulated(self.pieces, parameters, starts) - self.pieces.position
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
    for _ in range(rounds):
        if now.cost < _EXACT**2 * now.left.size:
            break
        weighted = now.weights * now.left
        gradient = np.sum(now.shared * weighted, axis=(1, 2))
        free = (values > model.low) | (gradient < 0.0)
        rest = now.without_own()[free]
        normal = np.einsum("psn,qsn->pq", rest * now.weights, rest)
        right = np.sum(rest * weighted, axis=(1, 2))
        normal[np.diag_indices_from(normal)] *= 1.0 + damped
        step = np.zeros(values.shape)
        step[free] = -np.linalg.lstsq(normal, right, rcond=1e-12)[0]
        step = np.maximum(values + step, model.low) - values
        moved = now.left + np.tensordot(step, now.shared, axes=1)
        pull = np.sum(now.weights * now.own * moved, axis=1)
        after = speeds - pull / (now.own_square() * (1.0 + damped))
        tried = model.linear(values + step, after)
        gain = now.cost - tried.cost
        if gain > 0.0:
            values, speeds, now, damped = values + step, after, tried, 0.1 * damped
            if gain < enough * now.cost:
                break
        elif damped > 1e3 or abs(gain) < enough * now.cost:
            break
        else:
            damped *= 10.0
    return values, speeds
