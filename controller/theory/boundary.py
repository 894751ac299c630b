"""Solves the exact stability boundary of a two-sided wall: on any chain of masses, and on one.

The stable stiffnesses at a virtual damping are in general several intervals. A limit is the end of
the one that begins at 0, and 0 where none begins there: to raise the stiffness from 0 to a limit
never crosses what is unstable.

One mass with light damping and a difference of one sample is solved on its first branch, in a tenth
of the time (``first_branch``); everything else by all crossings of its chain (``crossings``).
One mass is solved in units of its inertia and period, in which only four numbers count.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from haptic_wall.controller.theory import first_branch
from haptic_wall.controller.theory.chain import Chain, one_mass, sampled
from haptic_wall.controller.theory.checks import (
    FloatArray,
    IntArray,
    broadcast,
    not_negative,
    number,
    positive,
    samples,
)
from haptic_wall.controller.theory.crossings import (
    Loops,
    ceilings,
    first_crossing,
    unstable_poles,
    unstable_softest,
)
from haptic_wall.controller.theory.dimensionless import Settings, settings
from haptic_wall.controller.theory.loop import HeldLoop
from haptic_wall.controller.theory.roots import golden
from haptic_wall.controller.theory.velocity_filter import VelocityFilter

MOST_PERIODS = 10_000
"""Longest delay, in periods"""
_AT_ONCE = 400_000
"""Frequencies of all settings that are solved at once"""
_LIGHT_CHUNK = 2048
_TINY = 1e-16
_PEAK_POINTS, _PEAK_STEPS = 17, 28  # to 2e-7 of the ceiling


@dataclass(frozen=True, slots=True)
class CriticalPoint:
    """A point on the stability boundary of a two-sided wall; arrays of one shape."""

    stiffness: FloatArray
    """[N·m/rad]; 0 where no stiffness is stable"""
    virtual_damping: FloatArray
    """[N·m·s/rad]"""
    frequency: FloatArray
    """Frequency of the oscillation there [Hz]; 0 where no stiffness is stable"""


def chain_boundary(
    chain: Chain,
    shape: tuple[int, ...],
    virtual_damping: ArrayLike,
    period: ArrayLike,
    delay: ArrayLike,
    velocity_samples: ArrayLike = 1,
    velocity_filter: VelocityFilter | None = None,
) -> CriticalPoint:
    """Return ``flexible_boundary`` of any chain; ``shape`` is that of its parameters."""
    given, (big_b, t, t_d, n) = _common(
        shape,
        virtual_damping=number("virtual_damping", virtual_damping),
        period=positive("period", period),
        delay=not_negative("delay", delay),
        velocity_samples=samples("velocity_samples", velocity_samples),
    )
    rows = _rows(chain, given, shape)
    if _is_plain(chain, velocity_filter):
        s = _settings(chain, rows, big_b, t, t_d, n)
        alpha, w = _critical(s.delta, s.beta, s.delay, s.samples)
        stiffness, frequency = alpha * s.stiffness_unit, w / (2 * np.pi * t)
    else:
        stiffness, frequency = np.zeros(big_b.size), np.zeros(big_b.size)
        for part, loops in _groups(chain, rows, t, t_d, n, velocity_filter):
            first, w = _first_interval(loops, big_b[part])
            stiffness[part], frequency[part] = first, w / (2 * np.pi * t[part])
    return CriticalPoint(*(x.reshape(given)[()] for x in (stiffness, big_b.copy(), frequency)))


def chain_ceiling(
    chain: Chain,
    shape: tuple[int, ...],
    period: ArrayLike,
    delay: ArrayLike,
    velocity_samples: ArrayLike = 1,
    velocity_filter: VelocityFilter | None = None,
) -> FloatArray:
    """Return ``flexible_ceiling`` of any chain; ``shape`` is that of its parameters."""
    given, (t, t_d, n) = _common(
        shape,
        period=positive("period", period),
        delay=not_negative("delay", delay),
        velocity_samples=samples("velocity_samples", velocity_samples),
    )
    rows = _rows(chain, given, shape)
    if _is_plain(chain, velocity_filter):
        s = _settings(chain, rows, np.zeros_like(t), t, t_d, n)
        ceiling = _ceiling(s.delta, s.delay, s.samples) * s.damping_unit
    else:
        ceiling = np.zeros(t.size)
        for part, loops in _groups(chain, rows, t, t_d, n, velocity_filter):
            ceiling[part] = ceilings(loops)
    result: FloatArray = ceiling.reshape(given)[()]
    return result


def chain_peak(
    chain: Chain,
    period: ArrayLike,
    delay: ArrayLike,
    velocity_samples: ArrayLike = 1,
    velocity_filter: VelocityFilter | None = None,
) -> CriticalPoint:
    """Return the highest critical stiffness of each chain over all virtual dampings; flat arrays.

    Arguments and errors are those of ``chain_boundary``, one loop for each chain.
    """
    rows = np.arange(len(chain.inertias))
    shape = (rows.size,)
    loop = (period, delay, velocity_samples)
    t, t_d, n = (np.broadcast_to(each, shape)[:, None] for each in loop)

    def found(big_b: FloatArray) -> CriticalPoint:
        return chain_boundary(chain, (rows.size, 1), big_b, t, t_d, n, velocity_filter)

    low = -chain.dampings.sum(axis=1)
    high = chain_ceiling(chain, shape, *loop, velocity_filter)
    tried = low[:, None] + (high - low)[:, None] * np.linspace(0.0, 1.0, _PEAK_POINTS)
    best = np.argmax(found(tried).stiffness, axis=1)
    low = tried[rows, np.maximum(best - 1, 0)]
    high = tried[rows, np.minimum(best + 1, _PEAK_POINTS - 1)]
    at = golden(lambda b: found(b).stiffness, low[:, None], high[:, None], _PEAK_STEPS)
    top = found(at)
    return CriticalPoint(top.stiffness[:, 0], at[:, 0], top.frequency[:, 0])


def _rows(chain: Chain, given: tuple[int, ...], shape: tuple[int, ...]) -> IntArray:
    """Return the index of the chain of each setting."""
    every = np.arange(chain.inertias.shape[0]).reshape(shape)
    return np.broadcast_to(every, given).ravel()


def _is_plain(chain: Chain, velocity_filter: VelocityFilter | None) -> bool:
    """Whether the chains are one mass whose torque follows at once, and no velocity is filtered."""
    return chain.inertias.shape[1] == 1 and chain.bandwidth is None and velocity_filter is None


def _settings(
    chain: Chain,
    rows: IntArray,
    virtual_damping: FloatArray,
    period: FloatArray,
    delay: FloatArray,
    velocity_samples: FloatArray,
) -> Settings:
    mass, damping = chain.inertias[rows, 0], chain.dampings[rows, 0]
    return settings(mass, damping, virtual_damping, period, delay, velocity_samples)


def _first_interval(loops: Loops, virtual_damping: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the end of the stable stiffnesses that begin at 0, and the frequency there."""
    found = first_crossing(loops, virtual_damping)
    bounded = np.isfinite(found.gain)
    stable = unstable_softest(loops, found) == 0
    doubtful = np.flatnonzero(~stable)
    if doubtful.size:
        some, big_b = loops.take(doubtful), virtual_damping[doubtful]
        inside = np.where(bounded, 0.5 * found.gain, 1.0)[doubtful]
        stable[doubtful] = unstable_poles(some, inside, big_b) == 0
    return np.where(stable, found.gain, 0.0), np.where(stable & bounded, found.w, 0.0)


def _common(
    shape: tuple[int, ...], **arrays: FloatArray
) -> tuple[tuple[int, ...], list[FloatArray]]:
    found = broadcast(chain=np.zeros(shape), **arrays)
    return found[0].shape, [np.ravel(array) for array in found[1:]]


def _groups(
    chain: Chain,
    rows: IntArray,
    period: FloatArray,
    delay: FloatArray,
    velocity_samples: FloatArray,
    velocity_filter: VelocityFilter | None,
) -> Iterator[tuple[IntArray, Loops]]:
    """Yield the settings of each whole delay and number of samples, as indices and loops."""
    late = delay / period
    if np.any(late > MOST_PERIODS):
        raise ValueError(f"delay must be at most {MOST_PERIODS} periods, got {late.max():g}")
    whole = np.floor(late)
    for d, n in sorted(set(zip(whole.tolist(), velocity_samples.tolist(), strict=True))):
        every = np.flatnonzero((whole == d) & (velocity_samples == n))
        size = max(1, int(_AT_ONCE / (200.0 + 12.0 * (d + n))))
        for start in range(0, every.size, size):
            part = every[start : start + size]
            servos = np.stack([rows[part], period[part], late[part] - d], axis=1)
            own, which = np.unique(servos, axis=0, return_inverse=True)
            chains = sampled(chain.take(own[:, 0].astype(np.int64)), own[:, 1], own[:, 2])
            chains = chains.take(which.ravel())
            yield part, Loops(chains, period[part], int(d), int(n), velocity_filter)


def _ceiling(delta: FloatArray, delay: FloatArray, samples: FloatArray) -> FloatArray:
    """Return the dimensionless ceiling of one mass; flat arrays."""
    found = np.empty_like(delta)
    light = first_branch.holds(delta, delay, samples)
    for part in _parts(light):
        _, found[part] = first_branch.ceiling(_loop(delta[part], delay[part], samples[part]))
    for part, loops in _unit_masses(~light, delta, delay, samples):
        found[part] = ceilings(loops)
    return found


def _critical(
    delta: FloatArray, beta: FloatArray, delay: FloatArray, samples: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the critical stiffness of one mass, and the frequency [rad/sample] there; flat arrays.

    Args:
        delta: Dimensionless viscous damping b T / m.
        beta: Dimensionless virtual damping B T / m.
        delay: Total delay in periods.
        samples: N of the velocity difference.

    Returns:
        (alpha, w); both 0 where no stiffness is stable.
    """
    alpha, w = np.zeros_like(beta), np.zeros_like(beta)
    some, light = beta > -delta, first_branch.holds(delta, delay, samples)
    for part in _parts(some & light):
        loop = _loop(delta[part], delay[part], samples[part])
        w_max, top = first_branch.ceiling(loop)
        below = beta[part] < top
        a, at = first_branch.crossing(loop, np.where(below, beta[part], 0.0), w_max, top)
        alpha[part] = np.where(below, np.maximum(a, 0.0), 0.0)
        w[part] = np.where(below, at, 0.0)
    # with so little damping the linear condition is exact to rounding
    late = delay + samples
    tiny = some & ~light & ((delta + np.abs(beta)) * late * late < _TINY)
    alpha[tiny] = (delta + beta)[tiny] / (delay[tiny] + 0.5)
    w[tiny] = np.sqrt(alpha[tiny])
    for part, loops in _unit_masses(some & ~light & ~tiny, delta, delay, samples):
        alpha[part], w[part] = _first_interval(loops, beta[part])
    return alpha, w


def _unit_masses(
    which: NDArray[np.bool_], delta: FloatArray, delay: FloatArray, samples: FloatArray
) -> Iterator[tuple[IntArray, Loops]]:
    """Yield the selected settings as loops of unit inertia and period, with their indices."""
    index = np.flatnonzero(which)
    if index.size:
        chain, _ = one_mass(np.ones(index.size), delta[index])
        rows, one = np.arange(index.size), np.ones(index.size)
        for part, loops in _groups(chain, rows, one, delay[index], samples[index], None):
            yield index[part], loops


def _parts(which: NDArray[np.bool_]) -> Iterator[IntArray]:
    """Yield the indices of the selected settings, in parts that fit the processor's cache."""
    index = np.flatnonzero(which)
    for start in range(0, index.size, _LIGHT_CHUNK):
        yield index[start : start + _LIGHT_CHUNK]


def _loop(delta: FloatArray, delay: FloatArray, samples: FloatArray) -> HeldLoop:
    """Return the loop; many settings of one plant share one."""
    arrays = [delta, delay, samples]
    if all(np.all(a == a[0]) for a in arrays):
        arrays = [a[:1] for a in arrays]
    return HeldLoop.of(*arrays)
