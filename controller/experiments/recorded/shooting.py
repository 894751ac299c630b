"""Fits the model to pieces of a record, each with its initial state (multiple shooting).

The parameters are per inertia: friction, load and torque gain over the inertia of all that turns,
since a motion tells no more.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from haptic_wall.controller.experiments.identify.fit import Fit
from haptic_wall.controller.experiments.identify.motion import Motion, Pieces
from haptic_wall.controller.experiments.identify.output_error import OutputError, Sizes
from haptic_wall.controller.experiments.identify.start import start_of
from haptic_wall.controller.experiments.recorded.friction import GAUSSIAN, TERMS
from haptic_wall.controller.theory.checks import FloatArray

_ROUNDS = 40
_SMOOTHED_S, _DELAYS_S = 0.07, (0.0, 0.002, 0.005, 0.01, 0.02, 0.04)
"""For the first start: window of the smoothing, and delays of the torque [s]"""
_BEGINNING_S = 0.05
"""Length of that through which the parabola is laid [s]"""
_CORRELATED_S = 0.25
"""Correlation time of the errors of a swing [s]: what a friction model lacks lasts for a part of it
"""
_STEP = 1e-4
"""Of a parameter, relative, for its derivative"""


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
) -> Fit:
    """Fit the parameters, and the beginnings of the pieces.

    Args:
        pieces: The record.
        start: The parameters that are fitted, per inertia, where the fit begins.
        own: Positions and speeds at the beginnings, where the fit begins; None: estimated.
        rounds: Largest number of rounds.
    """
    own = beginnings(pieces) if own is None else own
    return model_of(pieces, start).fitted(own, rounds=rounds, correlated_s=_CORRELATED_S)
