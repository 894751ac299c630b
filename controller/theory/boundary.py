"""Solves the exact stability boundary of the sampled loop, in closed form for every delay.

On the unit circle ``z = exp(j w)`` the characteristic equation is linear in the stiffness and the
virtual damping (dimensionless ``alpha`` and ``beta``)::

    alpha + beta D(w) = F(w),    F = -1 / G_d(z),    D = (1 - z^-N) / N

so that ``beta(w) = Im F / Im D`` and ``alpha(w) = Re F - beta(w) Re D`` give the whole boundary
(D-decomposition). The wall is stable from ``alpha = 0`` to the lowest crossing at its ``beta``. No
stiffness is stable outside ``-delta < beta < beta_max``; at ``beta_max`` the lowest crossing
reaches zero.

The principal solver (``first_branch``) handles one-sample differences with light damping. The full
solver (``all_branches``) handles everything else.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.theory import all_branches, first_branch
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.controller.theory.loop import HeldLoop
from haptic_wall.controller.theory.roots import golden

__all__ = ["HeldLoop", "critical", "highest", "max_beta"]

# settings solved at once: the first fits the processor's cache, the second bounds the scan's memory
_LIGHT_CHUNK, _SCAN_CHUNK = 2048, 512
_AT_CEILING = 1e-9
_TINY = 1e-16
_PEAK_POINTS, _PEAK_STEPS = 17, 28  # to 2e-7 of the ceiling


def max_beta(delta: FloatArray, delay: FloatArray, samples: FloatArray) -> FloatArray:
    """Return the virtual damping above which no stiffness is stable; flat arrays.

    Args:
        delta: Dimensionless viscous damping b T / m.
        delay: Total delay in periods.
        samples: N of the velocity difference.
    """
    result = np.empty_like(delta)
    light = _light(delta, delay, samples)
    for part in _parts(light, _LIGHT_CHUNK):
        _, result[part] = first_branch.ceiling(_loop(delta[part], delay[part], samples[part]))
    for part in _parts(~light, _scan_chunk(samples)):
        loop = _loop(delta[part], delay[part], samples[part])
        result[part] = all_branches.ceiling(loop.column())
    return result


def critical(
    delta: FloatArray, beta: FloatArray, delay: FloatArray, samples: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the critical stiffness at ``beta``, and the frequency [rad/sample] there.

    Args:
        delta: Dimensionless viscous damping b T / m.
        beta: Dimensionless virtual damping B T / m.
        delay: Total delay in periods.
        samples: N of the velocity difference.

    Returns:
        (alpha, w); both 0 where no stiffness is stable.
    """
    alpha, w = np.zeros_like(beta), np.zeros_like(beta)
    some, light = beta > -delta, _light(delta, delay, samples)
    # with so little damping the linear condition is exact to rounding
    late = delay + samples
    tiny = some & ~light & ((delta + np.abs(beta)) * late * late < _TINY)
    alpha[tiny] = (delta[tiny] + beta[tiny]) / (delay[tiny] + 0.5)
    w[tiny] = np.sqrt(alpha[tiny])
    for part in _parts(some & light, _LIGHT_CHUNK):
        loop = _loop(delta[part], delay[part], samples[part])
        w_max, top = first_branch.ceiling(loop)
        below = beta[part] < top
        a, at = first_branch.crossing(loop, np.where(below, beta[part], 0.0), w_max, top)
        alpha[part] = np.where(below, np.maximum(a, 0.0), 0.0)
        w[part] = np.where(below, at, 0.0)
    rest = np.flatnonzero(some & ~light & ~tiny)
    if rest.size:
        top = max_beta(delta[rest], delay[rest], samples[rest])
        alpha[rest], w[rest] = _scanned(delta[rest], beta[rest], delay[rest], samples[rest], top)
    return alpha, w


def _scanned(
    delta: FloatArray, beta: FloatArray, delay: FloatArray, samples: FloatArray, top: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Do the same with every branch, below the ceiling ``top`` and above -delta."""
    alpha, w = np.zeros_like(beta), np.zeros_like(beta)
    # this near the ceiling the lowest crossing can round to below zero and be missed
    for part in _parts((beta > -delta) & (beta < top * (1.0 - _AT_CEILING)), _scan_chunk(samples)):
        loop = HeldLoop.of(delta[part], delay[part], samples[part]).column()
        alpha[part], w[part] = all_branches.crossing(loop, beta[part])
    return alpha, w


def highest(
    delta: FloatArray, delay: FloatArray, samples: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the highest critical stiffness over all virtual dampings as (alpha, beta, w), flat.

    Args:
        delta: Dimensionless viscous damping b T / m.
        delay: Total delay in periods.
        samples: N of the velocity difference.
    """
    alpha, beta, w = np.empty_like(delta), np.empty_like(delta), np.empty_like(delta)
    light = _light(delta, delay, samples)
    for part in _parts(light, _LIGHT_CHUNK):
        loop = _loop(delta[part], delay[part], samples[part])
        w_max, _ = first_branch.ceiling(loop)
        alpha[part], beta[part], w[part] = first_branch.summit(loop, w_max)
    rest = np.flatnonzero(~light)
    if rest.size:
        beta[rest] = _searched(delta[rest], delay[rest], samples[rest])
        alpha[rest], w[rest] = critical(delta[rest], beta[rest], delay[rest], samples[rest])
    return alpha, beta, w


def _searched(delta: FloatArray, delay: FloatArray, samples: FloatArray) -> FloatArray:
    """Find the virtual damping of the highest critical stiffness, by narrowing a bracket."""
    low, high = -delta, max_beta(delta, delay, samples)
    ceiling, rows = high, np.arange(low.size)

    def found(beta: FloatArray) -> FloatArray:
        each = (np.repeat(a, beta.shape[1]) for a in (delta, delay, samples, ceiling))
        d, late, n, top = each
        return _scanned(d, beta.ravel(), late, n, top)[0].reshape(beta.shape)

    beta = low[:, None] + (high - low)[:, None] * np.linspace(0.0, 1.0, _PEAK_POINTS)
    best = np.argmax(found(beta), axis=1)
    low = beta[rows, np.maximum(best - 1, 0)]
    high = beta[rows, np.minimum(best + 1, _PEAK_POINTS - 1)]
    return golden(found, low[:, None], high[:, None], _PEAK_STEPS)[:, 0]


def _light(delta: FloatArray, delay: FloatArray, samples: FloatArray) -> NDArray[np.bool_]:
    light: NDArray[np.bool_] = (
        (samples == 1)
        & (delta <= first_branch.LIGHT)
        & (delta * (delay + 1.0) <= first_branch.SHORT)
    )
    return light


def _parts(which: NDArray[np.bool_], size: int) -> Iterator[NDArray[np.intp]]:
    """Yield the indices of the selected settings, in parts of at most ``size``."""
    index = np.flatnonzero(which)
    for start in range(0, index.size, size):
        yield index[start : start + size]


def _scan_chunk(samples: FloatArray) -> int:
    """Return how many settings to scan at once: longer differences need more points each."""
    return max(1, int(_SCAN_CHUNK / (1.0 + np.max(samples, initial=1.0) / 16.0)))


def _loop(delta: FloatArray, delay: FloatArray, samples: FloatArray) -> HeldLoop:
    """Return the loop; many settings of one plant share one."""
    arrays: list[NDArray[Any]] = [delta, delay, samples]
    if all(np.all(a == a[0]) for a in arrays):
        arrays = [a[:1] for a in arrays]
    return HeldLoop.of(*arrays)
