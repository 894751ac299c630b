"""Critical stiffness by simulation: the stiffness above which the motion after a kick grows.

A wall's motion is watched for a number of its oscillations; whether it grows is told by the sign
of the fitted growth of its turning points, so that nobody has to wait for it. All walls are
searched at once: many stiffnesses of each are simulated side by side, and the interval between
the stiffest that shrinks and the softest that grows is divided again.
"""

from __future__ import annotations


import numpy as np
from numpy.typing import ArrayLike, NDArray

from controller.experiments.many_walls import Loops, Walls, blocks, split_delay
from controller.experiments.turning import Turnings
from controller.theory import critical_stiffness
from controller.theory.checks import FloatArray, broadcast, not_negative, number, positive, samples

Mask = NDArray[np.bool_]

_CYCLES = 30.0
_LEAST_PERIODS = 4000
_SEGMENT = 256
_DECIDED = 3.0
"""A motion that has grown or shrunk by this factor is not watched any longer."""
_LANES = 16
_FIRST = np.geomspace(0.23, 4.7, 24)


def simulated_critical_stiffness(
    inertia: ArrayLike,
    damping: ArrayLike,
    virtual_damping: ArrayLike,
    period: ArrayLike,
    delay: ArrayLike,
    *,
    coulomb: ArrayLike = 0.0,
    position_step: ArrayLike = 0.0,
    backlash: ArrayLike = 0.0,
    torque_limit: ArrayLike = np.inf,
    velocity_samples: ArrayLike = 1,
    kick: ArrayLike = 0.01,
    tolerance: float = 1e-4,
) -> FloatArray:
    """Stiffness above which the simulated motion after a kick grows; two-sided walls.

    The servo is released at rest, ``kick`` from the wall, where it has been for long: it starts at
    a turning point with v = 0, and the velocity estimate sees no jump.

    Args:
        inertia: m > 0 [kg·m²].
        damping: Viscous friction b >= 0 [N·m·s/rad].
        virtual_damping: B [N·m·s/rad].
        period: T > 0 [s].
        delay: t_d >= 0, from the sample to its torque acting [s].
        coulomb: Coulomb friction c >= 0 [N·m].
        position_step: Encoder count q >= 0 [rad]; 0: not quantised.
        backlash: Play between shaft and encoder, full width, >= 0 [rad].
        torque_limit: [N·m], > 0, may be infinite.
        velocity_samples: N of the velocity difference, >= 1.
        kick: Displacement at the start, > 0 [rad].
        tolerance: Wanted relative accuracy.

    Returns:
        Stiffness [N·m/rad] in the broadcast shape.

    Raises:
        ValueError: An argument is outside of its domain; the message names it.
    """
    arrays = broadcast(
        inertia=positive("inertia", inertia),
        damping=not_negative("damping", damping),
        virtual_damping=number("virtual_damping", virtual_damping),
        period=positive("period", period),
        delay=not_negative("delay", delay),
        coulomb=not_negative("coulomb", coulomb),
        position_step=not_negative("position_step", position_step),
        backlash=not_negative("backlash", backlash),
        torque_limit=np.asarray(torque_limit, dtype=np.float64),
        velocity_samples=samples("velocity_samples", velocity_samples),
        kick=positive("kick", kick),
    )
    shape = arrays[0].shape
    m, b, big_b, t, t_d, c, q, play, limit, n, amplitude = (a.ravel() for a in arrays)
    whole, lag, rest = split_delay(t_d, t)
    walls = Walls(
        inertia=m,
        damping=b,
        coulomb=c,
        counts_per_radian=np.where(q > 0.0, 1.0 / np.where(q > 0.0, q, 1.0), 0.0),
        backlash=play,
        torque_limit=limit,
        torque_step=np.zeros_like(m),
        stiffness=np.zeros_like(m),
        virtual_damping=big_b,
        period=t,
        whole=whole,
        lag=lag,
        rest=rest,
        velocity_samples=n.astype(np.int64),
        one_sided=np.zeros(m.size, dtype=np.bool_),
    )
    result: FloatArray = search(walls, amplitude, tolerance).reshape(shape)[()]
    return result


def search(walls: Walls, kick: FloatArray, tolerance: float) -> FloatArray:
    scale = critical_stiffness(
        walls.inertia,
        walls.damping,
        walls.virtual_damping,
        walls.period,
        walls.whole * walls.period + walls.lag,
        walls.velocity_samples,
    )
    ladder = scale[:, None] * _FIRST
    low, high = _between(walls, kick, ladder)
    while np.max(high / low) > 1 + tolerance:
        share = np.arange(1, _LANES + 1) / (_LANES + 1)
        ladder = low[:, None] * (high / low)[:, None] ** share
        a, b = _between(walls, kick, ladder)
        low, high = np.where(a > 0, a, low), np.where(np.isfinite(b), b, high)
    return np.sqrt(low * high)


def _between(walls: Walls, kick: FloatArray, ladder: FloatArray) -> tuple[FloatArray, FloatArray]:
    lanes = ladder.shape[1]
    grown = grows(walls.with_stiffness(ladder), np.repeat(kick, lanes)).reshape(ladder.shape)
    first = np.where(grown.any(axis=1), np.argmax(grown, axis=1), lanes)
    padded = np.column_stack([np.zeros(kick.size), ladder, np.full(kick.size, np.inf)])
    rows = np.arange(kick.size)
    return padded[rows, first], padded[rows, first + 1]


def grows(walls: Walls, kick: FloatArray) -> Mask:
    result = np.zeros(walls.size, dtype=np.bool_)
    with np.errstate(over="ignore", invalid="ignore"):
        for index in blocks(walls):
            result[index] = _grows(walls.take(index), kick[index])
    return result


def _grows(walls: Walls, kick: FloatArray) -> Mask:
    loops = Loops(walls, kick)
    watcher = Turnings(loops, walls.period)
    cycle = 2.0 * np.pi * np.sqrt(walls.inertia / walls.stiffness) / walls.period
    most = int(np.max(np.maximum(_CYCLES * cycle, _LEAST_PERIODS)))
    while loops.k < most:
        loops.run(_SEGMENT, watcher.watch)
        watcher.gather()
        up = watcher.greatest > _DECIDED * kick
        down = watcher.least < kick / _DECIDED
        if np.all(up | down):
            break
    slope = watcher.slope()
    return np.where(up, True, np.where(down, False, slope > 0.0))
