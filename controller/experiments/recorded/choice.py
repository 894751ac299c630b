"""Chooses the friction model that a record shows: the simplest one, unless a richer leaves less."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from haptic_wall.controller.experiments.identify.fit import Fit
from haptic_wall.controller.experiments.identify.motion import Pieces
from haptic_wall.controller.experiments.recorded.friction import MODELS
from haptic_wall.controller.experiments.recorded.shooting import fit

PIECE_S = 1.0
"""Length of the pieces to which models are fitted [s]"""
BETTER = 0.75
"""Largest fraction of a simpler model's residual that a richer one must leave: two swings of one
real servo differ by more than a smaller gain"""
_ROUNDS = 10


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
        tried = [fit(pieces, start_with(name, each), rounds=_ROUNDS) for each in starts]
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
    others = {term.name for model in MODELS.values() for term in model}
    start = {key: value for key, value in terms.items() if key not in others}
    for term in MODELS[name]:
        begin = term.start * terms["coulomb"] if term.unit == "N·m" else term.start
        start[term.name] = terms.get(term.name, begin)
    return start
