"""Records simulated walls after a kick: the controller's measurements and the true motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from haptic_wall.controller.experiments.maps.many_walls import Loops
from haptic_wall.controller.experiments.maps.walls import Walls, blocks
from haptic_wall.controller.theory.checks import FloatArray, IntArray

_TOGETHER = 80
"""Walls of similar frequency simulated together: the slowest sets the duration."""
_LOOK = 400
_FAR = 1e12
"""Counts beyond which a diverging motion is no longer followed."""
_MOST_PERIODS = 100_000


@dataclass(frozen=True, slots=True)
class Trace:
    """The record of one wall; arrays of one length."""

    counts: IntArray
    """The encoder's"""
    torque: FloatArray
    """Sent with each sample [N·m]"""
    position: FloatArray
    """True position of the shaft a period later [rad]"""


def kicked(walls: Walls, kick: FloatArray, cycles: float, until: float = np.inf) -> list[Trace]:
    """Release servos at rest, ``kick`` from the wall, and record them.

    Args:
        walls: Walls with an encoder and stiffness > 0.
        kick: > 0 [rad].
        cycles: Oscillations of the undamped spring to record.
        until: Amplitude in kicks (but at least 20 counts) at which the recording may end.
    """
    cycle = 2.0 * np.pi * np.sqrt(walls.inertia / walls.stiffness) / walls.period
    order = np.argsort(cycle)
    traces: dict[int, Trace] = {}
    for part in np.array_split(order, -(-walls.size // _TOGETHER)):
        some = walls.take(part)
        for index in blocks(some):
            who = part[index]
            length = int(min(cycles * cycle[who].max() + 500, _MOST_PERIODS))
            enough = np.maximum(until * kick[who], 20.0 / walls.counts_per_radian[who])
            recorded = _record(Loops(some.take(index), kick[who].copy()), length, enough)
            traces.update(zip(who.tolist(), recorded, strict=True))
    return [traces[i] for i in range(walls.size)]


def _record(loops: Loops, length: int, enough: FloatArray) -> list[Trace]:
    counts, torques, positions = [], [], []
    ends = np.full(enough.size, length)
    open_ = np.ones(enough.size, dtype=np.bool_)

    def watch() -> None:
        counts.append(loops.measured.copy())
        torques.append(loops.torque.copy())
        positions.append(loops.bodies.position.copy())

    with np.errstate(over="ignore", invalid="ignore"):  # what has grown out of all bounds
        while loops.k < length and open_.any():
            begin = loops.k
            loops.run(min(_LOOK, length - begin), watch)
            reached = np.max(np.abs(positions[begin:]), axis=0) > enough
            ends[open_ & reached] = loops.k
            open_ &= ~reached
    return as_traces(loops, counts, torques, positions, ends)


def steady_oscillation(position: FloatArray, period: float) -> tuple[float, float] | None:
    """Return frequency [Hz] and amplitude [rad]; None if the amplitude varies by over 3 %.

    Args:
        position: Position of several oscillations [rad].
        period: Period from sample to sample [s].
    """
    middle = 0.5 * (position.max() + position.min())
    up = np.flatnonzero((position[1:] >= middle) & (position[:-1] < middle))
    if up.size < 5:
        return None
    share = (middle - position[up]) / (position[up + 1] - position[up])
    crossings = up + share
    cycles = zip(up[:-1].tolist(), up[1:].tolist(), strict=True)
    spans = np.array([np.ptp(position[first : last + 1]) for first, last in cycles])
    if spans.min() < 0.97 * spans.max():
        return None
    frequency = (crossings.size - 1) / ((crossings[-1] - crossings[0]) * period)
    return float(frequency), float(0.5 * spans.mean())


def as_traces(
    loops: Loops,
    counts: list[FloatArray],
    torques: list[FloatArray],
    positions: list[FloatArray],
    ends: IntArray,
) -> list[Trace]:
    """Return traces of the walls, recorded period by period, each until its end."""
    per_radian = loops.walls.counts_per_radian
    columns = np.nan_to_num(np.array(counts).T * per_radian[:, None])
    whole = np.rint(np.clip(columns, -_FAR, _FAR)).astype(np.int64)
    return [
        Trace(whole[i, :end], torque[:end], position[:end])
        for i, (torque, position, end) in enumerate(
            zip(np.array(torques).T, np.array(positions).T, ends.tolist(), strict=True)
        )
    ]
