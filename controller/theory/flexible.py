"""Computes the exact limits on a flexible servo: masses behind the motor, a lagging current loop.

The stable stiffnesses at a virtual damping are in general several intervals. A limit is the end of
the one that begins at 0, and 0 where none begins there: to raise the stiffness from 0 to a limit
never crosses what is unstable.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike

from haptic_wall.controller.theory.chain import Chain, sampled, two_masses
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
from haptic_wall.controller.theory.exact import CriticalPoint
from haptic_wall.controller.theory.velocity_filter import VelocityFilter

MOST_PERIODS = 30
"""Longest delay, in periods, and most samples of the velocity difference"""
_CHUNK = 2048


def flexible_boundary(
    inertia: ArrayLike,
    damping: ArrayLike,
    load_inertia: ArrayLike,
    transmission_stiffness: ArrayLike,
    transmission_damping: ArrayLike,
    virtual_damping: ArrayLike,
    period: ArrayLike,
    delay: ArrayLike,
    velocity_samples: ArrayLike = 1,
    *,
    encoder: str = "output",
    bandwidth: ArrayLike | None = None,
    velocity_filter: VelocityFilter | None = None,
) -> CriticalPoint:
    """Return the stiffness below which a two-sided wall is stable on two masses, and the frequency.

    Exact for linear masses, a held torque and any delay up to 30 periods.

    Args:
        inertia: Inertia of the motor's side, > 0 [kg·m²].
        damping: Viscous friction of the motor's side >= 0 [N·m·s/rad].
        load_inertia: Behind the transmission, > 0 [kg·m²].
        transmission_stiffness: > 0 [N·m/rad].
        transmission_damping: >= 0 [N·m·s/rad].
        virtual_damping: B [N·m·s/rad].
        period: T > 0 [s].
        delay: t_d >= 0, from the sample to its torque acting, without the current loop's lag [s].
        velocity_samples: N of the velocity difference, >= 1.
        encoder: The side that is measured: ``output`` or ``motor``.
        bandwidth: Bandwidth of the current loop, whose torque lags by the first order > 0 [Hz];
            None: none.
        velocity_filter: Filter of the velocity that damps; None: none.

    Returns:
        The boundary in the broadcast shape: the end of the stable interval that begins at 0.

    Raises:
        ValueError: An argument is outside of its domain; the message names it.
    """
    chain, shape = two_masses(
        inertia,
        damping,
        load_inertia,
        transmission_stiffness,
        transmission_damping,
        encoder=encoder,
        bandwidth=bandwidth,
    )
    return chain_boundary(
        chain, shape, virtual_damping, period, delay, velocity_samples, velocity_filter
    )


def flexible_ceiling(
    inertia: ArrayLike,
    damping: ArrayLike,
    load_inertia: ArrayLike,
    transmission_stiffness: ArrayLike,
    transmission_damping: ArrayLike,
    period: ArrayLike,
    delay: ArrayLike,
    velocity_samples: ArrayLike = 1,
    *,
    encoder: str = "output",
    bandwidth: ArrayLike | None = None,
    velocity_filter: VelocityFilter | None = None,
) -> FloatArray:
    """Return the virtual damping up to which some stiffness from 0 on is stable on two masses.

    Arguments and errors are those of ``flexible_boundary``.

    Returns:
        The end of the stable interval of B that begins at 0 [N·m·s/rad], in the broadcast shape.
    """
    chain, shape = two_masses(
        inertia,
        damping,
        load_inertia,
        transmission_stiffness,
        transmission_damping,
        encoder=encoder,
        bandwidth=bandwidth,
    )
    return chain_ceiling(chain, shape, period, delay, velocity_samples, velocity_filter)


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
    stiffness, frequency = np.zeros(big_b.size), np.zeros(big_b.size)
    for part, loops in _groups(chain, given, shape, t, t_d, n, velocity_filter):
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
    ceiling = np.zeros(t.size)
    for part, loops in _groups(chain, given, shape, t, t_d, n, velocity_filter):
        ceiling[part] = ceilings(loops)
    result: FloatArray = ceiling.reshape(given)[()]
    return result


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
    given: tuple[int, ...],
    shape: tuple[int, ...],
    period: FloatArray,
    delay: FloatArray,
    velocity_samples: FloatArray,
    velocity_filter: VelocityFilter | None,
) -> Iterator[tuple[IntArray, Loops]]:
    """Yield the settings of each whole delay and number of samples, as indices and loops."""
    late = delay / period
    if np.any(late > MOST_PERIODS):
        raise ValueError(f"delay must be at most {MOST_PERIODS} periods, got {late.max():g}")
    if np.any(velocity_samples > MOST_PERIODS):
        raise ValueError(
            f"velocity_samples must be at most {MOST_PERIODS}, got {velocity_samples.max():g}"
        )
    rows = np.broadcast_to(np.arange(chain.inertias.shape[0]).reshape(shape), given).ravel()
    whole = np.floor(late)
    for d, n in sorted(set(zip(whole.tolist(), velocity_samples.tolist(), strict=True))):
        every = np.flatnonzero((whole == d) & (velocity_samples == n))
        for start in range(0, every.size, _CHUNK):
            part = every[start : start + _CHUNK]
            servos = np.stack([rows[part], period[part], late[part] - d], axis=1)
            own, which = np.unique(servos, axis=0, return_inverse=True)
            chains = sampled(chain.take(own[:, 0].astype(np.int64)), own[:, 1], own[:, 2])
            chains = chains.take(which.ravel())
            yield part, Loops(chains, period[part], int(d), int(n), velocity_filter)
