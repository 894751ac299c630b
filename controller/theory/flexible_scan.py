"""Computes limits on many two-mass servos at once, on a frequency grid: quick, accurate to 2 %.

As ``crossings``, but between points of a coarser grid and without refining. The servos of a belief
and one delay take milliseconds.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.theory.chain import transfer, two_masses
from haptic_wall.controller.theory.checks import ComplexArray, FloatArray, IntArray
from haptic_wall.controller.theory.crossings import difference, size, turned
from haptic_wall.controller.theory.velocity_filter import VelocityFilter

_FEW, _EVEN = 64, 80
"""Frequencies of the grid: in equal ratios, and in equal steps. A coarser one gives lower limits"""
_FLANK = np.geomspace(1e-5, 0.4, 80)
_ABOUT = np.concatenate([1.0 - _FLANK, [1.0], 1.0 + _FLANK])
"""Frequencies about a filter's, relative to it: on the flanks of a notch its phase turns"""
_SLOWEST = 1e-3
"""Least frequency of the grid, in periods of one delay and one sample [rad]; a slower resonance
lowers it"""
_MANY, _HARDLY = 32, 1e-3
"""Servos of one delay above which single precision halves the memory; damping ratio up to which it
may not show a vibration"""
_BELOW_PI = np.nextafter(np.float32(np.pi), np.float32(0.0))
"""In single precision: the sign of a difference may change at pi"""
_BESIDE = 18
"""Frequencies on either side of a resonance, from 0.4 of it to 0.3 of its damping ratio"""


class Servos(NamedTuple):
    """Two-mass servos of one delay; arrays of shape (n,)."""

    inertia: FloatArray
    """Of the motor's side [kg·m²]"""
    damping: FloatArray
    """Viscous friction of the motor's side [N·m·s/rad]. With the shape (ends, n) each limit is the
    least over the servo's dampings, those between one and the next included"""
    load_inertia: FloatArray
    transmission_stiffness: FloatArray
    transmission_damping: FloatArray
    delay: float
    """[s]"""


class FlexibleScan:
    """Two-mass servos of one period, delay and number of velocity samples.

    F is dampings × servos × frequencies, D servos × frequencies; each as real and imaginary part.
    """

    def __init__(self, f: _Parts, d: _Parts, by: FloatArray | None) -> None:
        self._f, self._d, self._by = f, d, by
        self._ceiling = self._dampings(1.0)

    def _dampings(self, sign: float) -> FloatArray:
        """Return the least size of a damping of this sign at which a pole is on the circle."""
        f, d, by = self._f, self._d, self._by

        def values(at: IntArray) -> tuple[FloatArray, FloatArray]:
            at_d = at % d.real.size
            (f_real, f_imag), (d_real, d_imag) = f.at(at), d.at(at_d)
            square = d_real**2 + d_imag**2
            real = (f_real * d_real + f_imag * d_imag) / square
            imag = (f_imag * d_real - f_real * d_imag) / square
            return sign * real, imag if by is None else imag * by.ravel()[at_d]

        positive = f.imag * d.real > f.real * d.imag
        if by is not None:  # where D goes through 0, F/D changes its sign, with no pole there
            positive ^= by < 0.0
        return _least(positive, values)

    @classmethod
    def of(
        cls,
        groups: Sequence[Servos],
        period: float,
        samples: int,
        encoder: str,
        velocity_filter: VelocityFilter | None = None,
    ) -> list[FlexibleScan]:
        """Return the scans of several groups, computed together: most have few servos.

        Args:
            groups: Servos of each delay; with the same number of dampings.
            period: T [s].
            samples: N of the velocity difference.
            encoder: The side that is measured: ``output`` or ``motor``.
            velocity_filter: Filter of the velocity that damps; None: none.
        """
        every = [np.concatenate([group[i] for group in groups], axis=-1) for i in range(5)]
        sizes = [group.inertia.size for group in groups]
        inertia, _, load_inertia, stiffness, transmission_damping = every
        chain, shape = two_masses(*every, encoder=encoder)
        late = np.repeat([group.delay / period for group in groups], sizes)
        whole = np.floor(late)
        fraction = np.broadcast_to(late - whole, shape).ravel()
        numerator, below = transfer(chain, np.full(math.prod(shape), period), fraction)
        with_both = np.sqrt(stiffness * (1.0 / inertia + 1.0 / load_inertia))
        near = np.stack([with_both, np.sqrt(stiffness / load_inertia)], axis=1)
        ratios = 0.5 * (transmission_damping / stiffness)[:, None] * near
        ends = np.cumsum([0, *sizes])
        spans = [slice(*pair) for pair in itertools.pairwise(ends.tolist())]
        w = np.concatenate(
            [
                _grid(near[own] * period, float(late[own][0]), velocity_filter, ratios[own])
                for own in spans
            ]
        )
        if velocity_filter is None and max(sizes) > _MANY and np.min(ratios) > _HARDLY:
            numerator, below = numerator.astype(np.float32), below.astype(np.float32)
            w = np.minimum(w.astype(np.float32), _BELOW_PI)
        half = turned(0.5 * w)
        late = turned((whole[:, None].astype(w.dtype) + 1.0) * w)
        f = _inverse(numerator, below, 2j * half.imag * half, late)
        d = _Parts.of(difference(w, half, samples, period, velocity_filter))
        by = None if velocity_filter is None else velocity_filter.above(w)
        if samples > 1:  # else only a filter makes D go through 0
            by = size(w, samples, velocity_filter)
        return [
            cls(f.of_servos(own), d.of_servos(own), None if by is None else by[own])
            for own in spans
        ]

    def ceilings(self) -> FloatArray:
        """Return the virtual damping above which no stiffness from 0 on is stable [N·m·s/rad]."""
        return self._ceiling

    def limits(self, virtual_damping: FloatArray | float) -> FloatArray:
        """Return the stiffness up to which every stiffness from 0 on is stable [N·m/rad].

        Args:
            virtual_damping: Virtual damping of all, or of each servo [N·m·s/rad].
        """
        f, d = self._f, self._d
        big_b = np.broadcast_to(virtual_damping, self._ceiling.shape)
        stable = big_b < self._ceiling
        if np.any(big_b < 0.0):
            stable &= big_b > -self._dampings(-1.0)
        big_b = big_b.astype(f.real.dtype)

        def values(at: IntArray) -> tuple[FloatArray, FloatArray]:
            at_d = at % d.real.size
            (f_real, f_imag), (d_real, d_imag) = f.at(at), d.at(at_d)
            own = big_b[at_d // d.real.shape[1]]
            return f_real - own * d_real, f_imag - own * d_imag

        return np.where(stable, _least(f.imag > big_b[:, None] * d.imag, values), 0.0)


class _Parts(NamedTuple):
    """Real and imaginary part of complex numbers."""

    real: FloatArray
    imag: FloatArray

    @classmethod
    def of(cls, values: ComplexArray) -> _Parts:
        """Return the parts of an array."""
        return cls(np.ascontiguousarray(values.real), np.ascontiguousarray(values.imag))

    def of_servos(self, servos: slice) -> _Parts:
        """Return the parts of some servos."""
        return _Parts(*(np.ascontiguousarray(each[..., servos, :]) for each in self))

    def at(self, index: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return the parts at flat indices."""
        return self.real.ravel()[index], self.imag.ravel()[index]


def _inverse(
    numerator: FloatArray, below: FloatArray, moved: ComplexArray, late: ComplexArray
) -> _Parts:
    """Return F = -1/G from the coefficients of ``transfer``, dampings × servos × frequencies.

    Args:
        numerator: Of the servos with one damping, then with the next; rows × coefficients.
        below: The same.
        moved: z - 1, servos × frequencies.
        late: z^(whole + 1).
    """
    rows = len(moved)
    shape = len(below) // rows, *moved.shape
    parts = _Parts(np.empty(shape, moved.real.dtype), np.empty(shape, moved.real.dtype))
    turned_back = -moved * late
    for i in range(shape[0]):
        own = slice(i * rows, (i + 1) * rows)
        found = _polynomial(below[own], moved)
        found *= turned_back
        found /= _polynomial(numerator[own], moved)
        parts.real[i], parts.imag[i] = found.real, found.imag
    return parts


def _polynomial(coefficients: FloatArray, x: ComplexArray) -> ComplexArray:
    """Return polynomials of rising powers, rows × coefficients, at x, rows × points."""
    found = coefficients[:, -1, None] * x
    for i in range(coefficients.shape[1] - 2, 0, -1):
        found += coefficients[:, i, None]
        found *= x
    found += coefficients[:, 0, None]
    return found


def _grid(
    resonances: FloatArray,
    late: float,
    velocity_filter: VelocityFilter | None,
    ratios: FloatArray,
) -> FloatArray:
    """Return rising frequencies up to pi, a row for each servo [rad]."""
    slowest = min(_SLOWEST / (1.0 + late), 0.5 * np.min(resonances, initial=_SLOWEST))
    common = np.concatenate([np.geomspace(slowest, np.pi, _FEW), np.linspace(0.05, np.pi, _EVEN)])
    beside = np.geomspace(0.4, np.clip(0.3 * ratios, 1e-5, 0.1), _BESIDE, axis=-1)
    about = np.concatenate([1.0 - beside, np.ones_like(beside[..., :1]), 1.0 + beside], axis=-1)
    near = (resonances[..., None] * about).reshape(len(resonances), -1)
    folded = np.abs((near + np.pi) % (2.0 * np.pi) - np.pi)
    if velocity_filter is not None:
        common = np.concatenate([common, np.minimum(velocity_filter.w0 * _ABOUT, np.pi)])
    rows = np.concatenate([np.tile(common, (len(near), 1)), folded], axis=1)
    found: FloatArray = np.sort(np.clip(rows, common[0], np.pi), axis=1)
    if velocity_filter is None:
        return found
    w0 = velocity_filter.w0  # at a notch itself no damping acts
    return np.where(np.abs(found - w0) < 1e-12 * w0, (1.0 + 1e-12) * w0, found)


def _least(
    positive: NDArray[np.bool_], values: Callable[[IntArray], tuple[FloatArray, FloatArray]]
) -> FloatArray:
    """Return each servo's least positive real part where the imaginary part is 0, or infinity.

    F is affine in the servo's damping, nearly so where torques are held: so real and imaginary part
    are interpolated between dampings as they are between frequencies.

    Args:
        positive: Whether the imaginary part is, dampings × servos × frequencies.
        values: Returns real and imaginary parts at flat indices.
    """
    dampings, count, frequencies = positive.shape
    ends = np.arange(1, dampings * count + 1) * frequencies - 1
    last, imaginary = values(ends)  # at pi all is real, but for a division by a difference of 0
    at_pi = (last > 0) & (np.abs(imaginary) < last)
    found: FloatArray = np.where(at_pi, last, np.inf).reshape(dampings, count).min(axis=0)
    positive = positive.ravel()
    for step in (1, count * frequencies):
        at = np.flatnonzero(positive[:-step] != positive[step:])
        if step == 1:
            at = at[(at + 1) % frequencies != 0]
        (real, imaginary), (real_after, imaginary_after) = values(at), values(at + step)
        with np.errstate(divide="ignore", invalid="ignore"):
            share = imaginary / (imaginary - imaginary_after)
            value = real + share * (real_after - real)
        np.minimum.at(found, at // frequencies % count, np.where(value > 0, value, np.inf))
    return found
