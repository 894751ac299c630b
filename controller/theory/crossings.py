"""Stable stiffnesses of a wall on any chain of masses, by D-decomposition with all its crossings.

On the unit circle ``z = exp(j w)`` the characteristic equation is linear in the stiffness K and the
virtual damping B::

    K + B D(z) = F(z),    F = -1 / G(z),    D = (1 - z^-N) / (N T)

A pole is on the circle where Im F = B Im D, with ``K = Re F - B Re D``. Where Im F - B Im D rises
through zero, a pair of poles leaves the circle as K grows; where it falls, a pair comes back. The
stable stiffnesses can therefore be several intervals.

The crossings are found between the points of a grid that follows each turn of the delay and of the
difference, and is dense beside each pole and zero of the chain. Between two points on the same side
the function is also looked at where it comes closest to zero: two crossings may lie there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from haptic_wall.controller.theory.chain import Sampled
from haptic_wall.controller.theory.checks import ComplexArray, FloatArray, IntArray
from haptic_wall.controller.theory.roots import dips, refined
from haptic_wall.controller.theory.velocity_filter import VelocityFilter

_REAL = 1e-6
"""Least size of a difference that is more than rounding, relative"""
_PER_TURN = 24
"""Points of the grid in each turn of the delay, and of the difference"""
_BESIDE = np.linspace(0.0, 1.0, 14)
"""Distances of points from a pole or zero: from its own distance to the circle to 1, as powers"""
_AT_FILTER = np.geomspace(1e-5, 0.4, 40)
"""The same from a filter's frequency, over this: on the flanks of a notch its phase turns"""
_SLOWEST = 1e-9
"""First point of the grid, in points of equal distance"""
_LAST = 1e-6
"""Distance of the last point before pi, over pi: up to it there is an imaginary part"""


@dataclass(frozen=True, slots=True)
class Loops:
    """Chains with a wall's delay and velocity difference; the samples are common."""

    chains: Sampled
    period: FloatArray
    """T [s]"""
    whole: IntArray
    """Whole periods of the delay"""
    samples: int
    """N of the velocity difference"""
    velocity_filter: VelocityFilter | None = None
    """Filter of the velocity: a factor of D"""

    def take(self, index: IntArray) -> Loops:
        """Return the loops at ``index``."""
        chains, period, whole = self.chains.take(index), self.period[index], self.whole[index]
        return Loops(chains, period, whole, self.samples, self.velocity_filter)

    def responses(self, w: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        """Return F = -1/G and D, filtered, at frequencies [rad/sample], loops × frequencies."""
        half = turned(0.5 * w)
        late = turned((self.whole[:, None] + 1.0) * w)
        asked = (w, half, self.samples, self.period[:, None], self.velocity_filter)
        return self._inverse(half, late), difference(*asked)

    def _inverse(self, half: ComplexArray, late: ComplexArray) -> ComplexArray:
        """Return F at frequencies of which ``half`` is exp(j w/2), turned by the delay."""
        moved = 2j * half.imag * half  # z - 1, without cancellation
        poles = self.chains.moved_poles
        found = -moved * late
        for i in range(poles.shape[1]):
            found *= moved - poles[:, i, None]
        numerator = self.chains.numerator
        below = np.repeat(numerator[:, -1, None].astype(moved.dtype), moved.shape[1], axis=1)
        for i in range(numerator.shape[1] - 2, -1, -1):
            below *= moved
            below += numerator[:, i, None]
        found /= below
        return found


def difference(
    w: FloatArray,
    half: ComplexArray,
    samples: int,
    period: FloatArray | float,
    velocity_filter: VelocityFilter | None,
) -> ComplexArray:
    """Return D, filtered, at frequencies ``w`` [rad/sample]; ``half`` is exp(j w/2)."""
    over_all = half if samples == 1 else turned(0.5 * samples * w)
    found: ComplexArray = 2j / (samples * period) * over_all.imag * over_all.conj()
    return found if velocity_filter is None else found * velocity_filter.response(w)


def size(w: FloatArray, samples: int, velocity_filter: VelocityFilter | None) -> FloatArray:
    """Return D, filtered, over its direction and over 2 / (N T) and a filter's denominator.

    It is real, and changes its sign where D goes through 0. Arguments as of ``difference``.
    """
    found: FloatArray = np.sin(0.5 * samples * w)
    return found if velocity_filter is None else found * velocity_filter.above(w)


def turned(angle: FloatArray) -> ComplexArray:
    """Return exp(j angle): of real angles in half the time of ``numpy.exp``."""
    found = np.empty(angle.shape, dtype=np.result_type(angle, np.complex64))
    found.real, found.imag = np.cos(angle), np.sin(angle)
    return found


class Crossing(NamedTuple):
    """The lowest gain at which poles cross the unit circle; arrays, one element for each loop."""

    gain: FloatArray
    """Stiffness [N·m/rad] or virtual damping [N·m·s/rad], above 0; infinite: none crosses"""
    w: FloatArray
    """[rad/sample]; 0: none crosses"""
    leaving: IntArray
    """Poles that leave the circle, less those that come back, over all gains above 0"""


def first_crossing(loops: Loops, virtual_damping: FloatArray) -> Crossing:
    """Return the lowest stiffness of a crossing at each loop's virtual damping [N·m·s/rad]."""

    def left(some: Loops, index: IntArray, w: FloatArray) -> ComplexArray:
        inverse, difference = some.responses(w)
        found: ComplexArray = inverse - virtual_damping[index, None] * difference
        return found

    return _lowest(loops, left, lambda _, w: np.ones_like(w))


def ceilings(loops: Loops) -> FloatArray:
    """Return the lowest virtual damping at which poles leave the circle without any stiffness."""

    # F is parallel to D: as D has zeros, to its direction
    def left(some: Loops, _: IntArray, w: FloatArray) -> ComplexArray:
        inverse = some.responses(w)[0]
        found: ComplexArray = inverse * -1j * turned(0.5 * some.samples * w)
        filtered = some.velocity_filter
        return found if filtered is None else found * filtered.below(w)

    def by(some: Loops, w: FloatArray) -> FloatArray:
        found: FloatArray = 2.0 * size(w, some.samples, some.velocity_filter)
        found /= some.samples * some.period[:, None]
        return found

    return _lowest(loops, left, by, only_leaving=True).gain


def unstable_softest(loops: Loops, found: Crossing) -> IntArray:
    """Return how many poles lie outside of the unit circle with a stiffness just above 0.

    They are those of an infinite stiffness, less those that leave on the way to it. With an
    infinite stiffness poles are at the zeros of the chain, and one for each held torque far away.
    """
    outside: IntArray = (np.abs(1.0 + loops.chains.moved_zeros()) > 1.0).sum(axis=1)
    far: IntArray = loops.whole + 1 + outside - found.leaving
    return far


_Left = Callable[[Loops, IntArray, FloatArray], ComplexArray]
"""Of loops, their indices and frequencies: what is real at a crossing"""
_Size = Callable[[Loops, FloatArray], FloatArray]
"""What it is divided by for the gain"""


def _lowest(loops: Loops, left: _Left, size: _Size, *, only_leaving: bool = False) -> Crossing:
    """Return the lowest crossing, or the lowest at which poles leave; and the count of all."""
    count, every = loops.period.size, np.arange(loops.period.size)
    grid, value = _looked_at(lambda w: left(loops, every, w), _grid(loops))
    above = value.imag[:, :-1] > 0
    row, at = np.nonzero(above[:, 1:] != above[:, :-1])
    rises, some = above[row, at + 1], loops.take(row)
    low, high = grid[row, at], grid[row, at + 1]
    by = size(some, np.stack([low, high], axis=1))
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = value.real[row[:, None], at[:, None] + np.arange(2)] / by
        # at pi all is real
        end = np.full((count, 1), np.pi)
        last_by = size(loops, end)[:, 0]
        is_more = np.abs(last_by) > _REAL * np.abs(size(loops, 0.9 * end))[:, 0]
        last = np.where(is_more, value.real[:, -1] / last_by, np.inf)
    last = np.where(last > 0, last, np.inf)
    last_leaves = above[:, -1] != (last_by > 0)
    leaves = rises == (by[:, 0] > 0)
    # only what may be the lowest, or below 0, is looked at closely
    spread = np.abs(ends[:, 1] - ends[:, 0])
    least, most = np.min(ends, axis=1) - spread, np.max(ends, axis=1) + spread
    sure = (least > 0) & (leaves | (not only_leaving))
    bound = np.where(last_leaves | (not only_leaving), last, np.inf)
    np.minimum.at(bound, row[sure], most[sure])
    near = ~((most < 0) | (least > bound[row]))
    index, some, sign = row[near], loops.take(row[near]), np.where(rises[near], 1.0, -1.0)
    found = refined(
        lambda w: sign * left(some, index, w[:, None])[:, 0].imag, low[near], high[near]
    )
    by_found = size(some, found[:, None])[:, 0]
    gain, w = ends[:, 0], low
    gain[near] = left(some, index, found[:, None])[:, 0].real / by_found
    w[near], leaves[near] = found, rises[near] == (by_found > 0)
    leaving = np.where(np.isinf(last), 0, np.where(last_leaves, 1, -1))
    np.add.at(leaving, row, np.where(gain > 0, np.where(leaves, 2, -2), 0))
    row, w = np.concatenate([every, row]), np.concatenate([end[:, 0], w])
    gain, leaves = np.concatenate([last, gain]), np.concatenate([last_leaves, leaves])
    kept = np.isfinite(gain) & (gain > 0) & (leaves | (not only_leaving))
    row, w, gain = row[kept], w[kept], gain[kept]
    order = np.lexsort((-gain, row))  # the lowest is written last
    lowest = Crossing(np.full(count, np.inf), np.zeros(count), leaving)
    lowest.gain[row[order]], lowest.w[row[order]] = gain[order], w[order]
    return lowest


def _looked_at(
    function: Callable[[FloatArray], ComplexArray], grid: FloatArray
) -> tuple[FloatArray, ComplexArray]:
    """Return values on the grid and where the imaginary part comes closest to 0 between."""
    value = function(grid)
    hidden = dips(lambda w: function(w).imag / w, grid, value.imag / grid)
    if not hidden.size:
        return grid, value
    grid = np.concatenate([grid, hidden], axis=1)
    value = np.concatenate([value, function(hidden)], axis=1)
    order = np.argsort(grid, axis=1, kind="stable")
    return np.take_along_axis(grid, order, 1), np.take_along_axis(value, order, 1)


def _grid(loops: Loops) -> FloatArray:
    """Return rising frequencies up to pi, a row for each loop [rad/sample]."""
    chains, turns = loops.chains, int(loops.whole.max(initial=0)) + 1 + loops.samples
    even = np.linspace(0.0, np.pi, 24 + _PER_TURN * turns // 2)[1:-1]
    common = np.concatenate([even[0] * np.geomspace(_SLOWEST, 0.5, 20), even])
    if loops.velocity_filter is not None:
        about = loops.velocity_filter.w0 * np.concatenate([1.0 - _AT_FILTER, 1.0 + _AT_FILTER])
        common = np.concatenate([common, about])
    moved = np.concatenate([chains.moved_poles, chains.moved_zeros()], axis=1)
    angle = np.abs(np.arctan2(moved.imag, 1.0 + moved.real))[..., None]
    off = np.abs(2.0 * moved.real + np.abs(moved) ** 2) / (1.0 + np.abs(1.0 + moved))
    beside = np.clip(off, 1e-9, 3.0)[..., None] ** (1.0 - _BESIDE)
    near = np.concatenate([angle - beside, angle, angle + beside], axis=2)
    rows = np.tile(common, (len(moved), 1))
    rows = np.concatenate([rows, near.reshape(len(moved), -1)], axis=1)
    last = np.pi * (1.0 - _LAST)
    rows = np.sort(np.clip(rows, common[0], last), axis=1)
    found: FloatArray = np.concatenate([rows, np.tile([last, np.pi], (len(moved), 1))], axis=1)
    return found


def unstable_poles(loops: Loops, stiffness: FloatArray, virtual_damping: FloatArray) -> IntArray:
    """Return how many closed-loop poles of each loop lie outside of the unit circle.

    Args:
        loops: The loops.
        stiffness: K of each [N·m/rad].
        virtual_damping: B of each [N·m·s/rad].
    """
    outside = np.abs(poles(loops, stiffness, virtual_damping)) > 1.0
    count: IntArray = outside.sum(axis=1)
    return count


def poles(
    loops: Loops, stiffness: FloatArray | ComplexArray, virtual_damping: FloatArray | ComplexArray
) -> ComplexArray:
    """Return the closed-loop poles, loops × poles; arguments as of ``unstable_poles``.

    Loops with fewer whole periods of delay than others have so many more poles at 0.

    Complex ones are those of a wall behind a gain that lags.
    """
    chains, samples, filtered = loops.chains, loops.samples, loops.velocity_filter
    count, order = chains.old.shape
    rows, late = np.arange(count), order + loops.whole
    torques = int(loops.whole.max(initial=0)) + 1
    past = order + torques + samples
    size = past if filtered is None else past + 2
    a = np.zeros((count, size, size), np.result_type(stiffness, virtual_damping))
    per_sample = 1.0 / (samples * loops.period)
    difference = np.zeros((count, size))
    difference[:, order - 1], difference[:, past - 1] = per_sample, -per_sample
    if filtered is not None:
        # direct form: the velocity v and two states r, with y = b0 v + r1
        b0, b1, b2, a1, a2 = filtered.taps()
        a[:, past] = (b1 - a1 * b0) * difference
        a[:, past, past] -= a1
        a[:, past, past + 1] = 1.0
        a[:, past + 1] = (b2 - a2 * b0) * difference
        a[:, past + 1, past] -= a2
        difference *= b0
        difference[:, past] += 1.0
    command = -virtual_damping[:, None] * difference
    command[:, order - 1] -= stiffness
    a[:, :order, :order] = chains.step + np.eye(order)
    a[rows, :order, late] += chains.old
    later = np.flatnonzero(loops.whole)
    a[later, :order, late[later] - 1] += chains.new[later]
    at_once = np.flatnonzero(loops.whole == 0)
    a[at_once, :order] += chains.new[at_once, :, None] * command[at_once, None]
    a[:, order] = command
    shifted = np.arange(order + 1, order + torques)
    a[:, shifted, shifted - 1] = 1.0
    a[:, order + torques, order - 1] = 1.0
    shifted = np.arange(order + torques + 1, past)
    a[:, shifted, shifted - 1] = 1.0
    return np.linalg.eigvals(a).astype(np.complex128)
