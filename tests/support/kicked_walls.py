"""Simulated walls after a kick or under a hand: their record, and what the detector makes of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from haptic_wall.controller.detector.acting import ActingTorque
from haptic_wall.controller.detector.oscillation import Detector, DetectorSettings
from haptic_wall.controller.experiments.maps.many_walls import Loops
from haptic_wall.controller.experiments.maps.walls import Walls, blocks
from haptic_wall.controller.theory.checks import FloatArray, IntArray
from tests.support.operators import draw_grips, wanted_motion
from tests.support.truth import COUNT

PERIOD = 1e-3
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


@dataclass(frozen=True, slots=True)
class Hands:
    """An operator on each wall: a spring and damper toward a moving reference."""

    spring: FloatArray
    """Shape (n,) [N·m/rad]"""
    damper: FloatArray
    """Shape (n,) [N·m·s/rad]"""
    wanted: FloatArray
    """Its reference, shape (periods, n) [rad]"""
    speed: FloatArray
    """Speed of the reference, the same shape [rad/s]"""

    def torque(
        self, k: int, who: IntArray, position: FloatArray, velocity: FloatArray
    ) -> FloatArray:
        """Return the torque of the operators ``who`` in period ``k`` [N·m]."""
        drag: FloatArray = self.damper[who] * (self.speed[k, who] - velocity)
        drag += self.spring[who] * (self.wanted[k, who] - position)
        return drag


def draw_hands(walls: Walls, hand: str, periods: int, random: np.random.Generator) -> Hands:
    """Draw an operator for each wall.

    Args:
        walls: Their inertia decides an operator's strength.
        hand: One of ``HANDS``: voluntary motion of several frequencies up to 10 Hz; one rhythm of
            1 to 10 Hz; tremor of 8 to 12 Hz while leaning; tapping; leaning.
        periods: Duration of the motion.
        random: Draws properties and changes.
    """
    spring, damper = draw_grips(walls.inertia, random)
    wanted = wanted_motion(hand, walls.size, periods, random)
    speed = np.diff(wanted, axis=0, append=wanted[-1:]) / walls.period
    return Hands(spring, damper, wanted, speed)


def handled(walls: Walls, hands: Hands) -> list[Trace]:
    """Record walls that operators move, from rest.

    Args:
        walls: Walls with an encoder and stiffness > 0.
        hands: One for each.
    """
    periods = hands.wanted.shape[0]
    traces: dict[int, Trace] = {}
    for index in blocks(walls):
        loops = Loops(walls.take(index), np.zeros(index.size))
        counts, torques, positions = [], [], []
        for k in range(periods):
            bodies = loops.bodies
            loops.hand = hands.torque(k, index, bodies.position, bodies.velocity)
            loops.run(1)
            counts.append(loops.measured.copy())
            torques.append(loops.torque.copy())
            positions.append(bodies.position.copy())
        ends = np.full(index.size, periods)
        recorded = as_traces(loops, counts, torques, positions, ends)
        traces.update(zip(index.tolist(), recorded, strict=True))
    return [traces[i] for i in range(walls.size)]


@dataclass(frozen=True, slots=True)
class Heard:
    """The detector's result on a trace."""

    detector: Detector
    """In its final state"""
    alarms: list[int]
    """Samples at which an alarm began"""


def listen(
    walls: Walls,
    i: int,
    trace: Trace,
    belief: FloatArray,
    *,
    once: bool,
) -> Heard:
    """Run the detector over a trace, with wrong beliefs.

    Args:
        walls: The simulated walls.
        i: Index of the wall.
        trace: Its record.
        belief: Factors on inertia, damping, Coulomb friction and delay.
        once: Stop at the first alarm.
    """
    m, b, c, delay = belief.tolist()
    settings = DetectorSettings(
        PERIOD,
        float(walls.inertia[i]) * m,
        float(walls.damping[i]) * b,
        float(walls.coulomb[i]) * c,
        COUNT,
        float(walls.torque_limit[i]),
    )
    lag = float(walls.whole[i] * PERIOD + walls.lag[i]) * delay
    detector = Detector(settings)
    detector.stiffness = float(walls.stiffness[i])
    balance = detector.balance
    balance.virtual_damping = float(walls.virtual_damping[i])
    balance.surface, balance.side, balance.lag = 0.0, int(walls.one_sided[i]), lag
    acting = ActingTorque(lag / PERIOD)
    alarms: list[int] = []
    alarmed = False
    positions = (trace.counts * COUNT).tolist()
    for k, (position, torque) in enumerate(zip(positions, trace.torque.tolist(), strict=True)):
        detector.update(position, acting.push(torque))
        if detector.alarm is not alarmed:
            alarmed = detector.alarm
            if alarmed:
                alarms.append(k)
                if once:
                    break
    return Heard(detector, alarms)
