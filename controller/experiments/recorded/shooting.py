"""Fits a motion model to pieces of a record, each with its initial state (multiple shooting).

The parameters are per inertia: friction, load and torque gain over the inertia of all that turns,
since a motion tells no more. One pass over the rows moves all variants, so that derivatives cost
little.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from haptic_wall.controller.experiments.identify.separable import Linear, fit_own, fit_pieces
from haptic_wall.controller.experiments.recorded.friction import TERMS
from haptic_wall.controller.experiments.recorded.swing import Pieces, positions
from haptic_wall.controller.theory.checks import FloatArray

_ROUNDS = 40
_TRIES, _REFINED = 48, 2
"""Number of starts that are drawn, and of those that a fit begins at"""
_SETTLED = 1e-6
"""Fraction of the squares below which a further round is not worth it"""
_STEP, _OWN_STEPS = 1e-4, (1e-5, 1e-3)
"""Of a parameter, relative; of a piece's first position [rad] and speed [rad/s]"""


@dataclass(frozen=True, slots=True)
class Shot:
    """A fit of the pieces."""

    names: tuple[str, ...]
    values: FloatArray
    """Values of the parameters, per inertia; shape (names,)"""
    begin: FloatArray
    """Positions at the first rows [rad], shape (pieces,)"""
    speed: FloatArray
    """Speeds there [rad/s]"""
    fitted: FloatArray
    """Positions [rad], shape (pieces, rows)"""
    slopes: FloatArray
    """Derivatives of ``fitted`` with respect to the parameters, beginnings projected out; shape
    (names, pieces, rows), 0 in the padding"""
    pieces: Pieces

    @property
    def terms(self) -> dict[str, float]:
        """Return the parameters by name."""
        return dict(zip(self.names, self.values.tolist(), strict=True))

    @property
    def left(self) -> FloatArray:
        """Return the residuals [rad], shape (pieces, rows); 0 in the padding."""
        return np.where(self.pieces.held, self.pieces.position - self.fitted, 0.0)

    @property
    def rms(self) -> float:
        """Return the root mean square of the residuals [rad]."""
        return math.sqrt(float(np.sum(self.left**2)) / np.count_nonzero(self.pieces.held))


def beginnings(pieces: Pieces, over_s: float = 0.05) -> tuple[FloatArray, FloatArray]:
    """Estimate position and speed at each piece's first row, by a parabola through its beginning.

    Args:
        pieces: The record.
        over_s: Length of the beginning [s].
    """
    begin, speed = np.empty((2, len(pieces.time)))
    for at, (time, position, held) in enumerate(
        zip(pieces.time, pieces.position, pieces.held, strict=True)
    ):
        since = time[held] - time[0]
        near = slice(0, max(6, int(np.searchsorted(since, over_s))))
        parts = np.polynomial.polynomial.polyfit(since[near], position[held][near], 2)
        begin[at], speed[at] = parts[0], parts[1]
    return begin, speed


def moved(
    pieces: Pieces,
    names: Sequence[str],
    values: FloatArray,
    begin: FloatArray,
    speed: FloatArray,
) -> FloatArray:
    """Return positions [rad], shape (variants, pieces, rows), of variants of the parameters.

    Args:
        pieces: The record.
        names: Names of the parameters.
        values: Per inertia, shape (variants, names).
        begin: Positions at the first rows [rad], shape (variants or 1, pieces).
        speed: Speeds at the first rows [rad/s], of the same shape.
    """
    terms = {name: values[:, at : at + 1] for at, name in enumerate(names)}
    one = np.ones((len(values), 1))
    for name, value in (("inertia", 1.0), ("gain", 0.0), ("delay", 0.0), ("sine", 0.0),
                        ("cosine", 0.0), ("damping", 0.0), ("coulomb", 0.0)):  # fmt: skip
        terms.setdefault(name, value * one)
    shape = (len(values), len(pieces.time))
    return positions(pieces, terms, np.broadcast_to(begin, shape), np.broadcast_to(speed, shape))


def fit(
    pieces: Pieces,
    start: Mapping[str, float],
    at: tuple[FloatArray, FloatArray] | None = None,
    fixed: bool = False,
    rounds: int = _ROUNDS,
) -> Shot:
    """Fit the parameters, and the beginnings of the pieces.

    Args:
        pieces: The record.
        start: The parameters that are fitted, per inertia, where the fit begins.
        at: Positions and speeds at the beginnings, where the fit begins; None: estimated.
        fixed: The parameters stay; only the beginnings are fitted.
        rounds: Largest number of rounds.
    """
    names = tuple(start)
    limits = _limits(names)
    values = np.clip([start[name] for name in names], *limits)
    own = np.stack(beginnings(pieces) if at is None else at)

    def linearised(values: FloatArray, own: FloatArray) -> Linear:
        return _linear(pieces, names, values, own, names[: 0 if fixed else None])

    if fixed:
        own = fit_own(lambda own: linearised(values, own), own, rounds)
    else:
        values, own = fit_pieces(
            linearised, values, own, bounds=limits, rounds=rounds, enough=_SETTLED
        )
    found = linearised(values, own)
    slopes = found.weights * found.without_own(found.shared)
    return Shot(names, values, own[0], own[1], pieces.position + found.left, slopes, pieces)


def fit_anywhere(
    pieces: Pieces,
    start: Mapping[str, float],
    at: tuple[FloatArray, FloatArray] | None = None,
    rounds: int = _ROUNDS,
    enough: float = 0.0,
) -> Shot:
    """Fit as ``fit``, from the best of starts that are drawn around the given one.

    A long swing has several minima of its squares: the shaft comes to rest one half-cycle earlier
    or later.

    Args:
        pieces: The record.
        start: As ``fit``.
        at: As ``fit``.
        rounds: Largest number of rounds of each.
        enough: Residual at which no further start is tried [rad].
    """
    names = tuple(start)
    values = np.array([start[name] for name in names])
    random = np.random.default_rng(1)
    spread = np.array([TERMS[name].spread for name in names])
    drawn = values * np.exp(spread * random.standard_normal((_TRIES, values.size)))
    away = np.array([0.3 * TERMS[name].size if v == 0.0 else 0.0 for name, v in start.items()])
    drawn += away * np.abs(random.standard_normal(drawn.shape))
    drawn[0] = values
    drawn = np.clip(drawn, *_limits(names))
    begin, speed = beginnings(pieces) if at is None else at
    costs = _cost(pieces, moved(pieces, names, drawn, begin[None], speed[None]))
    order = np.argsort(np.where(np.isfinite(costs), costs, np.inf))
    chosen = [0, *(at for at in order.tolist() if at != 0)][: _REFINED + 1]
    if order[0] != 0:
        chosen = chosen[1:] if costs[chosen[1]] < 0.5 * costs[0] else chosen[:_REFINED]
    found: list[Shot] = []
    for each in chosen:
        begun = dict(zip(names, drawn[each].tolist(), strict=True))
        found.append(fit(pieces, begun, (begin, speed), rounds=rounds))
        if found[-1].rms <= enough:
            break
    return min(found, key=lambda shot: shot.rms)


def _limits(names: tuple[str, ...]) -> tuple[FloatArray, FloatArray]:
    low, high = zip(*((TERMS[name].least, TERMS[name].most) for name in names), strict=True)
    return np.array(low), np.array(high)


def _cost(pieces: Pieces, found: FloatArray) -> FloatArray:
    left = np.where(pieces.held, found - pieces.position, 0.0)
    with np.errstate(over="ignore", invalid="ignore"):
        squares: FloatArray = np.einsum("vpr,vpr->v", left, left)
    return squares


def _linear(
    pieces: Pieces,
    names: tuple[str, ...],
    values: FloatArray,
    own: FloatArray,
    changed: tuple[str, ...],
) -> Linear:
    """Return residuals, with derivatives by the first of the parameters and the beginnings."""
    count = len(changed)
    small = _STEP * np.array(
        [max(abs(v), TERMS[n].size) for n, v in zip(names, values, strict=True)]
    )
    small = np.where(values + small > _limits(names)[1], -small, small)[:count]
    variants = np.tile(values, (count + 3, 1))
    variants[range(1, count + 1), range(count)] += small
    begins, speeds = (np.tile(each, (count + 3, 1)) for each in own)
    begins[count + 1] += _OWN_STEPS[0]
    speeds[count + 2] += _OWN_STEPS[1]
    left = np.where(
        pieces.held, moved(pieces, names, variants, begins, speeds) - pieces.position, 0.0
    )
    slopes = (left[1:] - left[0]) / np.array([*small, *_OWN_STEPS])[:, None, None]
    weights = pieces.held.astype(float)
    return Linear(left[0], slopes[:count], slopes[count:], weights, np.zeros(count))
