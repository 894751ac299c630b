"""Proves by zero exclusion that no member of a family of sampled loops has a pole on the circle.

A loop whose gain grows from nearly zero is stable until a pole reaches the unit circle
``z = exp(j w)``. With time in periods and per unit of inertia this happens where

    A(w) = P(w) v,    A = -(z - 1)(z - exp(-delta)) z^n,    v = rho (k + (B/T) D(w))

(A/P = F and D of the module ``boundary``; n whole periods of delay, the fraction is in P;
rho = g T²/m). Over 0 < k <= K and all gains up to the greatest, ``v`` fills a triangle. The proof
must show that the point A lies outside the triangle with the corners 0, P v_1, P v_2, for every
frequency, damping and delay. A line between them shows it. The line separates them over a whole box
of (w, damping, delay) when its distance, less the largest change that the derivatives allow, stays
positive. A box in which none of a few lines separates them is split.

At w = 0 all of these vanish. There k is eliminated: Im(A conj P) must not reach
Im(D) |P|² rho B/T, both divided by w.

Inertia and damping are one variable x: each (delta, rho) of the family belongs to a member on two
edges of the range, with the lowest inertia and ``x >= 1`` times the lowest damping, or with the
lowest damping and ``1/x² >= 1`` times the lowest inertia (and a gain that is no greater). The
frequency is w = sigma omega with sigma = min(x, 1). Then rho/sigma² is constant, and the omega of
the oscillation hardly depends on x, so that long boxes suffice.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.theory.checks import ComplexArray, FloatArray, IntArray
from haptic_wall.controller.theory.intervals import (
    Jet,
    decay_moments,
    turn_mean,
    turned,
    variables,
)

_FREQUENCY, _EDGE, _FRACTION = range(3)
_FIRST_SPLIT = 8  # of the frequencies, geometrically
_FEW = 500  # this many boxes cost hardly more than one: split into quarters instead of halves
_HAIR = 1e-9  # by which each box overlaps its neighbours, since its edges are rounded


@dataclass(frozen=True, slots=True)
class Family:
    """Common parameters of the members, and the ranges of the parameters that differ."""

    gain: float
    """g T²/m at the greatest torque gain and the lowest inertia [rad/(N·m)]"""
    delta: float
    """b T/m at the lowest damping and the lowest inertia, > 0"""
    edge: tuple[float, float]
    """x: -2nd power of the ratio of inertias at its low end, ratio of dampings at its high end"""
    delay: tuple[float, float]
    """[periods]"""
    stiffness: float
    """K, the upper end of the proved range [N·m/rad]; 0: proves the damping alone"""
    damper: float
    """B/T [N·m/rad]"""
    samples: int
    """N of the velocity difference"""


@dataclass(frozen=True, slots=True)
class Exclusion:
    """The result of a proof that a family has no poles on the unit circle."""

    proved: bool
    boxes: int
    """Number of evaluated boxes"""
    suspect: tuple[float, float] | None
    """(x, delay in periods) of the member nearest to such a pole; None when proved"""


_Corners = Callable[[Family, list[Jet], IntArray, FloatArray], list[Jet]]


@dataclass(frozen=True, slots=True)
class _Boxes:
    """Boxes in (omega, x, fraction), variables × boxes, of whole delays ``whole``."""

    centre: FloatArray
    half: FloatArray
    whole: IntArray

    def take(self, chosen: NDArray[np.bool_]) -> _Boxes:
        return _Boxes(self.centre[:, chosen], self.half[:, chosen], self.whole[chosen])

    def split(self, along: IntArray) -> _Boxes:
        """Return both halves of each box."""
        columns = np.arange(along.size)
        half = self.half.copy()
        half[along, columns] *= 0.5
        shift = np.zeros_like(half)
        shift[along, columns] = half[along, columns]
        return _Boxes(
            np.hstack([self.centre - shift, self.centre + shift]),
            np.hstack([half, half]),
            np.concatenate([self.whole, self.whole]),
        )

    def followed_by(self, other: _Boxes) -> _Boxes:
        return _Boxes(
            np.hstack([self.centre, other.centre]),
            np.hstack([self.half, other.half]),
            np.concatenate([self.whole, other.whole]),
        )


def exclude(family: Family, budget: int) -> Exclusion:
    """Try to prove that no member has a pole on the unit circle, at any gain and stiffness.

    Args:
        family: The members.
        budget: Number of boxes to evaluate before giving up.
    """
    shortest, longest = family.delay
    if 2 * _FIRST_SPLIT * (longest - shortest) > budget:
        return Exclusion(False, 0, (family.edge[1], longest))
    boxes, looked_at = _first(family), 0
    while True:
        looked_at += boxes.whole.size
        # the first boxes of frequencies begin at 0, and so do their lower halves
        zero = boxes.centre[_FREQUENCY] <= boxes.half[_FREQUENCY] * (1 + _HAIR)
        low, high = boxes.take(zero), boxes.take(~zero)
        bound_low, _, along_low = _distances(family, low, _at_zero)
        bound, here, along = _distances(family, high, _corners)
        left_low, left = ~(bound_low > 0), ~(bound > 0)  # NaN is not proved
        rest = low.take(left_low).split(along_low[left_low])
        rest = rest.followed_by(high.take(left).split(along[left]))
        if rest.whole.size == 0:
            return Exclusion(True, looked_at, None)
        if rest.whole.size < _FEW:
            along = np.concatenate([np.tile(along_low[left_low], 2), np.tile(along[left], 2)])
            rest = rest.split(along)
        if np.any(here <= 0) or looked_at + rest.whole.size > budget:
            nearest = high if np.any(left) else low
            worst = int(np.argmin(np.where(left, here, np.inf))) if np.any(left) else 0
            _, x, fraction = nearest.centre[:, worst].tolist()
            return Exclusion(False, looked_at, (x, int(nearest.whole[worst]) + fraction))
        boxes = rest


def _first(family: Family) -> _Boxes:
    """Return the boxes of the whole family, split at x = 1 and at whole delays."""
    shortest, longest = family.delay
    whole = np.arange(np.floor(shortest), max(np.ceil(longest), np.floor(shortest) + 1))
    cuts = _highest_frequency(family) * 2.0 ** np.arange(1 - _FIRST_SPLIT, 1)
    low_w, high_w = np.concatenate([[0.0], cuts[:-1]]), cuts
    low_x, high_x = np.array([family.edge[0], 1.0]), np.array([1.0, family.edge[1]])
    low_f, high_f = np.maximum(shortest - whole, 0.0), np.minimum(longest - whole, 1.0)
    i, j, k = (index.ravel() for index in np.indices((cuts.size, 2, whole.size)))
    low = np.array([low_w[i], low_x[j], low_f[k]])
    high = np.array([high_w[i], high_x[j], high_f[k]])
    return _Boxes(0.5 * (low + high), 0.5 * (high - low), whole[k].astype(np.int64))


def _highest_frequency(family: Family) -> float:
    """Return an omega above which |A| > |P v| for all members.

    |A| = s |z - eps| with s = |z - 1| = 2 sin(w/2) and |z - eps|² = (1 - eps)² + eps s², while
    |P| <= |z - eps|/2 + 1 and |v| <= rho (K + |B|/T s): once |A| exceeds it, it stays above as s
    grows.
    """
    x = np.array(family.edge)
    sigma = np.minimum(x, 1.0)
    eps = np.exp(-family.delta * x * sigma)
    s = np.linspace(2.0, 0.0, 2001)[:-1]
    second = np.sqrt((1 - eps[0]) ** 2 + eps[1] * s**2)
    greatest = family.gain * (family.stiffness + abs(family.damper) * s)
    small = np.flatnonzero(s <= 1.001 * (0.5 + 1 / second) * greatest)
    first = max(int(small[0]) - 1, 0) if small.size else s.size - 1
    return float(2 * np.arcsin(s[first] / 2) / sigma[0])


def _distances(
    family: Family,
    boxes: _Boxes,
    corners: _Corners,
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Return the distance of the point from the triangle, along the best line of each box.

    Returns:
        The least distance over the box (positive: certainly outside), the distance at its middle,
        and the variable along which splitting helps most.
    """
    half = boxes.half * (1 + _HAIR) + _HAIR**1.5 * np.abs(boxes.centre)
    # x = 1 occurs only as an edge of boxes
    flat = (boxes.centre[_EDGE] >= 1.0).astype(np.float64)
    middle = corners(family, variables(boxes.centre, 0 * half, False), boxes.whole, flat)
    around = corners(family, variables(boxes.centre, half, True), boxes.whole, flat)
    point = np.array([jet.centre[0] for jet in middle])
    error = np.array([jet.radius[0] for jet in middle])
    slope = np.array([jet.centre[1:] for jet in around])
    spread = np.array([jet.radius[1:] for jet in around])
    # corners × lines × boxes, with the variables before the boxes
    turn = np.conj(_lines(point))[None]
    here = (turn * point[:, None]).real
    allowed = np.abs((turn[:, :, None] * slope[:, None]).real) + spread[:, None]
    reach = allowed * half
    bound = (here - error[:, None] - reach.sum(axis=2)).min(axis=0)
    best = np.argmax(bound, axis=0)
    columns = np.arange(best.size)
    blame = reach.max(axis=0)[best, :, columns]
    return bound[best, columns], here.min(axis=0).max(axis=0), np.argmax(blame, axis=1)


def _lines(point: ComplexArray) -> ComplexArray:
    """Return unit normals of lines that may separate 0 from a polygon; lines × boxes.

    Args:
        point: The polygon's corners × boxes; two corners are those of ``_at_zero``.
    """
    if len(point) == 2:
        return np.full((1, point.shape[1]), -1j)
    edges = point - np.roll(point, 1, axis=0)
    # halfway between A and an edge, as the edges turn with w
    rays = _unit(point[:1]) + _unit(point[0] - point[1:])
    return _unit(np.concatenate([point, 1j * edges, -1j * edges, 1j * rays, -1j * rays]))


def _unit(z: ComplexArray) -> ComplexArray:
    size = np.abs(z)
    result: ComplexArray = z / np.where(size > 0, size, 1.0)
    return result


@dataclass(frozen=True, slots=True)
class _Parts:
    """The factors that both forms of the condition share."""

    point: Jet
    """A / (omega sigma²)"""
    p: Jet
    """P"""
    damper: Jet
    """rho B/T D / (omega sigma²)"""

    @classmethod
    def of(cls, family: Family, at: list[Jet], whole: IntArray, flat: FloatArray) -> _Parts:
        omega, x, fraction = at
        sigma = x.scaled(1.0 - flat).plus(flat)
        w = omega * sigma
        delta = (x * sigma).scaled(family.delta)
        rest = fraction.scaled(-1.0).plus(1.0)  # fraction of a period in which the new torque acts
        full_speed, full_torque = decay_moments(delta)
        late_speed, late_torque = decay_moments(rest * delta)
        new, new_speed = rest * rest * late_torque, rest * late_speed
        z_1 = turn_mean(w).scaled(1j)  # (z - 1)/w
        z_eps = omega * z_1 + (x * full_speed).scaled(family.delta)  # (z - eps)/sigma
        back = turned(w, -1.0)
        change = w * z_1 * back  # 1 - 1/z, the difference between the new torque and the old
        p = sigma * z_eps * (full_torque * back + new * change) + full_speed * (
            full_speed * back + new_speed * change
        )
        difference = turn_mean(w.scaled(-float(family.samples))).scaled(1j)  # D/w
        return cls(
            point=(z_1 * z_eps * turned(w, whole.astype(np.float64))).scaled(-1.0),
            p=p,
            damper=(sigma * difference).scaled(family.gain * family.damper),
        )


def _corners(family: Family, at: list[Jet], whole: IntArray, flat: FloatArray) -> list[Jet]:
    """Return the vector from each corner of the triangle to the point A, divided by sigma²."""
    parts = _Parts.of(family, at, whole, flat)
    omega = at[_FREQUENCY]
    point = omega * parts.point
    damped = point - parts.p * omega * parts.damper
    return [point, damped, damped - parts.p.scaled(family.gain * family.stiffness)]


def _at_zero(family: Family, at: list[Jet], whole: IntArray, flat: FloatArray) -> list[Jet]:
    """Return two numbers whose imaginary parts must be negative; the stiffness is eliminated."""
    parts = _Parts.of(family, at, whole, flat)
    mirrored = parts.p.conjugate()
    point = parts.point * mirrored
    return [point, point - parts.p * mirrored * parts.damper]
