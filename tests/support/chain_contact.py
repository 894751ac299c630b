"""Simulates contacts of a chain of masses with a one-sided wall, and returns the exit speed.

The chain flies in rigidly, untwisted and without torque. The wall fills the positions above 0; its
torque at a sample inside is ``max(0, K x + B v)`` outwards, with v the difference of positions,
those before the contact included. The law is homogeneous, so the entry speed is 1. The exit speed
includes the vibration: it is that of a rigid chain of the same energy.
"""

from __future__ import annotations

import numpy as np

from haptic_wall.controller.theory.chain import Chain, sampled
from haptic_wall.controller.theory.checks import FloatArray

_SHARES = np.linspace(0.05, 1.0, 20)
"""Stiffnesses that are tried first, as shares of the exact limit"""
_FINER, _ROUNDS = 8, 2
"""Stiffnesses between two of them, and how often"""
_PHASES = np.array([1e-9, 0.5, 0.9, 0.97, 1.0])
_LITTLE = 1e-6
"""Torque of the current loop that no longer counts, as a fraction of the greatest"""


def one_sided_limits(
    chain: Chain,
    period: float,
    delay: float,
    exact: FloatArray,
    virtual_damping: FloatArray,
    velocity_samples: int = 1,
) -> FloatArray:
    """Return the stiffness up to which a one-sided wall gives no contact more energy than it had.

    It is the first, from 0 on, at which one of five phases of entry returns more; found to about
    a thousandth of the exact limit.

    Args:
        chain: The servo: one chain.
        period: T [s].
        delay: t_d, from the sample to its torque acting, without the current loop's lag [s].
        exact: The exact limit at each virtual damping [N·m/rad]; where it is 0 so is the result.
        virtual_damping: B of each wall [N·m·s/rad], shape (n,).
        velocity_samples: N of the velocity difference, >= 1.
    """
    low, high = np.zeros(exact.size), np.ones(exact.size)
    shares = np.broadcast_to(_SHARES, (exact.size, _SHARES.size))
    walls = np.flatnonzero(exact > 0)
    if not walls.size:
        return np.zeros(exact.size)
    for _ in range(1 + _ROUNDS):
        tried = shares[walls]
        spread = (walls.size, tried.shape[1], _PHASES.size)
        stiffness = np.broadcast_to((exact[walls, None] * tried)[..., None], spread).ravel()
        damping = np.broadcast_to(virtual_damping[walls, None, None], spread).ravel()
        phase = np.broadcast_to(_PHASES, spread).ravel()
        every = chain.take(np.zeros(stiffness.size, dtype=np.int64))
        # a contact that takes longer than an undamped oscillation creeps, and returns nothing
        slowest = float(np.sqrt(np.sum(chain.inertias[0]) / np.min(stiffness)))
        longest = int((2 * np.pi * slowest + delay) / period) + 100
        ratio = returned(every, period, delay, stiffness, damping, phase, velocity_samples, longest)
        throws = np.any(ratio.reshape(spread) > 1.0, axis=2)
        first = np.where(throws.any(axis=1), np.argmax(throws, axis=1), tried.shape[1])
        rows = np.arange(walls.size)
        at = np.minimum(first, tried.shape[1] - 1)
        high[walls] = np.where(first < tried.shape[1], tried[rows, at], high[walls])
        low[walls] = np.where(first > 0, tried[rows, np.maximum(first - 1, 0)], low[walls])
        between = np.linspace(0.0, 1.0, _FINER + 2)[1:-1]
        shares = low[:, None] + (high - low)[:, None] * between
    return np.where(exact > 0, low * exact, 0.0)


def returned(
    chain: Chain,
    period: float,
    delay: float,
    stiffness: FloatArray,
    virtual_damping: FloatArray,
    phase: FloatArray,
    velocity_samples: int = 1,
    longest: int = 20_000,
) -> FloatArray:
    """Return exit over entry speed of each contact.

    Args:
        chain: One chain for each contact.
        period: T [s].
        delay: t_d, from the sample to its torque acting, without the current loop's lag [s].
        stiffness: K of each contact [N·m/rad].
        virtual_damping: B of each contact [N·m·s/rad].
        phase: Phase from the entry to the first sample inside of each contact [periods], 0 to 1.
        velocity_samples: N of the velocity difference, >= 1.
        longest: Contacts of more samples are given up.

    Returns:
        The ratios; NaN where the contact lasts longer.
    """
    late = delay / period
    whole = int(np.floor(late))
    count = len(chain.inertias)
    each = np.full(count, period)
    plant = sampled(chain, each, np.full(count, late - whole))
    transition = plant.step + np.eye(plant.old.shape[1])
    state, history = _flown_in(chain, each, phase, velocity_samples)
    commands = np.zeros((count, whole + 2))
    greatest, most = np.zeros(count), np.zeros(count)
    outside_for = np.zeros(count, dtype=np.int64)
    for k in range(longest):
        y = state[:, -1]
        inside = (y > 0) | (k == 0)
        speed = (y - history[:, -velocity_samples]) / (velocity_samples * period)
        torque = np.where(inside, np.maximum(stiffness * y + virtual_damping * speed, 0.0), 0.0)
        greatest = np.maximum(greatest, torque)
        history = np.concatenate([history[:, 1:], y[:, None]], axis=1)
        commands = np.concatenate([commands[:, 1:], torque[:, None]], axis=1)
        outside_for = np.where(inside, 0, outside_for + 1)
        most = np.where(inside, 0.0, np.maximum(most, _energy(chain, state)))
        over = outside_for > whole + 1
        if chain.bandwidth is not None:
            over &= np.abs(state[:, -2]) <= _LITTLE * greatest
        if over.all():
            break
        state = (
            np.einsum("cij,cj->ci", transition, state)
            - plant.new * commands[:, 1, None]
            - plant.old * commands[:, 0, None]
        )
    entry = 0.5 * np.sum(chain.inertias, axis=1)
    ratio: FloatArray = np.where(over, np.sqrt(most / entry), np.nan)
    return ratio


def _flown_in(
    chain: Chain, period: FloatArray, phase: FloatArray, velocity_samples: int
) -> tuple[FloatArray, FloatArray]:
    """Return the states at the first sample inside, and the N positions before it."""
    from scipy.linalg import expm

    a, _, c = chain.matrices()
    count, size, _ = a.shape
    rates = np.zeros((count, size + 1, size + 1))
    rates[:, :size, :size], rates[:, size, :size] = a, c
    if chain.bandwidth is not None:
        rates[:, size - 1] = 0.0  # no torque; looked at backwards it would have been huge
    start = np.zeros((count, size + 1))
    start[:, : chain.inertias.shape[1]] = 1.0

    def after(time: FloatArray) -> FloatArray:
        found: FloatArray = np.einsum("cij,cj->ci", expm(rates * time[:, None, None]), start)
        return found

    before = [after((phase - back) * period)[:, -1] for back in range(velocity_samples, 0, -1)]
    return after(phase * period), np.stack(before, axis=1)


def _energy(chain: Chain, state: FloatArray) -> FloatArray:
    """Return kinetic energy and that of the twists [J]."""
    masses = chain.inertias.shape[1]
    moving = 0.5 * np.sum(chain.inertias * state[:, :masses] ** 2, axis=1)
    twists = state[:, masses : masses + chain.stiffnesses.shape[1]]
    found: FloatArray = moving + 0.5 * np.sum(chain.stiffnesses * twists**2, axis=1)
    return found
