"""Measures a rendered spring's stiffness: an additional known torque pushes it slowly to and fro.

While the shaft creeps one way, the additional torque balances the spring and friction. The ways up
and down have the same slope and differ by twice the friction.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.experiments.holding import Hold
from haptic_wall.controller.experiments.identify.separable import Linear
from haptic_wall.controller.experiments.identify.standard_errors import standard_covariance
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
_CORRELATED_S = 0.5
"""Correlation time of the errors: the shaft creeps over a few counts [s]"""


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
    legs = [_leg(ends, beside, rows, push) for ends in _legs(beside, push)]
    weights = np.zeros((len(legs), max(leg.size for leg in legs)))
    x, torque = np.zeros_like(weights), np.zeros_like(weights)
    for at, leg in enumerate(legs):
        own = (at, slice(leg.size))
        weights[own], x[own], torque[own] = 1.0, rows["position"][leg], beside[leg]
    # Friction shifts each way: the mean of a way is its own.
    linear = Linear(-x, torque[None], weights[None], weights, np.zeros(1))
    compliance = float(linear.step()[0])
    if compliance <= 0.0 or compliance * push.torque < 2.0 * step:
        return None
    left = linear.without_own((compliance * torque - x)[None])[0]
    period = float(np.median(np.diff(rows["sampled_ns"]))) * 1e-9
    covariance = standard_covariance(replace(linear, left=left), period, _CORRELATED_S)
    stiffness = 1.0 / compliance
    used = np.concatenate(legs)
    # The start and the end of each way within a count are random, the same for all of it.
    swept = float(np.ptp(beside[used])) * compliance
    ends = step / math.sqrt(12.0 * len(legs)) / swept
    return StaticStiffness(
        stiffness,
        stiffness * math.hypot(math.sqrt(covariance[0, 0]) * stiffness, ends),
        rows["position"][used] - float(np.mean(rows["position"][used])),
        beside[used],
        np.concatenate([np.full(leg.size, beside[leg[-1]] > beside[leg[0]]) for leg in legs]),
    )


def _legs(beside: FloatArray, push: Push) -> list[tuple[int, int]]:
    """Return the first and last row of each way from one end to the other."""
    ends = np.flatnonzero(np.abs(beside) > push.torque * (1.0 - 0.5 / _RISES))
    groups = np.split(ends, np.flatnonzero(np.diff(np.sign(beside[ends]))) + 1)
    return [(int(first[-1]), int(second[0])) for first, second in pairwise(groups)]


def _leg(
    ends: tuple[int, int], beside: FloatArray, rows: NDArray[np.void], push: Push
) -> NDArray[np.int64]:
    """Return the rows of one way after the reversal, which ends when the shaft creeps again."""
    first, last = ends
    sign = 1.0 if beside[last] > beside[first] else -1.0
    begin = -push.torque + 2.0 * push.torque * _SKIP
    # Friction holds the shaft while the torque changes by twice its size: the way starts when the
    # shaft has moved by a tenth after the reversal.
    ahead = sign * rows["position"][first : last + 1]
    gone = first + int(np.argmax(ahead > ahead[0] + 0.1 * (ahead[-1] - ahead[0])))
    index = np.arange(first, last + 1)
    return index[(sign * beside[first : last + 1] > begin) & (index > gone)]
