"""The exact stability boundary of the sampled loop, in closed form for every delay.

On the unit circle ``z = exp(j w)`` the characteristic equation is linear in the stiffness and the
virtual damping (dimensionless ``alpha`` and ``beta``)::

    alpha + beta D(w) = F(w),    F = -1 / G_d(z),    D = (1 - z^-N) / N

so that ``beta(w) = Im F / Im D`` and ``alpha(w) = Re F - beta(w) Re D`` give the whole boundary
(D-decomposition). ``G_d`` is the pulse transfer of the plant with a held torque that acts ``d``
periods late; a fraction of a period splits the hold (modified z-transform).

The wall is stable from ``alpha = 0`` to the lowest crossing at its ``beta``, and no stiffness is
stable outside of ``-delta < beta < beta_max``, where the lowest crossing has come down to zero.
For one-sample differences and light damping that is the first branch of the curve; with long
differences or heavy damping another one, or a real pole at ``z = -1``, can be the lowest, so all
the crossings on the first turns of ``F`` are looked at.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from controller.theory.checks import FloatArray
from controller.theory.response import held_response

ComplexArray = NDArray[np.complex128]

_CROSSINGS = 4  # per setting; more never held the lowest one in 10^4 random settings
_BISECTIONS, _STEPS = 12, 26  # false position converges in five or six, once it is near
_CHUNK = 1024  # settings scanned at once, to bound the memory


@dataclass(frozen=True, slots=True)
class HeldLoop:
    """The loop without its wall: plant, hold, delay and velocity difference, for flat settings.

    Every field is a column (settings × 1), so that frequencies go along the second axis.
    """

    delta: FloatArray
    delay: FloatArray
    samples: FloatArray
    whole: FloatArray
    """Whole periods of the delay"""
    phi: FloatArray
    """Position per unit speed after one period"""
    new: tuple[FloatArray, FloatArray]
    """Numerator terms (of z - eps, and constant) of the torque of ``whole`` periods ago"""
    old: tuple[FloatArray, FloatArray]
    """The same of the torque before it, which acts during the fraction of the delay"""

    @classmethod
    def of(cls, delta: FloatArray, delay: FloatArray, samples: FloatArray) -> HeldLoop:
        """The loop for flat arrays of delta, d and N."""
        delta, delay, samples = delta[:, None], delay[:, None], samples[:, None]
        whole = np.floor(delay)
        full = held_response(delta, 1.0)
        late = held_response(delta, 1.0 - (delay - whole))
        phi = full.position_per_speed
        new = late.position_per_torque, phi * late.position_per_speed
        old = full.position_per_torque - new[0], phi * phi - new[1]
        return cls(delta, delay, samples, whole, phi, new, old)

    def inverse_plant(self, w: FloatArray) -> ComplexArray:
        """F(w) = -1 / G_d(exp(j w)), G_d from the torque commanded to the position."""
        z_1 = 2j * np.sin(w / 2) * np.exp(0.5j * w)  # z - 1, without cancellation
        z_eps = z_1 + self.delta * self.phi  # z - exp(-delta)
        new = self.new[0] * z_eps + self.new[1]
        old = self.old[0] * z_eps + self.old[1]
        result: ComplexArray = (
            -z_1 * z_eps * np.exp(1j * w * self.whole) / (new + old * np.exp(-1j * w))
        )
        return result

    def difference(self, w: FloatArray) -> ComplexArray:
        """D(w) = (1 - exp(-j N w)) / N."""
        half = self.samples * w / 2
        result: ComplexArray = 2j * np.sin(half) * np.exp(-1j * half) / self.samples
        return result


def max_beta(delta: FloatArray, delay: FloatArray, samples: FloatArray) -> FloatArray:
    """Virtual damping above which no stiffness, however small, is stable; flat arrays.

    Args:
        delta: Dimensionless viscous damping b T / m.
        delay: Total delay in periods.
        samples: N of the velocity difference.
    """
    result = np.empty_like(delta)
    for part in _parts(delta.size):
        result[part] = _max_beta(HeldLoop.of(delta[part], delay[part], samples[part]))
    return result


def critical(
    delta: FloatArray, beta: FloatArray, delay: FloatArray, samples: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Critical stiffness at ``beta``, and the frequency [rad/sample] of the oscillation there.

    Args:
        delta: Dimensionless viscous damping b T / m.
        beta: Dimensionless virtual damping B T / m.
        delay: Total delay in periods.
        samples: N of the velocity difference.

    Returns:
        (alpha, w); both 0 where no stiffness is stable.
    """
    alpha, w = np.empty_like(delta), np.empty_like(delta)
    for part in _parts(delta.size):
        loop = HeldLoop.of(delta[part], delay[part], samples[part])
        alpha[part], w[part] = _critical(loop, beta[part])
    return alpha, w


def _parts(size: int) -> list[slice]:
    return [slice(start, start + _CHUNK) for start in range(0, size, _CHUNK)]


def _max_beta(loop: HeldLoop) -> FloatArray:
    # alpha = 0 where F is parallel to D
    w, found = _crossings(
        loop, lambda w: np.imag(loop.inverse_plant(w) * np.conj(loop.difference(w)))
    )
    f, d = loop.inverse_plant(w), loop.difference(w)
    # a zero of D itself (w = 2 pi / N) is no crossing; it gives a huge beta, never the least
    beta = np.real(f * np.conj(d)) / np.maximum(np.abs(d) ** 2, np.finfo(np.float64).tiny)
    constant, reach = _real_pole(loop)
    by_real = np.where(reach > 0, constant / np.where(reach > 0, reach, 1.0), np.inf)
    by_curve: FloatArray = np.min(np.where(found & (beta > 0), beta, np.inf), axis=1)
    return np.minimum(by_curve, by_real)


def _critical(loop: HeldLoop, beta: FloatArray) -> tuple[FloatArray, FloatArray]:
    column = beta[:, None]
    w, found = _crossings(
        loop, lambda w: loop.inverse_plant(w).imag - column * loop.difference(w).imag
    )
    alpha = loop.inverse_plant(w).real - column * loop.difference(w).real
    constant, reach = _real_pole(loop)
    alpha = np.column_stack([np.where(found, alpha, np.inf), constant - reach * beta])
    w = np.column_stack([w, np.full_like(beta, np.pi)])
    alpha = np.where(alpha > 0, alpha, np.inf)
    rows, lowest = np.arange(beta.size), np.argmin(alpha, axis=1)
    least = alpha[rows, lowest]
    stable = (beta > -loop.delta[:, 0]) & (beta < _max_beta(loop)) & np.isfinite(least)
    return np.where(stable, least, 0.0), np.where(stable, w[rows, lowest], 0.0)


def _real_pole(loop: HeldLoop) -> tuple[FloatArray, FloatArray]:
    """The line ``alpha + reach beta = constant`` on which a pole is at z = -1.

    Returns:
        (constant, reach); constant is inf where the line is on the side of negative stiffness.
    """
    n = loop.samples[:, 0]
    reach = np.where(n % 2 == 1, 2.0 / n, 0.0)
    constant = loop.inverse_plant(np.full_like(loop.delta, np.pi))[:, 0].real
    return np.where(constant > 0, constant, np.inf), reach


def _crossings(
    loop: HeldLoop, function: Callable[[FloatArray], FloatArray]
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """The first zeros of ``function`` over 0 < w < pi, which is negative at w = 0+.

    Returns:
        (w, found), both settings × _CROSSINGS; w means nothing where not found.
    """
    # two turns of the delayed plant, at eight points or more per turn of the difference
    span = np.minimum(np.pi, 4 * np.pi / (loop.delay + 1))
    steps = 96 + 4 * int(np.max(loop.samples))
    grid = span * np.linspace(0.0, 1.0, steps + 1)
    above = function(grid[:, 1:]) > 0
    before = np.column_stack([np.zeros(span.size, dtype=np.bool_), above[:, :-1]])
    # stable sort: the crossings first, in order of frequency
    cell = np.argsort(above == before, axis=1, kind="stable")[:, :_CROSSINGS]
    rows = np.arange(span.size)[:, None]
    found = above[rows, cell] != before[rows, cell]
    return _refined(function, grid[rows, cell], grid[rows, cell + 1], before[rows, cell]), found


def _refined(
    function: Callable[[FloatArray], FloatArray],
    low: FloatArray,
    high: FloatArray,
    falling: NDArray[np.bool_],
) -> FloatArray:
    """The zeros between ``low`` and ``high``: bisection, then the Illinois form of false position.

    Where the zero is in the first cell the function may vanish at ``low`` = 0 too; there it is
    bisected until ``low`` has left 0.
    """
    sign = np.where(falling, -1.0, 1.0)
    at_low, at_high = np.zeros_like(low), np.zeros_like(low)
    last = np.zeros_like(low)  # which end moved last: -1 low, 1 high
    point = low
    for step in range(_STEPS):
        point = 0.5 * (low + high)
        if step > _BISECTIONS:
            slope = at_high - at_low
            usable = (low > 0) & (slope > 0)
            cut = low - at_low * (high - low) / np.where(usable, slope, 1.0)
            point = np.where(usable, np.clip(cut, low, high), point)
        value = sign * function(point)
        beyond = value > 0
        moved = np.where(beyond, 1.0, -1.0)
        again = moved == last
        at_low = np.where(beyond, np.where(again, 0.5 * at_low, at_low), value)
        at_high = np.where(beyond, value, np.where(again, 0.5 * at_high, at_high))
        low, high = np.where(beyond, low, point), np.where(beyond, point, high)
        last = moved
    return point
