"""Simulated walls after a kick or under a hand: their record, and what the detector makes of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from haptic_wall.controller.detector.acting import ActingTorque
from haptic_wall.controller.detector.oscillation import Detector, DetectorSettings
from haptic_wall.controller.experiments.maps.many_walls import Loops
from haptic_wall.controller.experiments.maps.walls import Walls, blocks
from haptic_wall.controller.theory.checks import FloatArray, IntArray
from tests.support.operators import draw_grips, wanted_motion
from tests.support.truth import COUNT

PERIOD = 1e-3
_LOOK = 400
_FAR = 1e12
"""Counts beyond which a diverging motion is no longer followed."""


@dataclass(frozen=True, slots=True)
class Trace:
    """The record of one wall; arrays of one length."""

    counts: IntArray
    """The encoder's"""
    torque: FloatArray
    """Sent with each sample [N·m]"""
    position: FloatArray
    """True position of the shaft a period later [rad]"""


Drive = Callable[[int, IntArray, FloatArray, FloatArray], FloatArray]
"""Torque of operators [N·m], from the period, who they are, position [rad] and velocity [rad/s]"""


def kicked(walls: Walls, kick: FloatArray, cycles: float, until: float = np.inf) -> list[Trace]:
    """Release servos at rest, ``kick`` from the wall, and record them.

    Args:
        walls: Walls with an encoder and stiffness > 0.
        kick: > 0 [rad].
        cycles: Oscillations of the slowest undamped spring to record.
        until: Amplitude in kicks (but at least 20 counts) at which the recording may end.
    """
    slowest = 2.0 * np.pi * np.sqrt(np.max(walls.inertia / walls.stiffness)) / PERIOD
    enough = np.maximum(until * kick, 20.0 / walls.counts_per_radian)
    return _recorded(walls, int(cycles * slowest + 500), kick, enough)


def handled(walls: Walls, hand: str, periods: int, random: np.random.Generator) -> list[Trace]:
    """Record walls that operators of a kind (``operators.HANDS``) move, from rest."""
    spring, damper = draw_grips(walls.inertia, random)
    wanted = wanted_motion(hand, walls.size, periods, random)
    speed = np.diff(wanted, axis=0, append=wanted[-1:]) / PERIOD

    def drive(k: int, who: IntArray, position: FloatArray, velocity: FloatArray) -> FloatArray:
        drag: FloatArray = damper[who] * (speed[k, who] - velocity)
        drag += spring[who] * (wanted[k, who] - position)
        return drag

    return _recorded(walls, periods, np.zeros(walls.size), np.full(walls.size, np.inf), drive)


def _recorded(
    walls: Walls, periods: int, kick: FloatArray, enough: FloatArray, drive: Drive | None = None
) -> list[Trace]:
    """Record each wall until its amplitude is enough [rad]."""
    traces: dict[int, Trace] = {}
    for who in blocks(walls):
        loops = Loops(walls.take(who), kick[who].copy())
        rows: list[tuple[FloatArray, FloatArray, FloatArray]] = []

        def watch(loops: Loops = loops, rows: list[Any] = rows) -> None:
            place = loops.bodies.position.copy()
            rows.append((loops.measured / COUNT, loops.torque.copy(), place))

        ends = np.full(who.size, periods)
        with np.errstate(over="ignore", invalid="ignore"):  # what has grown out of all bounds
            while loops.k < periods and (ends == periods).any():
                if drive is not None:
                    bodies = loops.bodies
                    loops.hand = drive(loops.k, who, bodies.position, bodies.velocity)
                begin = loops.k
                loops.run(min(_LOOK if drive is None else 1, periods - begin), watch)
                reached = np.max(np.abs([row[2] for row in rows[begin:]]), axis=0) > enough[who]
                ends[(ends == periods) & reached] = loops.k
        counts, torques, positions = np.array(rows).transpose(1, 2, 0)
        whole = np.rint(np.clip(np.nan_to_num(counts), -_FAR, _FAR)).astype(np.int64)
        for i, end in enumerate(ends.tolist()):
            traces[int(who[i])] = Trace(whole[i, :end], torques[i, :end], positions[i, :end])
    return [traces[i] for i in range(walls.size)]


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
