"""Fits the model to pieces of a record, each with its initial state (multiple shooting).

The parameters are per inertia: friction, load and torque gain over the inertia of all that turns,
since a motion tells no more.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from haptic_wall.controller.experiments.identify.motion import Motion, Pieces
from haptic_wall.controller.experiments.identify.output_error import OutputError, Sizes
from haptic_wall.controller.experiments.identify.separable import Linear
from haptic_wall.controller.experiments.identify.start import start_of
from haptic_wall.controller.experiments.recorded.friction import GAUSSIAN, TERMS
from haptic_wall.controller.theory.checks import FloatArray

_ROUNDS = 40
_SMOOTHED_S, _DELAYS_S = 0.07, (0.0, 0.002, 0.005, 0.01, 0.02, 0.04)
"""For the first start: window of the smoothing, and delays of the torque [s]"""
_BEGINNING_S = 0.05
"""Length of that through which the parabola is laid [s]"""
_STEP = 1e-4
"""Of a parameter, relative, for its derivative"""


@dataclass(frozen=True, slots=True)
class Shot:
    """A fit of the pieces."""

    names: tuple[str, ...]
    values: FloatArray
    """Values of the parameters, per inertia; shape (names,)"""
    own: FloatArray
    """Position [rad] and speed [rad/s] at the first row of each piece, shape (2, pieces)"""
    linear: Linear
    """Residuals and derivatives there"""
    pieces: Pieces

    @property
    def terms(self) -> dict[str, float]:
        """Return the parameters by name."""
        return dict(zip(self.names, self.values.tolist(), strict=True))

    @property
    def fitted(self) -> FloatArray:
        """Return the fitted positions [rad], shape (pieces, rows)."""
        return self.pieces.position + self.linear.left

    @property
    def rms(self) -> float:
        """Return the root mean square of the residuals [rad]."""
        held = self.pieces.held
        return math.sqrt(float(np.sum(self.linear.left[held] ** 2)) / np.count_nonzero(held))


def model_of(pieces: Pieces, terms: Mapping[str, float]) -> OutputError:
    """Return the residuals of the pieces by these parameters, per inertia."""
    names = tuple(terms)
    low, high = (np.array([getattr(TERMS[n], end) for n in names]) for end in ("least", "most"))
    sizes = [max(abs(value), TERMS[name].size) for name, value in terms.items()]
    values = {"inertia": 1.0, "exponent": GAUSSIAN, **terms}
    return OutputError(pieces, values, names, sizes=Sizes(low, high, _STEP * np.array(sizes)))


def first_terms(stretches: tuple[Motion, ...], *, weight: bool) -> dict[str, float]:
    """Return the parameters, per inertia, where the first fit begins.

    Args:
        stretches: Stretches of a record, at least one.
        weight: A load that depends on the angle is looked for.
    """
    terms = start_of(stretches, _DELAYS_S, _SMOOTHED_S, weight=weight)
    least = {"damping": 0.02, "coulomb": 0.05, "delay": 5e-4}
    return {name: max(value, least.get(name, -np.inf)) for name, value in terms.items()}


def beginnings(pieces: Pieces) -> FloatArray:
    """Estimate position and speed at the first row of each piece, by a parabola."""
    own = np.empty((2, len(pieces.sampled)))
    for at, (time, position, held) in enumerate(
        zip(pieces.sampled, pieces.position, pieces.held, strict=True)
    ):
        since = time[held] - time[0]
        near = slice(0, max(6, int(np.searchsorted(since, _BEGINNING_S))))
        parts = np.polynomial.polynomial.polyfit(since[near], position[held][near], 2)
        own[:, at] = parts[:2]
    return own


def fit(
    pieces: Pieces,
    start: Mapping[str, float],
    own: FloatArray | None = None,
    rounds: int = _ROUNDS,
) -> Shot:
    """Fit the parameters, and the beginnings of the pieces.

    Args:
        pieces: The record.
        start: The parameters that are fitted, per inertia, where the fit begins.
        own: Positions and speeds at the beginnings, where the fit begins; None: estimated.
        rounds: Largest number of rounds.
    """
    model = model_of(pieces, start)
    values, own = model.fitted(beginnings(pieces) if own is None else own, rounds=rounds)
    return Shot(model.names, values, own, model.linear(values, own), pieces)
