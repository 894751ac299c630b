"""Independent answers that the theory is held against; nothing here uses ``haptic_wall``.

The loop is written as a state matrix in SI units: position, speed, the torques still to act, and
the positions that the velocity difference looks back at. Motion over a held torque comes from the
matrix exponential.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

Array = NDArray[np.float64]


class Loop(NamedTuple):
    """A device, and the wall on it."""

    inertia: float
    damping: float
    stiffness: float
    virtual_damping: float
    period: float
    delay: float
    samples: int = 1
    hand_stiffness: float = 0.0

    @staticmethod
    def of(row: Iterable[float], samples: float) -> Loop:
        """A loop of the numbers in a row of an array, from the inertia to the delay."""
        m, b, k, virtual, period, delay = map(float, row)
        return Loop(m, b, k, virtual, period, delay, int(samples))


def held(loop: Loop, time: float) -> tuple[Array, Array]:
    """Transition of (position, speed) over ``time``, and what a unit of held torque adds."""
    return _held(loop.inertia, loop.damping, loop.hand_stiffness, time)


@lru_cache(maxsize=4096)
def _held(inertia: float, damping: float, spring: float, time: float) -> tuple[Array, Array]:
    a = np.zeros((3, 3))
    a[0, 1] = 1.0
    a[1] = [-spring / inertia, -damping / inertia, 1 / inertia]
    e = expm(a * time)
    return e[:2, :2], e[:2, 2]


def state_matrix(loop: Loop) -> Array:
    """One period of the two-sided loop."""
    late = loop.delay / loop.period
    whole = int(np.floor(late))
    fraction = late - whole
    first, first_torque = held(loop, fraction * loop.period)
    rest, rest_torque = held(loop, (1 - fraction) * loop.period)
    torques = whole + 1  # commanded in the periods before, the latest first
    size = 2 + torques + loop.samples
    a = np.zeros((size, size))
    command = np.zeros(size)
    command[0] = -loop.stiffness - loop.virtual_damping / (loop.samples * loop.period)
    command[-1] = loop.virtual_damping / (loop.samples * loop.period)

    def commanded(periods_ago: int) -> Array:
        if periods_ago == 0:
            return command
        unit = np.zeros(size)
        unit[1 + periods_ago] = 1.0
        return unit

    a[:2, :2] = rest @ first
    a[:2] += np.outer(rest @ first_torque, commanded(whole + 1))
    a[:2] += np.outer(rest_torque, commanded(whole))
    a[2] = command
    for i in range(1, torques):
        a[2 + i, 1 + i] = 1.0
    a[2 + torques, 0] = 1.0
    for i in range(1, loop.samples):
        a[2 + torques + i, 1 + torques + i] = 1.0
    return a


def radius(loop: Loop) -> float:
    """Largest magnitude of a closed-loop pole; stable below 1."""
    return float(np.max(np.abs(np.linalg.eigvals(state_matrix(loop)))))


class LinkedLoop(NamedTuple):
    """One wall on two masses; the first numbers are those of ``two_masses``."""

    inertia: float
    damping: float
    load: float
    spring: float
    damper: float
    period: float
    late: float
    """Delay, in periods"""
    samples: int
    encoder: str
    bandwidth: float = 0.0
    """0: the torque follows at once"""


def linked_radius(
    loop: LinkedLoop,
    stiffness: float,
    virtual_damping: float,
    taps: Sequence[float] = (1.0, 0.0, 0.0, 0.0, 0.0),
) -> float:
    """Largest magnitude of a pole of a wall on two masses; stable below 1.

    One step is written out for all unit states: plant, torques on their way, past positions, and
    the last two inputs and outputs of the velocity's filter, whose taps are b0, b1, b2, a1, a2.
    """
    m, b, j, k, c, period, late, n, encoder, bandwidth = loop
    lag = 2 * np.pi * bandwidth
    rates = np.zeros((6, 6))  # positions and speeds, acting torque, commanded torque
    rates[0, 1] = rates[2, 3] = 1.0
    rates[1, :4] = np.array([-k, -(b + c), k, c]) / m
    rates[3, :4] = np.array([k, c, -k, -c]) / j
    rates[1, 4 if bandwidth else 5] = 1.0 / m
    rates[4, 4:] = -lag, lag
    whole = int(np.floor(late))
    first, rest = (expm(rates * period * part)[:5] for part in (late - whole, 1 - late + whole))
    seen = 2 if encoder == "output" else 0
    plant, torques, past, filtered = np.split(np.eye(10 + whole + n), [5, 6 + whole, 6 + whole + n])
    b0, b1, b2, a1, a2 = taps
    v1, v2, y1, y2 = filtered
    v = (plant[seen] - past[-1]) / (n * period)
    y = b0 * v + b1 * v1 + b2 * v2 - a1 * y1 - a2 * y2
    queue = np.vstack([-stiffness * plant[seen] - virtual_damping * y, torques])
    moved = first @ np.vstack([plant, queue[whole + 1]])
    moved = rest @ np.vstack([moved, queue[whole]])
    moved[4] *= bandwidth > 0.0  # without a lag no torque is stored
    step = np.vstack([moved, queue[:-1], plant[seen], past[:-1], v, v1, y, y1])
    return float(np.max(np.abs(np.linalg.eigvals(step))))


def bounce(loops: list[Loop], phases: Array) -> Array:
    """Exit over entry speed of a wall that never pulls, for each loop and phase.

    The device comes freely at unit speed to a wall that fills the positions above 0; ``phases``
    are the times from the entry to the first sample inside, in periods. Every period is split
    where the torque switches, and followed until no torque is left to act. The speed is looked at
    there only, so a device that leaves freely has lost up to b T / m of it since the wall.
    """
    late = np.array([loop.delay / loop.period for loop in loops])
    whole = np.floor(late).astype(int)
    split = [
        (held(loop, (x - n) * loop.period), held(loop, (1 - x + n) * loop.period))
        for loop, x, n in zip(loops, late, whole, strict=True)
    ]
    first, first_torque, rest, rest_torque = (
        np.array([pair[i][j] for pair in split]) for i in (0, 1) for j in (0, 1)
    )
    inertia, damping, k, big_b, period, samples = (
        np.array([getattr(loop, name) for loop in loops])[:, None]
        for name in ("inertia", "damping", "stiffness", "virtual_damping", "period", "samples")
    )
    rate = damping / inertia

    def free(time: Array) -> Array:
        return np.where(rate * period > 1e-9, -np.expm1(-rate * time) / rate, time)

    rows = np.arange(len(loops))
    at = phases[None, :] * period
    x, v = free(at), np.exp(-rate * at)
    positions = [free(at - back * period) for back in range(int(samples.max()), 0, -1)]
    torques = [np.zeros_like(x) for _ in range(int(whole.max()) + 2)]
    leaving = np.zeros_like(x)
    inside = np.ones_like(x, dtype=bool)
    for _ in range(200_000):
        positions.append(x)
        back = np.array(positions[-1 - int(samples.max()) :])[::-1]
        before = back[samples[:, 0].astype(int), rows]
        pushed = k * x + big_b * (x - before) / (samples * period)
        torques.append(-np.where(inside, np.maximum(pushed, 0), 0))
        recent = np.array(torques[-2 - int(whole.max()) :])[::-1]
        for motion, per_torque, torque in (
            (first, first_torque, recent[whole + 1, rows]),
            (rest, rest_torque, recent[whole, rows]),
        ):
            x, v = (
                motion[:, 0, :1] * x + motion[:, 0, 1:] * v + per_torque[:, :1] * torque,
                motion[:, 1, :1] * x + motion[:, 1, 1:] * v + per_torque[:, 1:] * torque,
            )
            leaving = np.where(x < 0, np.maximum(leaving, -v), leaving)
        inside = x > 0
        quiet = ~recent.any(axis=0) & ~inside
        # a device that creeps out keeps torque acting for ever, but has lost its speed for good
        impulse = np.abs(recent).sum(axis=0) * period / inertia
        slow = (v <= 0) & (v**2 + k / inertia * x**2 < 0.01) & (impulse < 0.1)
        if np.all(quiet | slow):
            return leaving
        positions, torques = positions[-1 - int(samples.max()) :], torques[-2 - int(whole.max()) :]
    raise AssertionError("a contact did not end")
