"""Solves the exact stability boundary of a two-sided wall: on any chain of masses, and on one.

The stable stiffnesses at a virtual damping are in general several intervals. A limit is the end of
the one that begins at 0, and 0 where none begins there: to raise the stiffness from 0 to a limit
never crosses what is unstable.

All is solved by the crossings of a chain (``crossings``). One mass is a chain of one, in units of
its inertia and period, in which only four numbers count.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

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
from haptic_wall.controller.theory.roots import golden
from haptic_wall.controller.theory.velocity_filter import VelocityFilter

MOST_PERIODS = 10_000
"""Longest delay, in periods"""
_AT_ONCE = 400_000
"""Frequencies of all settings that are solved at once"""
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
    """Return the stiffness below which a two-sided wall is stable on a chain, and the frequency.

    Exact for linear masses, a held torque and any delay.

    Args:
        chain: The servos, as of ``one_mass`` or ``two_masses``.
        shape: That of the chain's parameters.
        virtual_damping: B [N·m·s/rad].
        period: T > 0 [s].
        delay: t_d >= 0, from the sample to its torque acting, without the current loop's lag [s].
        velocity_samples: N of the velocity difference, >= 1.
        velocity_filter: Filter of the velocity that damps; None: none.

    Returns:
        The boundary in the broadcast shape: the end of the stable interval that begins at 0.

    Raises:
        ValueError: An argument is outside of its domain; the message names it.
    """
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
        alpha, w = _unit_mass(s)
        stiffness, frequency = alpha * s.stiffness_unit, w / (2 * np.pi * t)
    else:
        stiffness, w = _solved(chain, rows, big_b, t, t_d, n, velocity_filter)
        frequency = w / (2 * np.pi * t)
    return CriticalPoint(*(x.reshape(given)[()] for x in (stiffness, big_b.copy(), frequency)))


def chain_ceiling(
    chain: Chain,
    shape: tuple[int, ...],
    period: ArrayLike,
    delay: ArrayLike,
    velocity_samples: ArrayLike = 1,
    velocity_filter: VelocityFilter | None = None,
) -> FloatArray:
    """Return the virtual damping up to which some stiffness from 0 on is stable on a chain.

    Arguments and errors are those of ``chain_boundary``.

    Returns:
        The end of the stable interval of B that begins at 0 [N·m·s/rad], in the broadcast shape.
    """
    given, (t, t_d, n) = _common(
        shape,
        period=positive("period", period),
        delay=not_negative("delay", delay),
        velocity_samples=samples("velocity_samples", velocity_samples),
    )
    rows = _rows(chain, given, shape)
    unit: FloatArray = np.ones_like(t)
    if _is_plain(chain, velocity_filter):
        s = _settings(chain, rows, np.zeros_like(t), t, t_d, n)
        chain, rows, unit = one_mass(1.0, s.delta)[0], np.arange(t.size), s.damping_unit
        t, t_d = np.ones_like(t), s.delay
    ceiling = np.zeros(t.size)
    for part, loops in _groups(chain, rows, t, t_d, n, velocity_filter):
        ceiling[part] = unit[part] * ceilings(loops)
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


def _unit_mass(s: Settings) -> tuple[FloatArray, FloatArray]:
    """Return the dimensionless critical stiffness of one mass, and its frequency [rad/sample]."""
    alpha, w = np.zeros_like(s.beta), np.zeros_like(s.beta)
    # with so little damping the linear condition is exact to rounding
    late = s.delay + s.samples
    tiny = (s.delta + np.abs(s.beta)) * late * late < _TINY
    some = np.flatnonzero((s.beta > -s.delta) & ~tiny)
    tiny &= s.beta > -s.delta
    alpha[tiny] = (s.delta + s.beta)[tiny] / (s.delay[tiny] + 0.5)
    w[tiny] = np.sqrt(alpha[tiny])
    chain, _ = one_mass(np.ones(some.size), s.delta[some])
    loop = (s.beta[some], np.ones(some.size), s.delay[some], s.samples[some])
    alpha[some], w[some] = _solved(chain, np.arange(some.size), *loop, None)
    return alpha, w


def _solved(
    chain: Chain,
    rows: IntArray,
    virtual_damping: FloatArray,
    period: FloatArray,
    delay: FloatArray,
    velocity_samples: FloatArray,
    velocity_filter: VelocityFilter | None,
) -> tuple[FloatArray, FloatArray]:
    """Return the critical stiffness of each setting, and the frequency there [rad/sample]."""
    stiffness, w = np.zeros(rows.size), np.zeros(rows.size)
    for part, loops in _groups(chain, rows, period, delay, velocity_samples, velocity_filter):
        stiffness[part], w[part] = _first_interval(loops, virtual_damping[part])
    return stiffness, w


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
    """Yield settings of similar delays and one number of samples, as indices and loops."""
    late = delay / period
    if np.any(late > MOST_PERIODS):
        raise ValueError(f"delay must be at most {MOST_PERIODS} periods, got {late.max():g}")
    whole = np.floor(late).astype(np.int64)
    similar = np.ceil(np.log2(whole + 1.0 + velocity_samples))  # the grid grows with it
    for d, n in sorted(set(zip(similar.tolist(), velocity_samples.tolist(), strict=True))):
        every = np.flatnonzero((similar == d) & (velocity_samples == n))
        size = max(1, int(_AT_ONCE / (200.0 + 12.0 * 2.0**d)))
        for start in range(0, every.size, size):
            part = every[start : start + size]
            servos = np.stack([rows[part], period[part], late[part] - whole[part]], axis=1)
            own, which = np.unique(servos, axis=0, return_inverse=True)
            chains = sampled(chain.take(own[:, 0].astype(np.int64)), own[:, 1], own[:, 2])
            chains = chains.take(which.ravel())
            yield part, Loops(chains, period[part], whole[part], int(n), velocity_filter)
