"""Walls after a kick and under a hand, recorded as the controller sees them, and as they move."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from controller.experiments.many_walls import Loops, Walls, blocks
from controller.theory.checks import FloatArray, IntArray

HANDS = ("voluntary", "rhythm", "tremor", "tap", "lean")
_TOGETHER = 80
"""Walls of like frequency simulated together: the slowest of them says for how long."""
_LOOK = 400
_FAR = 1e12
"""Counts beyond which what has grown out of all bounds is not followed."""
_MOST_PERIODS = 100_000
_SLOW = 20
"""Periods from one drawn value of a hand's slow changes to the next."""


@dataclass(frozen=True, slots=True)
class Trace:
    """One wall over time; arrays of one length."""

    counts: IntArray
    """The encoder's"""
    torque: FloatArray
    """Sent with each sample [N·m]"""
    position: FloatArray
    """Where the shaft truly is a period later [rad]"""


def kicked(walls: Walls, kick: FloatArray, cycles: float, until: float = np.inf) -> list[Trace]:
    """Let servos go at rest, ``kick`` from the wall, and record them.

    Args:
        walls: With an encoder and stiffness > 0.
        kick: > 0 [rad].
        cycles: Oscillations of the undamped spring to record.
        until: Times the kick (but at least 20 counts) at which the recording may end.
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
    return _traces(loops, counts, torques, positions, ends)


def handled(walls: Walls, hand: str, periods: int, random: np.random.Generator) -> list[Trace]:
    """Record walls that a hand moves: a spring and damper toward where the hand wants to be.

    Args:
        walls: With an encoder and stiffness > 0.
        hand: One of ``HANDS``: voluntary motion of several frequencies up to 10 Hz; one rhythm of
            1 to 10 Hz; tremor of 8 to 12 Hz while leaning; tapping; leaning.
        periods: To record.
        random: Draws how each hand is, and how it changes.
    """
    n = walls.size
    # A finger on a small servo, an arm on a large one.
    size = np.clip(walls.inertia / 0.012, 0.15, 20.0)
    spring = np.exp(random.uniform(np.log(2.0), np.log(20.0), n)) * size
    damper = 2.0 * random.uniform(0.4, 0.9, n) * np.sqrt(spring * np.maximum(walls.inertia, 0.003))
    wanted = _wanted(hand, n, periods, random)
    speed = np.diff(wanted, axis=0, append=wanted[-1:]) / walls.period
    traces: dict[int, Trace] = {}
    for index in blocks(walls):
        loops = Loops(walls.take(index), np.zeros(index.size))
        counts, torques, positions = [], [], []
        for k in range(periods):
            bodies = loops.bodies
            loops.hand = spring[index] * (wanted[k, index] - bodies.position) + damper[index] * (
                speed[k, index] - bodies.velocity
            )
            loops.run(1)
            counts.append(loops.measured.copy())
            torques.append(loops.torque.copy())
            positions.append(bodies.position.copy())
        ends = np.full(index.size, periods)
        recorded = _traces(loops, counts, torques, positions, ends)
        traces.update(zip(index.tolist(), recorded, strict=True))
    return [traces[i] for i in range(n)]


def steady_oscillation(position: FloatArray, period: float) -> tuple[float, float] | None:
    """Frequency [Hz] and amplitude [rad] of a record; None if the amplitude varies by over 3 %.

    Args:
        position: Of several oscillations [rad].
        period: From sample to sample [s].
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


def _traces(
    loops: Loops,
    counts: list[FloatArray],
    torques: list[FloatArray],
    positions: list[FloatArray],
    ends: IntArray,
) -> list[Trace]:
    per_radian = loops.walls.counts_per_radian
    columns = np.nan_to_num(np.array(counts).T * per_radian[:, None])
    whole = np.rint(np.clip(columns, -_FAR, _FAR)).astype(np.int64)
    return [
        Trace(whole[i, :end], torque[:end], position[:end])
        for i, (torque, position, end) in enumerate(
            zip(np.array(torques).T, np.array(positions).T, ends.tolist(), strict=True)
        )
    ]


def _wanted(hand: str, n: int, periods: int, random: np.random.Generator) -> FloatArray:
    """Where hands want to be, shape (periods, n) [rad], at 1 kHz."""
    time = np.arange(periods)[:, None] * 1e-3

    def slow(seconds: float) -> FloatArray:
        return _slow(n, periods, seconds, random)

    def phase(frequency: FloatArray, varies: float, seconds: float) -> FloatArray:
        steps = frequency * (1.0 + varies * slow(seconds))
        return 2.0 * np.pi * (1e-3 * np.cumsum(steps, axis=0) + random.uniform(0.0, 1.0, n))

    result: FloatArray
    if hand == "voluntary":
        result = 0.1 * slow(1.5)
        for _ in range(3):
            f = np.exp(random.uniform(np.log(0.4), np.log(10.0), n))
            result += 0.15 / (1 + f / 1.5) * np.exp(0.4 * slow(1.0)) * np.sin(phase(f, 0.05, 0.7))
    elif hand == "rhythm":
        f = random.uniform(1.0, 10.0, n)
        reach = random.uniform(0.08, 0.25, n) / (1.0 + f / 1.5)
        result = reach * (1.0 + 0.1 * slow(0.7)) * np.sin(phase(f, 0.03, 0.7))
    elif hand == "tremor":
        reach = random.uniform(0.005, 0.03, n) * np.abs(1.0 + 0.35 * slow(0.6))
        result = random.uniform(-0.1, 0.2, n) + 0.03 * slow(2.0)
        result += reach * np.sin(phase(random.uniform(8.0, 12.0, n), 0.05, 0.5))
    elif hand == "tap":
        depth = random.uniform(0.05, 0.3, n) * (1.0 + 0.2 * slow(0.5))
        wave = np.sin(phase(random.uniform(1.0, 6.0, n), 0.1, 0.5))
        result = -0.02 + depth * np.maximum(wave, -0.3)
    elif hand == "lean":
        depth = random.uniform(0.02, 0.5, n) * (0.7 + 0.3 * np.tanh(slow(1.0)))
        result = depth * np.minimum(1.0, time)
    else:
        raise ValueError(f"hand {hand!r} is not known; give one of {', '.join(HANDS)}")
    return result


def _slow(n: int, periods: int, seconds: float, random: np.random.Generator) -> FloatArray:
    """Slow random changes of unit variance, forgotten within so many seconds; (periods, n)."""
    rows = periods // _SLOW + 3
    keep = np.exp(-_SLOW * 1e-3 / seconds)
    drawn = random.standard_normal((rows, n))
    values = np.empty((rows, n))
    value = random.standard_normal(n)
    for row in range(rows):
        value = keep * value + np.sqrt(1.0 - keep * keep) * drawn[row]
        values[row] = value
    at = np.arange(periods) / _SLOW
    whole = at.astype(np.int64)
    share = (at - whole)[:, None]
    result: FloatArray = values[whole] * (1.0 - share) + values[whole + 1] * share
    return result
