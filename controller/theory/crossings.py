"""Stable stiffnesses of a wall on any chain of masses, by D-decomposition with all its crossings.

On the unit circle, ``z = (1 + s)/(1 - s)`` with ``s = j tan(w/2)``, the characteristic equation is
linear in the stiffness K and the damping B (see ``boundary``)::

    K + B D(z) = F(z),    F = -1 / G(z),    D = (1 - z^-N) / (N T)

Im F = B Im D is a polynomial in ``tan²(w/2)``: its positive roots are all crossings at this B, and
``K = Re F - B Re D`` at each. Where Im F - B Im D rises through zero, a pair of poles leaves the
circle as K grows; where it falls, a pair comes back. The stable stiffnesses can therefore be
several intervals.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.theory.chain import Sampled
from haptic_wall.controller.theory.checks import ComplexArray, FloatArray, IntArray
from haptic_wall.controller.theory.polynomials import (
    circle,
    even,
    in_s,
    odd,
    plus,
    power,
    right_roots,
    times,
)
from haptic_wall.controller.theory.real_roots import positive_roots
from haptic_wall.controller.theory.velocity_filter import VelocityFilter

_STEP = 1e-7
"""Relative step of the frequency that tells a slope"""
_REAL = 1e-6
"""Largest imaginary part of a real number, relative"""
_ROUNDS = 8
_FINE = 1e-7
"""Relative correction of a frequency after which the next one, from the same slope, is exact"""


@dataclass(frozen=True, slots=True)
class Loops:
    """Chains with a wall's delay and velocity difference; whole delay and samples are common."""

    chains: Sampled
    period: FloatArray
    """T [s]"""
    whole: int
    """Whole periods of the delay"""
    samples: int
    """N of the velocity difference"""
    velocity_filter: VelocityFilter | None = None
    """Filter of the velocity: a factor of D"""

    def take(self, index: IntArray) -> Loops:
        """Return the loops at ``index``."""
        return replace(self, chains=self.chains.take(index), period=self.period[index])

    def responses(self, w: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        """Return F = -1/G and D, filtered, at frequencies [rad/sample], loops × frequencies.

        ``w`` may have fewer rows, for loops that repeat every so many: so has the difference then.
        """
        half = _turned(w / 2)
        turned = half if self.samples == 1 else half**self.samples
        times = max(self.period.size // max(len(w), 1), 1)
        every = np.split(np.arange(self.period.size), times)
        inverse = [self.take(part)._inverse(half) for part in every]
        return np.concatenate(inverse), self.take(every[0])._difference(w, turned)

    def _inverse(self, half: ComplexArray) -> ComplexArray:
        """Return F at frequencies of which ``half`` is exp(j w/2)."""
        moved = 2j * half.imag * half  # z - 1, without cancellation
        poles = self.chains.moved_poles
        found = -moved * half ** (2 * self.whole + 2)
        for i in range(poles.shape[1]):
            found *= moved - poles[:, i, None]
        numerator = self.chains.numerator
        below = np.repeat(numerator[:, -1, None].astype(np.complex128), moved.shape[1], axis=1)
        for i in range(numerator.shape[1] - 2, -1, -1):
            below *= moved
            below += numerator[:, i, None]
        found /= below
        return found

    def _difference(self, w: FloatArray, turned: ComplexArray) -> ComplexArray:
        """Return D at the frequencies ``w``, where ``turned`` is exp(j N w/2)."""
        scale = 2j / (self.samples * self.period[:, None])
        found: ComplexArray = scale * turned.imag * turned.conj()
        return found if self.velocity_filter is None else found * self.velocity_filter.response(w)


def _turned(angle: FloatArray) -> ComplexArray:
    """Return exp(j angle): of real angles in half the time of ``numpy.exp``."""
    found = np.empty(angle.shape, dtype=np.complex128)
    found.real, found.imag = np.cos(angle), np.sin(angle)
    return found


@dataclass(frozen=True, slots=True)
class Crossings:
    """Stiffnesses at which poles cross the unit circle, in rising order; loops × crossings."""

    stiffness: FloatArray
    """[N·m/rad]; infinite where there are fewer crossings than columns"""
    w: FloatArray
    """[rad/sample]"""
    poles: IntArray
    """Poles that leave the circle as the stiffness rises through the crossing: 1 or 2, or -1, -2"""


def crossings(loops: Loops, virtual_damping: FloatArray) -> Crossings:
    """Return the crossings of stiffnesses above 0, at each loop's virtual damping [N·m·s/rad]."""
    parts = _Polynomials.of(loops)
    torque, wall = times(parts.torque_odd, parts.filter_size), parts.wall_odd
    more = parts.late - loops.samples
    if more >= 0:
        wall = times(wall, circle(more))
    else:
        torque = times(torque, circle(-more))
    scale = (loops.samples * loops.period)[:, None]
    whole = plus(-scale * torque, -virtual_damping[:, None] * times(wall, parts.size))

    def left(some: Loops, index: IntArray, w: FloatArray) -> ComplexArray:
        inverse, difference = some.responses(w)
        found: ComplexArray = inverse - virtual_damping[index, None] * difference
        return found

    return Crossings(*_ordered(loops, whole, left))


def unstable_softest(loops: Loops, found: Crossings) -> IntArray:
    """Return how many poles lie outside of the unit circle with a stiffness just above 0.

    They are those of an infinite stiffness, less those that leave on the way to it. With an
    infinite stiffness poles are at the zeros of the chain, and one for each held torque far away.
    The count is right if ``found`` has every crossing.
    """
    far: IntArray = (
        loops.whole + 1 + right_roots(in_s(loops.chains.numerator)) - found.poles.sum(axis=1)
    )
    return far


_Left = Callable[[Loops, IntArray, FloatArray], ComplexArray]
"""Of loops, their indices and frequencies: what is real at a crossing, and rises with its gain"""


def _ordered(
    loops: Loops, polynomials: FloatArray, left: _Left
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Return gains above 0, frequencies and leaving poles of all crossings, in rising order.

    Args:
        loops: The loops.
        polynomials: Their roots in tan²(w/2) are the crossings below pi; loops × rising powers.
        left: The function.
    """
    count = len(polynomials)
    roots = positive_roots(polynomials)
    row, w, value, rises = _refined(loops, roots.row, 2.0 * np.arctan(np.sqrt(roots.at)), left)
    every = np.arange(count)
    end = np.full(count, np.pi)
    with np.errstate(divide="ignore", invalid="ignore"):
        last = left(loops, every, end[:, None])[:, 0]
        before = left(loops, every, (end - 1e-6)[:, None])[:, 0]
    row, w = np.concatenate([row, every]), np.concatenate([w, end])
    gain = np.concatenate([value, last.real])
    poles = np.concatenate([np.where(rises, 2, -2), np.where(before.imag < 0, 1, -1)])
    kept = np.isfinite(gain) & (gain > 0)
    # at pi all is real, unless the difference is 0 there and only its rounding is left
    kept[len(value) :] &= np.abs(last.imag) <= _REAL * np.abs(last.real)
    row, w, gain, poles = row[kept], w[kept], gain[kept], poles[kept]
    order = np.lexsort((gain, row))
    row, w, gain, poles = row[order], w[order], gain[order], poles[order]
    of_each = np.bincount(row, minlength=count)
    column = np.arange(row.size) - np.repeat(np.cumsum(of_each) - of_each, of_each)
    shape = count, max(int(of_each.max(initial=0)), 1)
    gains, frequencies, leaving = np.full(shape, np.inf), np.ones(shape), np.zeros(shape, int)
    gains[row, column], frequencies[row, column], leaving[row, column] = gain, w, poles
    return gains, frequencies, leaving


def _refined(
    loops: Loops, row: IntArray, w: FloatArray, left: _Left
) -> tuple[IntArray, FloatArray, FloatArray, NDArray[np.bool_]]:
    """Return the rows, frequencies, values and rises of crossings, by Newton's method.

    Those that it does not find are left out.
    """
    start, at = w, w.copy()
    value, rises = np.full(w.size, np.nan), np.zeros(w.size, dtype=np.bool_)
    left_over = np.arange(w.size)
    some = loops.take(row)
    for _ in range(_ROUNDS):
        now = at[left_over, None] * np.array([1.0, 1.0 + _STEP])
        with np.errstate(divide="ignore", invalid="ignore"):
            here = left(some, row[left_over], now)
            slope = (here[:, 1] - here[:, 0]) / (now[:, 1] - now[:, 0])
            step = -here[:, 0].imag / slope.imag
        step = np.nan_to_num(step, posinf=0.0, neginf=0.0)
        step = np.clip(step, -0.05 * now[:, 0], 0.05 * now[:, 0])
        at[left_over] = np.clip(now[:, 0] + step, 1e-12, np.pi)
        done = np.abs(step) <= _FINE * now[:, 0]
        index = left_over[done]
        value[index] = (here[done, 0] + slope[done] * step[done]).real
        rises[index] = slope[done].imag > 0
        left_over = left_over[~done]
        if left_over.size == 0:
            break
        some = some.take(np.flatnonzero(~done))
    found = np.isfinite(value) & (np.abs(at - start) <= 0.2 * start)
    return row[found], at[found], value[found], rises[found]


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


def poles(loops: Loops, stiffness: FloatArray, virtual_damping: FloatArray) -> ComplexArray:
    """Return the closed-loop poles, loops × poles; arguments as of ``unstable_poles``."""
    chains, samples, filtered = loops.chains, loops.samples, loops.velocity_filter
    count, order = chains.old.shape
    torques = loops.whole + 1
    past = order + torques + samples
    size = past if filtered is None else past + 2
    a = np.zeros((count, size, size))
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
    a[:, :order, order + torques - 1] += chains.old
    if loops.whole:
        a[:, :order, order + torques - 2] += chains.new
    else:
        a[:, :order] += chains.new[:, :, None] * command[:, None]
    a[:, order] = command
    shifted = np.arange(order + 1, order + torques)
    a[:, shifted, shifted - 1] = 1.0
    a[:, order + torques, order - 1] = 1.0
    shifted = np.arange(order + torques + 1, past)
    a[:, shifted, shifted - 1] = 1.0
    return np.linalg.eigvals(a).astype(np.complex128)


def damping_crossings(loops: Loops) -> tuple[FloatArray, IntArray]:
    """Return the virtual dampings above 0 at which poles cross the circle without any stiffness.

    Returns:
        (damping, poles): loops × crossings in rising order, the dampings infinite where there are
        fewer [N·m·s/rad]; the poles that leave as the damping rises, negative: that come back.
    """
    parts = _Polynomials.of(loops)
    # F / D is real: Im(F conj D) = 0, with conj D ~ (1 - s)^N - (1 + s)^N over (1 - s)^N
    n = loops.samples
    back = (power(-1, n) - power(1, n))[1:]  # without its factor s
    both = times(parts.torque, times(back[None], power(1, n)[None]))
    if loops.velocity_filter is not None:  # its numerator is real
        both = times(both, loops.velocity_filter.denominator[None])

    def left(some: Loops, _: IntArray, w: FloatArray) -> ComplexArray:
        inverse, difference = some.responses(w)
        found: ComplexArray = inverse / difference
        return found

    damping, _, leaving = _ordered(loops, even(both), left)
    return damping, leaving


@dataclass(frozen=True, slots=True)
class _Polynomials:
    """F = -torque / ((1 + v)^late size) and Im D = wall_odd / ..., v = tan²(w/2) = -s²."""

    torque: FloatArray
    """Coefficients of rising powers of s, loops × powers"""
    torque_odd: FloatArray
    """Its imaginary part over tan(w/2), rising powers of v"""
    wall_odd: FloatArray
    """Rising powers of v"""
    filter_size: FloatArray
    """Square of the modulus of the filter's denominator, rising powers of v"""
    size: FloatArray
    """Square of the numerator's modulus, rising powers of v"""
    late: int

    @classmethod
    def of(cls, loops: Loops) -> _Polynomials:
        chains, late = loops.chains, loops.whole + 1
        numerator = in_s(chains.numerator)
        mirrored = numerator * (-1.0) ** np.arange(numerator.shape[1])
        pole = np.zeros((len(numerator), 2), dtype=np.complex128)
        pole[:, 1] = 2.0  # the position's
        for i in range(chains.moved_poles.shape[1]):
            mu = chains.moved_poles[:, i]
            pole = times(pole, np.stack([-mu, 2.0 + mu], axis=1))
        torque = times(times(pole.real, mirrored), power(1, 2 * late)[None])
        wall = power(1, 2 * loops.samples)[None]
        filter_size = np.ones((1, 1))
        if loops.velocity_filter is not None:
            below = loops.velocity_filter.denominator[None]
            below_mirrored = below * np.array([1.0, -1.0, 1.0])
            # D ~ (1 - s²)^N - (1 - s)^2N, and -(1 - s)^2N has the odd part of (1 + s)^2N
            ends = np.zeros((1, 2 * loops.samples + 1))
            ends[:, ::2] = (power(-1, loops.samples))[None]
            wall = ends - power(-1, 2 * loops.samples)[None]
            wall = times(wall, times(loops.velocity_filter.numerator[None], below_mirrored))
            filter_size = even(times(below, below_mirrored))
        return cls(
            torque=torque,
            torque_odd=odd(torque),
            wall_odd=odd(wall),
            filter_size=filter_size,
            size=even(times(numerator, mirrored)),
            late=late,
        )
