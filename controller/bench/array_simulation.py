"""Measures how many wall periods are simulated a second: compiled, and as the program does."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from haptic_wall.controller.bench.rows import Measurement, Section, interleaved, over_rounds, ratio
from haptic_wall.controller.experiments.maps.compiled import compiled
from haptic_wall.controller.experiments.maps.walls import Loop, wall_of
from haptic_wall.controller.theory import critical_stiffness, max_virtual_damping
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.hw.clock import SimulatedClock
from haptic_wall.hw.open import open_bus
from haptic_wall.hw.settings import ServoSettings
from haptic_wall.hw.truth import TrueServo

_PERIOD_S = 1e-3
_ROUNDS = 5
_WALLS, _PERIODS = 64, 10_000
_FEW, _SHORT = 8, 75
"""Walls and periods that are also simulated as the program does"""
_NOT_THE_SEARCH = "walls with backlash or long velocity differences, and the search around it"
_KINDS = {"linear servos": False, "servos with friction and encoder": True}


class _Released(NamedTuple):
    """A two-sided wall on a servo of its own, released at ``servo.position``."""

    servo: TrueServo
    stiffness: float
    """K [N·m/rad]"""
    virtual_damping: float
    """B [N·m·s/rad]"""


def measure() -> Section:
    """Measure two-sided walls on random servos."""
    drawn = {what: _random_walls(rough, _WALLS) for what, rough in _KINDS.items()}
    fast = compiled() is not None
    periods = _PERIODS if fast else _SHORT
    work: dict[str, Callable[[], object]] = {}
    for what, walls in drawn.items():
        together(walls[:1], periods)  # compiles
        work[what] = partial(together, walls, periods)
        work[f"{what}, alone"] = partial(_each_alone, walls[:_FEW])
    times = interleaved(work, _ROUNDS, time.process_time)
    rows, unit = [], "wall-periods/s"
    how = "compiled" if fast else "not compiled"
    for what, walls in drawn.items():
        single = [s / (_FEW * _SHORT) for s in times[f"{what}, alone"]]
        many = [s / (_WALLS * periods) for s in times[what]]
        apart = together(walls[:_FEW], _SHORT) - _each_alone(walls[:_FEW])
        rows += [
            over_rounds(
                f"{how}, {_WALLS} random walls, {what}",
                [1.0 / s for s in many],
                unit,
                _NOT_THE_SEARCH,
            ),
            over_rounds(
                f"{_FEW} of them, as the simulated servo, {what}",
                [1.0 / s for s in single],
                unit,
                "the program's own loop, which also guards, watches and logs",
            ),
            ratio(f"ratio, {what}", single, many, _NOT_THE_SEARCH),
            Measurement(
                f"largest difference of position from them, {what}",
                float(np.max(np.abs(apart))),
                "rad",
                "other walls than these",
            ),
        ]
    note = "nothing is compiled: pip install -e '.[fast]' in the clone adds Numba"
    return Section(tuple(rows), () if fast else (note,))


def _random_walls(rough: bool, count: int) -> list[_Released]:
    """Return walls that differ in everything: servo, delay, stiffness, damping and kick.

    Args:
        rough: With Coulomb friction, an encoder and a torque limit; else linear.
        count: Number of walls.
    """
    random = np.random.default_rng(1)
    inertia = 10 ** random.uniform(-3.0, -1.0, count)
    damping = inertia * random.uniform(0.5, 4.0, count)
    coulomb = random.uniform(0.1, 1.0, count) * inertia
    delay = np.round(random.uniform(0.0, 5.0, count), 3) * _PERIOD_S
    virtual = random.uniform(0.0, 0.5, count) * max_virtual_damping(
        inertia, damping, _PERIOD_S, delay
    )
    limit = critical_stiffness(inertia, damping, virtual, _PERIOD_S, delay)
    stiffness = random.uniform(0.1, 0.95, count) * limit
    kick = 10 ** random.uniform(-2.0, 0.0, count)
    columns = (inertia, damping, coulomb, delay, kick, stiffness, virtual)
    walls = []
    for m, b, c, t_d, x, k, big_b in zip(*(column.tolist() for column in columns), strict=True):
        servo = TrueServo(
            inertia=m,
            damping=b,
            coulomb=c if rough else 0.0,
            counts_per_rev=4096 if rough else 0,
            torque_limit=50.0 * m if rough else math.inf,
            delay=t_d,
            position=x,
        )
        walls.append(_Released(servo, k, big_b))
    return walls


def together(walls: list[_Released], periods: int) -> FloatArray:
    """Return the last measured positions of walls [rad]."""
    found = []
    for servo, stiffness, damping in walls:
        wall = wall_of(servo, period=_PERIOD_S, delay=servo.delay, virtual_damping=damping)
        loop = Loop(wall, stiffness, servo.position)
        loop.run(periods)
        found.append(loop.measured)
    return np.array(found)


def _each_alone(walls: list[_Released]) -> FloatArray:
    return np.array([_alone(wall) for wall in walls])


def _alone(wall: _Released) -> float:
    """Return the last measured position [rad] of one simulated servo and wall."""
    clock, period_ns = SimulatedClock(), round(1e9 * _PERIOD_S)
    body = open_bus([ServoSettings(true=wall.servo)], clock)
    body.start()
    before = math.nan
    for k in range(_SHORT):
        body.request()
        position = body.collect(clock.now_ns())[0].position
        velocity = (position - before) / _PERIOD_S if k else 0.0
        body.write([-wall.stiffness * position - wall.virtual_damping * velocity])
        before = position
        clock.wait_until((k + 1) * period_ns)
    body.close()
    return before
