"""Fits the model to pieces of a record, each with its initial state (multiple shooting).

The simplest friction model is chosen, unless a richer one leaves less.

The parameters are per inertia: friction, load and torque gain over the inertia of all that turns,
since a motion tells no more.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from haptic_wall.controller.experiments.identify.fit import Fit
from haptic_wall.controller.experiments.identify.motion import Motion, Pieces
from haptic_wall.controller.experiments.identify.output_error import OutputError, Sizes
from haptic_wall.controller.experiments.identify.start import start_of
from haptic_wall.controller.experiments.recorded.friction import GAUSSIAN, MODELS, TERMS
from haptic_wall.controller.theory.checks import FloatArray

PIECE_S = 1.0
"""Length of the pieces to which models are fitted [s]"""
BETTER = 0.75
"""Largest fraction of a simpler model's residual that a richer one must leave: two swings of one
real servo differ by more than a smaller gain"""
_ROUNDS, _JUDGED_ROUNDS = 40, 10
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


def judged(pieces: Pieces, first: Fit, begun: Mapping[str, float]) -> tuple[str, dict[str, Fit]]:
    """Fit each model to the pieces of a record; return the chosen one's name, and all fits.

    Args:
        pieces: The record in pieces of ``PIECE_S``.
        first: Their fit with Coulomb and viscous friction.
        begun: Start of that fit.
    """
    chosen, shots, last = "M1", {"M1": first}, first
    for name in list(MODELS)[1:]:
        # The best fit of a simpler model may lie in another valley than that of a richer one.
        starts: Sequence[Mapping[str, float]] = (first.terms, begun, last.terms)
        tried = [fit(pieces, start_with(name, each), rounds=_JUDGED_ROUNDS) for each in starts]
        last = shots[name] = min(tried, key=lambda each: each.residual)
        if last.residual < BETTER * shots[chosen].residual:
            chosen = name
    return chosen, shots


def start_with(name: str, terms: Mapping[str, float]) -> dict[str, float]:
    """Return the start of a fit with the friction model ``name``.

    Args:
        name: Name of the model.
        terms: Parameters per inertia of a fit with a simpler model.
    """
    others = {each for model in MODELS.values() for each in model}
    start = {key: value for key, value in terms.items() if key not in others}
    for each in MODELS[name]:
        term = TERMS[each]
        begin = term.start * terms["coulomb"] if term.unit == "N·m" else term.start
        start[each] = terms.get(each, begin)
    return start
