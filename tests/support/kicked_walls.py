"""Simulated walls after a kick or under a hand: their record, and what the detector makes of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from haptic_wall.controller.detector.settings import WatchSettings
from haptic_wall.controller.detector.watch import Watch
from haptic_wall.controller.experiments.maps.loop import Wall
from haptic_wall.controller.experiments.maps.walls import Loop
from haptic_wall.controller.laws.wall import Wall as Rendered
from haptic_wall.controller.theory.checks import FloatArray, IntArray
from tests.support.operators import draw_grips, wanted_motion
from tests.support.truth import COUNT

PERIOD = 1e-3
_LOOK = 400
_FAR = 1e12
"""Counts beyond which a diverging motion is no longer followed."""


class Stiff(NamedTuple):
    """A wall with its stiffness."""

    wall: Wall
    stiffness: float
    """[N·m/rad]"""


@dataclass(frozen=True, slots=True)
class Trace:
    """The record of one wall; arrays of one length."""

    counts: IntArray
    """The encoder's"""
    torque: FloatArray
    """Sent with each sample [N·m]"""
    position: FloatArray
    """True position of the shaft a period later [rad]"""


def kicked(
    walls: Sequence[Stiff], kick: FloatArray, cycles: float, until: float = np.inf
) -> list[Trace]:
    """Release servos at rest, ``kick`` from the wall, and record them.

    Args:
        walls: Walls with an encoder and stiffness > 0.
        kick: > 0 [rad].
        cycles: Oscillations of the slowest undamped spring to record.
        until: Amplitude in kicks (but at least 20 counts) at which the recording may end.
    """
    slowest = max(2.0 * np.pi * np.sqrt(one.wall.moved / one.stiffness) for one in walls) / PERIOD
    periods, traces = int(cycles * slowest + 500), []
    for one, start in zip(walls, kick.tolist(), strict=True):
        loop = Loop(one.wall, one.stiffness, start)
        parts: list[FloatArray] = []
        enough = max(until * start, 20.0 / one.wall.counts)
        while loop.k < periods and not (parts and np.abs(parts[-1][:, 0]).max() > enough):
            parts.append(loop.run(min(_LOOK, periods - loop.k)))
        traces.append(trace_of(np.concatenate(parts)))
    return traces


def handled(
    walls: Sequence[Stiff], hand: str, periods: int, random: np.random.Generator
) -> list[Trace]:
    """Record walls that operators of a kind (``operators.HANDS``) move, from rest."""
    spring, damper = draw_grips(np.array([one.wall.moved for one in walls]), random)
    wanted = wanted_motion(hand, len(walls), periods, random)
    speed = np.diff(wanted, axis=0, append=wanted[-1:]) / PERIOD
    traces = []
    for i, one in enumerate(walls):
        loop, rows = Loop(one.wall, one.stiffness, 0.0), []
        firm, drag = float(spring[i]), float(damper[i])
        for at, pace in zip(wanted[:, i].tolist(), speed[:, i].tolist(), strict=True):
            push = drag * (pace - loop.velocity) + firm * (at - loop.position)
            rows.append(loop.run(1, push)[0])
        traces.append(trace_of(np.array(rows)))
    return traces


def trace_of(course: FloatArray) -> Trace:
    """The record of what ``Loop.run`` returns."""
    counts = np.clip(np.nan_to_num(course[:, 2] / COUNT), -_FAR, _FAR)
    return Trace(np.rint(counts).astype(np.int64), course[:, 3], course[:, 0])


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
    """The watch's result on a trace."""

    watch: Watch
    """In its final state"""
    alarms: list[int]
    """Samples at which an alarm began"""


def listen(one: Stiff, trace: Trace, belief: float, *, once: bool) -> Heard:
    """Run the watch over a trace, where it may only report.

    Args:
        one: The simulated wall.
        trace: Its record.
        belief: Factor on the inertia: the believed one is wrong.
        once: Stop at the first alarm.
    """
    side = int(one.wall.one_sided)
    inertia = one.wall.body.inertia * belief
    watch = Watch(WatchSettings(PERIOD, COUNT, side=side, light=inertia, heavy=inertia))
    law = Rendered(one.stiffness, one.wall.virtual_damping, 0.0, "above" if side else "both")
    alarms: list[int] = []
    alarmed = False
    positions = (trace.counts * COUNT).tolist()
    for k, (position, torque) in enumerate(zip(positions, trace.torque.tolist(), strict=True)):
        watch.sample(position, law, math.nan, 1)
        watch.sent(torque)
        if watch.alarm is not alarmed:
            alarmed = watch.alarm
            if alarmed:
                alarms.append(k)
                if once:
                    break
    return Heard(watch, alarms)
