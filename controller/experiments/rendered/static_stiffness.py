"""Measures a rendered spring's stiffness: an additional known torque pushes it slowly to and fro.

While the shaft creeps one way, the additional torque balances the spring and friction. The ways up
and down have the same slope and differ by twice the friction.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.experiments.holding import Hold
from haptic_wall.controller.laws.program import Phase
from haptic_wall.controller.theory.checks import FloatArray, IntArray
from haptic_wall.hw.servo import Outcome

FARTHEST = 0.3
"""Largest displacement of the spring [rad]."""
_COUNTS = 60
"""Wanted displacement to either side [encoder counts]"""
_FRICTION = 4.0
"""Wanted ratio of the push to friction"""
_SHARE = 0.5
"""Largest fraction of the torque limit"""
_HALF_S = 2.0
"""Time from the centre to one end of the push [s]"""
_RISES = 100
"""Number of small torque steps to one end"""
_CYCLES = 2
_SKIP = 0.3
"""Fraction of each way omitted after the reversal, where friction reverses"""
_BLOCKS = 6
"""Parts of each way with independent errors"""


@dataclass(frozen=True, slots=True)
class Push:
    """Spring and torque with which the stiffness is measured."""

    stiffness: float
    """[N·m/rad]"""
    damping: float
    """[N·m·s/rad]"""
    torque: float
    """To either side [N·m]"""


@dataclass(frozen=True, slots=True)
class StaticStiffness:
    """Stiffness that was measured."""

    stiffness: float
    """Commanded additional torque per displacement [N·m/rad]"""
    stiffness_stderr: float
    friction: float
    """Half the distance between the ways up and down [N·m of commanded torque]"""
    friction_stderr: float
    position: FloatArray
    """Position of the used samples, from their mean [rad]"""
    torque: FloatArray
    """Additional torque at these samples [N·m]"""
    upward: NDArray[np.bool_]


def plan_push(
    stiffness: float, damping: float, coulomb: float, torque_limit: float, step: float
) -> Push | None:
    """Return a push that shows the spring; None where friction would hide it.

    Args:
        stiffness: Commanded [N·m/rad].
        damping: Commanded [N·m·s/rad].
        coulomb: Highest believed friction [N·m of commanded torque].
        torque_limit: [N·m].
        step: Encoder step [rad].
    """
    wanted = max(_COUNTS * step * stiffness, _FRICTION * coulomb, 0.02 * stiffness)
    torque = min(wanted, _SHARE * torque_limit, FARTHEST * stiffness)
    if stiffness <= 0.0 or torque < 2.0 * coulomb:
        return None
    return Push(stiffness, damping, torque)


def push_phases(push: Push, hold: Hold, direction: float) -> list[Phase]:
    """Return the program: to the centre, then to and fro in small torque steps."""
    legs = [(0.0, 1.0), *[(1.0, -1.0), (-1.0, 1.0)] * _CYCLES]
    phases = [hold.phase(2.0, still_s=0.1)]
    for begin, end in legs:
        rises = round(_RISES * abs(end - begin))
        phases += [
            Phase(
                _HALF_S / _RISES,
                push.stiffness,
                push.damping,
                torque=direction * push.torque * (begin + (end - begin) * (i + 1) / rises),
            )
            for i in range(rises)
        ]
    return phases


def static_stiffness(
    rows: NDArray[np.void], phases: Sequence[Phase], push: Push, step: float
) -> StaticStiffness | None:
    """Fit the spring's stiffness to displacement and additional torque.

    Args:
        rows: Rows of the log, dtype ``telemetry.ROW``.
        phases: Phases of the program.
        push: The plan.
        step: Encoder step [rad].

    Returns:
        None where the displacement was below the encoder's resolution.
    """
    rows = rows[rows["outcome"] == Outcome.OK]
    number: IntArray = rows["phase"]
    beside: FloatArray = np.array([phase.torque for phase in phases])[number]
    parts = [_leg(i, beside, rows, push) for i in _legs(beside, push)]
    used = np.concatenate([part.index for part in parts])
    upward = np.concatenate([np.full(part.index.size, part.up) for part in parts])
    block = np.concatenate([part.block + _BLOCKS * i for i, part in enumerate(parts)])
    x, torque = rows["position"][used], beside[used]
    sign = np.where(upward, 1.0, -1.0)
    columns = np.stack([torque, sign, np.ones_like(torque)], axis=1)
    values = np.linalg.lstsq(columns, x, rcond=None)[0]
    if values[0] <= 0.0 or values[0] * push.torque < 2.0 * step:
        return None
    covariance = _clustered(columns, x - columns @ values, block)
    compliance = float(values[0])
    stiffness = 1.0 / compliance
    friction = -float(values[1]) * stiffness
    spread = math.sqrt(covariance[1, 1]) * stiffness
    # The start and the end of each way within a count are random, the same for all its blocks.
    ends = step / math.sqrt(12.0) / (np.ptp(torque) * compliance) / math.sqrt(len(parts))
    # With a quantised spring the shaft stops at the counts' edges: half a count is hidden by
    # friction.
    return StaticStiffness(
        stiffness,
        math.hypot(math.sqrt(covariance[0, 0]) * stiffness**2, float(ends) * stiffness),
        friction + 0.5 * push.stiffness * step,
        math.hypot(spread, 0.5 * push.stiffness * step / math.sqrt(3.0)),
        x - values[2],
        torque,
        upward,
    )


@dataclass(frozen=True, slots=True)
class _Leg:
    index: NDArray[np.int64]
    block: NDArray[np.int64]
    up: bool


def _legs(beside: FloatArray, push: Push) -> list[tuple[int, int]]:
    """Return the first and last row of each way from one end to the other."""
    ends = np.flatnonzero(np.abs(beside) > push.torque * (1.0 - 0.5 / _RISES))
    groups = np.split(ends, np.flatnonzero(np.diff(np.sign(beside[ends]))) + 1)
    return [(int(first[-1]), int(second[0])) for first, second in pairwise(groups)]


def _leg(ends: tuple[int, int], beside: FloatArray, rows: NDArray[np.void], push: Push) -> _Leg:
    """Return the rows of one way after the reversal, which ends when the shaft creeps again."""
    first, last = ends
    up = bool(beside[last] > beside[first])
    sign = 1.0 if up else -1.0
    begin = -push.torque + 2.0 * push.torque * _SKIP
    # Friction holds the shaft while the torque changes by twice its size: the way starts when the
    # shaft has moved by a tenth after the reversal.
    ahead = sign * rows["position"][first : last + 1]
    gone = first + int(np.argmax(ahead > ahead[0] + 0.1 * (ahead[-1] - ahead[0])))
    index = np.arange(first, last + 1)
    index = index[(sign * beside[first : last + 1] > begin) & (index > gone)]
    return _Leg(index, np.arange(index.size) * _BLOCKS // max(index.size, 1), up)


def _clustered(columns: FloatArray, rest: FloatArray, block: NDArray[np.int64]) -> FloatArray:
    """Return the covariance of a least-squares fit with errors correlated within blocks."""
    inverse = np.linalg.pinv(columns.T @ columns)
    meat = np.zeros((columns.shape[1], columns.shape[1]))
    blocks = np.unique(block)
    for number in blocks:
        gradient = columns[block == number].T @ rest[block == number]
        meat += np.outer(gradient, gradient)
    few = blocks.size / max(blocks.size - columns.shape[1], 1)
    found: FloatArray = few * (inverse @ meat @ inverse)
    return found
