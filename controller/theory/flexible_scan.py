"""Computes limits on many two-mass servos at once, on a frequency grid: quick, accurate to 2 %.

As ``crossings``, but between points of a coarser grid and without refining. The servos of a belief
and one delay take milliseconds.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from haptic_wall.controller.theory.chain import Sampled, sampled, two_masses
from haptic_wall.controller.theory.checks import ComplexArray, FloatArray
from haptic_wall.controller.theory.crossings import Loops
from haptic_wall.controller.theory.velocity_filter import VelocityFilter

_FEW, _EVEN = 64, 80
"""Frequencies of the grid: in equal ratios, and in equal steps. A coarser one gives lower limits"""
_FLANK = np.geomspace(1e-5, 0.4, 80)
_ABOUT = np.concatenate([1.0 - _FLANK, 1.0 + _FLANK])
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
    """Two-mass servos of one period, delay and number of velocity samples."""

    def __init__(self, parts: _Parts, ceiling: FloatArray, floor: FloatArray) -> None:
        self._parts, self._ceiling, self._floor = parts, ceiling, floor

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
        times = np.full(math.prod(shape), period)
        fraction = np.broadcast_to(late - np.floor(late), shape).ravel()
        chains = sampled(chain, times, fraction)
        whole = np.floor(np.broadcast_to(late, shape).ravel()).astype(np.int64)
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
            chains, times = _single(chains), times.astype(np.float32)
            w = np.minimum(w.astype(np.float32), _BELOW_PI)
        parts = _Parts.of(*Loops(chains, times, whole, samples, velocity_filter).responses(w))
        ceiling, floor = parts.dampings()
        return [cls(parts.take(own), ceiling[own], floor[own]) for own in spans]

    def ceilings(self) -> FloatArray:
        """Return the virtual damping above which no stiffness from 0 on is stable [N·m·s/rad]."""
        return self._ceiling

    def limits(self, virtual_damping: FloatArray | float) -> FloatArray:
        """Return the stiffness up to which every stiffness from 0 on is stable [N·m/rad].

        Args:
            virtual_damping: Virtual damping of all, or of each servo [N·m·s/rad].
        """
        big_b = np.broadcast_to(virtual_damping, self._ceiling.shape)
        stable = (big_b < self._ceiling) & (big_b > self._floor)
        return np.where(stable, self._parts.stiffness(big_b), 0.0)


class _Parts(NamedTuple):
    """Real and imaginary parts of F and D; dampings × servos × frequencies."""

    f_real: FloatArray
    f_imag: FloatArray
    d_real: FloatArray
    d_imag: FloatArray

    @classmethod
    def of(cls, f: ComplexArray, d: ComplexArray) -> _Parts:
        """Return the parts; the rows of F are servos, then the same with other dampings."""
        parts = (np.ascontiguousarray(each) for each in (f.real, f.imag, d.real, d.imag))
        return cls(*(each.reshape(-1, *d.shape) for each in parts))

    def take(self, servos: slice) -> _Parts:
        """Return the parts of some servos."""
        return _Parts(*(each[:, servos] for each in self))

    def dampings(self) -> tuple[FloatArray, FloatArray]:
        """Return the least ceiling and the greatest floor of the virtual damping."""
        square = self.d_real**2 + self.d_imag**2
        real = (self.f_real * self.d_real + self.f_imag * self.d_imag) / square
        imaginary = (self.f_imag * self.d_real - self.f_real * self.d_imag) / square
        return _least(imaginary, real), -_least(imaginary, -real)

    def stiffness(self, virtual_damping: FloatArray) -> FloatArray:
        """Return the least stiffness at which a pole is on the unit circle."""
        big_b = virtual_damping[:, None].astype(self.f_real.dtype)
        return _least(self.f_imag - big_b * self.d_imag, self.f_real - big_b * self.d_real)


def _single(chains: Sampled) -> Sampled:
    """Return chains whose response is computed in single precision, in half the memory."""
    return replace(
        chains,
        moved_poles=chains.moved_poles.astype(np.complex64),
        numerator=chains.numerator.astype(np.float32),
    )


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
    return np.where(np.abs(found - w0) < 1e-7 * w0, (1.0 + 1e-6) * w0, found)


def _least(imaginary: FloatArray, real: FloatArray) -> FloatArray:
    """Return each servo's least positive real part where the imaginary part is 0, or infinity.

    F is affine in the servo's damping, nearly so where torques are held: so real and imaginary part
    are interpolated between dampings as they are between frequencies.
    """
    _, count, frequencies = real.shape
    last = real[..., -1]  # at pi all is real, but for a division by a difference of 0
    at_pi = (last > 0) & (np.abs(imaginary[..., -1]) < last)
    found: FloatArray = np.where(at_pi, last, np.inf).min(axis=0)
    real, imaginary = real.ravel(), imaginary.ravel()
    positive = imaginary > 0
    for step in (1, count * frequencies):
        at = np.flatnonzero(positive[:-step] != positive[step:])
        if step == 1:
            at = at[(at + 1) % frequencies != 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            share = imaginary[at] / (imaginary[at] - imaginary[at + step])
            value = real[at] + share * (real[at + step] - real[at])
        np.minimum.at(found, at // frequencies % count, np.where(value > 0, value, np.inf))
    return found
