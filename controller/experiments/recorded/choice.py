"""Judges friction models by how well each predicts motion that it was not fitted to."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.experiments.identify.motion import Motion, Pieces, taken
from haptic_wall.controller.experiments.recorded.friction import MODELS
from haptic_wall.controller.experiments.recorded.record import pieces_of
from haptic_wall.controller.experiments.recorded.shooting import (
    Shot,
    beginnings,
    first_terms,
    fit,
    model_of,
)
from haptic_wall.controller.theory.checks import FloatArray

PIECE_S = 1.0
"""Length of the pieces that are predicted [s]"""
BEGINNING_S = 0.2
"""Length of the beginning that tells where a predicted piece begins [s]"""
BETTER = 0.9
"""Largest fraction of a simpler model's error of prediction that a richer one must leave"""
_FOLDS = 4
_LEAST_PIECES = 4
"""Fewer cannot tell which model predicts better"""
_ROUNDS = 10


@dataclass(frozen=True, slots=True)
class Judged:
    """A friction model, and how well it does."""

    name: str
    fitted: float
    """Residual of its fit [rad rms]"""
    predicted: float | None
    """Prediction error on data that it was not fitted to [rad rms]; None: too little data"""
    chosen: bool = False


def judged(
    stretches: tuple[Motion, ...],
    first: Shot,
    names: tuple[str, ...],
) -> tuple[tuple[Judged, ...], dict[str, float]]:
    """Fit each model to pieces of a record, predict those left out, and choose.

    The simplest model is kept until a richer one predicts better by a tenth.

    Args:
        stretches: Stretches of the record.
        first: The fit with Coulomb and viscous friction.
        names: Names of the models, the simplest first.

    Returns:
        The models, one of them chosen, and the parameters of that one.
    """
    if len(names) == 1:
        return (Judged(names[0], first.rms, None, chosen=True),), first.terms
    pieces, _ = pieces_of(stretches, PIECE_S, PIECE_S)
    count = len(pieces.sampled)
    folds = np.arange(count) * min(_FOLDS, count) // count
    begun = first_terms(stretches, weight="sine" in first.terms)
    found: list[tuple[Judged, dict[str, float]]] = []
    best = 0
    for name in names:
        # The best fit of a simpler model may lie in another valley than that of a richer one.
        starts = [{**first.terms, **found[-1][1]}, begun] if found else [first.terms]
        if len(found) > 1:
            starts.append(found[0][1])
        shots = [fit(pieces, start_with(name, each), rounds=_ROUNDS) for each in starts]
        shot = min(shots, key=lambda each: each.rms)
        error = None
        if count >= _LEAST_PIECES:
            error = _cross(pieces, folds, shot)
        found.append((Judged(name, shot.rms, error), shot.terms))
        before = found[best][0].predicted
        if error is not None and before is not None and error < BETTER * before:
            best = len(found) - 1
    chosen = tuple(
        Judged(each.name, each.fitted, each.predicted, at == best)
        for at, (each, _) in enumerate(found)
    )
    return chosen, found[best][1]


def start_with(name: str, terms: Mapping[str, float]) -> dict[str, float]:
    """Return the start of a fit with the friction model ``name``.

    Args:
        name: Name of the model.
        terms: Parameters per inertia of a fit with a simpler model.
    """
    others = {term.name for model in MODELS.values() for term in model}
    start = {key: value for key, value in terms.items() if key not in others}
    for term in MODELS[name]:
        begin = term.start * terms["coulomb"] if term.unit == "N·m" else term.start
        start[term.name] = terms.get(term.name, begin)
    return start


def predicted(pieces: Pieces, names: tuple[str, ...], values: FloatArray) -> FloatArray:
    """Return the positions [rad] as predicted from the first 0.2 s of each piece.

    Args:
        pieces: The record; shape (pieces, rows) is that of the result.
        names: Names of the parameters.
        values: Values of the parameters, per inertia; shape (names,).
    """
    near = pieces.held & (pieces.sampled - pieces.sampled[:, :1] <= BEGINNING_S)
    rows = max(8, int(near.sum(axis=1).max()))
    first = replace(
        pieces,
        sampled=pieces.sampled[:, :rows],
        position=pieces.position[:, :rows],
        held=near[:, :rows],
    )
    terms = dict(zip(names, values.tolist(), strict=True))
    own = model_of(first, terms).own(beginnings(first), rounds=10)
    model = model_of(pieces, terms)
    found: FloatArray = pieces.position + model.left(model.begin[None], own[:, None])[0]
    return found


def error_of(pieces: Pieces, at: FloatArray) -> float:
    """Return the root mean square of the difference to the record [rad]."""
    left = np.where(pieces.held, at - pieces.position, 0.0)
    return math.sqrt(float(np.sum(left**2)) / np.count_nonzero(pieces.held))


def _cross(pieces: Pieces, folds: NDArray[np.intp], shot: Shot) -> float:
    """Return the root mean square error of predicting each fold from the others [rad]."""
    squares = 0.0
    for fold in np.unique(folds):
        rest, out = folds != fold, folds == fold
        fitted = fit(taken(pieces, rest), shot.terms, shot.own[:, rest], rounds=6)
        test = taken(pieces, out)
        ahead = predicted(test, fitted.names, fitted.values)
        squares += error_of(test, ahead) ** 2 * np.count_nonzero(test.held)
    return math.sqrt(squares / np.count_nonzero(pieces.held))
