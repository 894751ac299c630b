"""Fits a motion model to pieces of a record, each with its initial state (multiple shooting).

The parameters are per inertia: friction, load and torque gain over the inertia of all that turns,
since a motion tells no more. Least squares by Levenberg and Marquardt; one pass over the rows moves
all variants, so that derivatives cost little.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from haptic_wall.controller.experiments.recorded.swing import Pieces, positions
from haptic_wall.controller.theory.checks import FloatArray

_ROUNDS = 40
_TRIES, _REFINED = 48, 2
"""Number of starts that are drawn, and of those that a fit begins at"""
_DAMPINGS = np.array([0.0, 1e-3, 1e-1, 1e1])
"""Tried side by side, relative to the diagonal"""
_SETTLED = 1e-4
"""Fraction of the squares below which a further round is not worth it"""
_SCALES: Mapping[str, float] = {
    "sine": 1.0, "cosine": 1.0, "damping": 0.1, "coulomb": 0.2, "stribeck": 0.2,
    "stribeck_speed": 0.1, "load": 0.02, "load_stribeck": 0.02, "load_motor": 0.02,
    "load_motor_stribeck": 0.02, "load_quadratic": 1e-3, "load_motor_quadratic": 1e-3,
    "gain": 1.0, "delay": 1e-3, "quadratic": 0.05,
}  # fmt: skip
"""Least size of a parameter for its numerical derivative, per inertia"""
_STEP = 1e-4
_UNBOUNDED = frozenset({"sine", "cosine", "gain"})
LONGEST_DELAY_S = 0.1
_MOST: Mapping[str, float] = {
    "damping": 200.0, "coulomb": 1e4, "stribeck": 1e4, "quadratic": 1e3,
    "stribeck_speed": 10.0, "load": 0.9, "load_stribeck": 0.9, "load_motor": 0.9,
    "load_motor_stribeck": 0.9, "delay": LONGEST_DELAY_S,
}  # fmt: skip
_SPREADS: Mapping[str, float] = {"sine": 0.02, "cosine": 0.3, "gain": 0.05, "delay": 0.2}
"""Relative spread of the starts that are drawn around one; others 0.5"""
_LEAST: Mapping[str, float] = {"stribeck_speed": 0.02}


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
    values = np.array([start[name] for name in names])
    begin, speed = beginnings(pieces) if at is None else at
    low, high = _limits(names)
    values = np.clip(values, low, high)
    now, slopes, own = _slopes(pieces, names, values, begin, speed, fixed=fixed)
    cost = _cost(pieces, now[None])[0]
    damping = 1.0
    for _ in range(rounds):
        left = np.where(pieces.held, pieces.position - now, 0.0)
        steps, own_steps = _steps(slopes, own, left, damping, values, low, high, fixed)
        tried = np.clip(values + steps, low, high)
        begins, speeds = begin + own_steps[:, 0], speed + own_steps[:, 1]
        found = moved(pieces, names, tried, begins, speeds)
        costs = _cost(pieces, found)
        best = int(np.nanargmin(np.where(np.isfinite(costs), costs, np.inf)))
        if not costs[best] < cost:
            if damping > 1e4:
                break
            damping *= 100.0
            continue
        gained = (cost - costs[best]) / cost if cost > 0.0 else 0.0
        values, begin, speed, cost = tried[best], begins[best], speeds[best], costs[best]
        damping = max(0.1 * damping, 1e-3) if best < 2 else damping * (1.0 if best == 2 else 10.0)
        now, slopes, own = _slopes(pieces, names, values, begin, speed, fixed=fixed)
        if gained < _SETTLED:
            break
    return Shot(names, values, begin, speed, now, _projected(slopes, own), pieces)


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
    spread = np.array([_SPREADS.get(name, 0.5) for name in names])
    drawn = values * np.exp(spread * random.standard_normal((_TRIES, values.size)))
    away = np.array([0.3 * _SCALES[name] if v == 0.0 else 0.0 for name, v in start.items()])
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
    low = [(-np.inf if name in _UNBOUNDED else _LEAST.get(name, 0.0)) for name in names]
    return np.array(low), np.array([_MOST.get(name, np.inf) for name in names])


def _cost(pieces: Pieces, found: FloatArray) -> FloatArray:
    left = np.where(pieces.held, found - pieces.position, 0.0)
    with np.errstate(over="ignore", invalid="ignore"):
        squares: FloatArray = np.einsum("vpr,vpr->v", left, left)
    return squares


def _slopes(
    pieces: Pieces,
    names: tuple[str, ...],
    values: FloatArray,
    begin: FloatArray,
    speed: FloatArray,
    *,
    fixed: bool,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the positions, and their derivatives with respect to parameters and beginnings."""
    count = 0 if fixed else len(names)
    small = _STEP * np.array([max(abs(v), _SCALES[n]) for n, v in zip(names, values, strict=True)])
    high = _limits(names)[1]
    small = np.where(values + small > high, -small, small)[:count]
    variants = np.tile(values, (count + 3, 1))
    variants[1 : count + 1] += np.diag(np.concatenate([small, np.zeros(len(names) - count)]))[
        :count
    ]
    begins, speeds = (np.tile(each, (count + 3, 1)) for each in (begin, speed))
    own_small = np.array([1e-5, 1e-3])
    begins[count + 1] += own_small[0]
    speeds[count + 2] += own_small[1]
    found = moved(pieces, names, variants, begins, speeds)
    held = pieces.held
    slopes = np.where(held, (found[1 : count + 1] - found[0]) / small[:, None, None], 0.0)
    own = np.where(held, (found[count + 1 :] - found[0]) / own_small[:, None, None], 0.0)
    return found[0], slopes, own


def _projected(slopes: FloatArray, own: FloatArray) -> FloatArray:
    """Return the slopes without the part that the beginnings can make."""
    out = np.empty_like(slopes)
    for at in range(own.shape[1]):
        base = np.linalg.qr(own[:, at].T)[0]
        out[:, at] = slopes[:, at] - slopes[:, at] @ base @ base.T
    return out


def _steps(
    slopes: FloatArray,
    own: FloatArray,
    left: FloatArray,
    damping: float,
    values: FloatArray,
    low: FloatArray,
    high: FloatArray,
    fixed: bool,
) -> tuple[FloatArray, FloatArray]:
    """Return steps of parameters (dampings, names), and of beginnings (dampings, 2, pieces)."""
    count, pieces = slopes.shape[0], left.shape[0]
    steps = np.zeros((_DAMPINGS.size, values.size))
    own_steps = np.zeros((_DAMPINGS.size, 2, pieces))
    own_square = np.einsum("ipr,jpr->pij", own, own)
    own_right = np.einsum("ipr,pr->pi", own, left)
    cross = np.einsum("ipr,jpr->pij", own, slopes)
    square = np.einsum("ipr,jpr->ij", slopes, slopes)
    right = np.einsum("ipr,pr->i", slopes, left)
    free = np.ones(count, dtype=bool)
    if not fixed:
        free = ~(((values <= low) & (right < 0.0)) | ((values >= high) & (right > 0.0)))
        free &= np.diag(square) > 0.0
    for at, share in enumerate(_DAMPINGS * damping):
        blocks = own_square + share * np.einsum("pij,ij->pij", own_square, np.eye(2))
        blocks = blocks + 1e-12 * np.eye(2)
        inner = np.linalg.solve(blocks, np.concatenate([cross, own_right[..., None]], axis=2))
        if not fixed and free.any():
            whole = square + share * np.diag(np.diag(square))
            whole = whole - np.einsum("pji,pjk->ik", cross, inner[..., :-1])
            gradient = right - np.einsum("pji,pj->i", cross, inner[..., -1])
            chosen = np.ix_(free, free)
            steps[at, free] = np.linalg.lstsq(whole[chosen], gradient[free], rcond=1e-12)[0]
        made = inner[..., -1] - np.einsum("pij,j->pi", inner[..., :-1], steps[at, :count])
        own_steps[at] = made.T
    return steps, own_steps
