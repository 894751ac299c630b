"""Measures how many wall periods are simulated a second: compiled, and as the program does."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from haptic_wall.controller.bench.plant_alone import PERIOD_S, beside_peers
from haptic_wall.controller.bench.rows import Measurement, Section, interleaved, over_rounds, ratio
from haptic_wall.controller.experiments.maps.compiled import compiled
from haptic_wall.controller.experiments.maps.tables import Table
from haptic_wall.controller.experiments.maps.walls import Loop, wall_of
from haptic_wall.controller.laws.detents import Detents
from haptic_wall.controller.theory import critical_stiffness, max_virtual_damping
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.hw.clock import SimulatedClock
from haptic_wall.hw.open import open_servo
from haptic_wall.hw.settings import ServoSettings
from haptic_wall.hw.truth import TrueServo

_ROUNDS = 5
_WALLS = 64
_PERIODS, _PERIODS_ALONE = 10_000, 600
_PERIOD_NS = round(1e9 * PERIOD_S)
_COMPARED = 8
"""Number of walls that are also simulated as the program does"""
_NOT_THE_SEARCH = "walls with backlash or long velocity differences, and the search around it"
_ROUGH = "servos with friction and encoder"
_KINDS = {"linear servos": False, _ROUGH: True}
_WIDTH = math.tau / 24
"""Distance between detents [rad]"""


@dataclass(frozen=True, slots=True)
class ArrayWall:
    """A two-sided wall on a servo of its own, released at ``servo.position``."""

    servo: TrueServo
    stiffness: float
    """K [N·m/rad]"""
    virtual_damping: float
    """B [N·m·s/rad]"""


def measure() -> Section:
    """Measure two-sided walls on random servos, and the servo alone beside peers."""
    drawn = {what: random_walls(rough, _WALLS) for what, rough in _KINDS.items()}
    fast = compiled() is not None
    periods = _PERIODS if fast else _PERIODS_ALONE // _COMPARED
    how = "compiled" if fast else "not compiled"
    law = Table.of(Detents(_WIDTH, 0.25), _WIDTH * (np.arange(-24, 25) / 2 + 0.25))
    work: dict[str, Callable[[], object]] = {
        "detents": partial(together, drawn[_ROUGH], periods, law)
    }
    for what, walls in drawn.items():
        together(walls[:1], periods)  # compiles
        work[what] = partial(together, walls, periods)
        work[f"{what}, alone"] = partial(_each_alone, walls)
    times = interleaved(work, _ROUNDS, time.process_time)
    rows, unit = [], "wall-periods/s"
    for what in (*drawn, "detents"):
        each = _WALLS * periods
        name = f"{how}, {_WALLS} random walls, {what}"
        rows.append(over_rounds(name, [each / s for s in times[what]], unit, _NOT_THE_SEARCH))
    for what, walls in drawn.items():
        few = walls[:_COMPARED]
        count = _PERIODS_ALONE // _COMPARED
        apart = together(few, count) - [alone(wall, count) for wall in few]
        single = [s / _PERIODS_ALONE for s in times[f"{what}, alone"]]
        many = [s / (_WALLS * periods) for s in times[what]]
        rows += [
            over_rounds(
                f"{_COMPARED} of them, as the simulated servo, {what}",
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
    compared, notes = beside_peers()
    if not fast:
        notes.append("nothing is compiled: pip install -e '.[fast]' in the clone adds Numba")
    return Section((*rows, *compared), tuple(notes))


def random_walls(rough: bool, count: int) -> list[ArrayWall]:
    """Return walls that differ in everything: servo, delay, stiffness, damping and kick.

    Args:
        rough: With Coulomb friction, an encoder and a torque limit; else linear.
        count: Number of walls.
    """
    random = np.random.default_rng(1)
    inertia = 10 ** random.uniform(-3.0, -1.0, count)
    damping = inertia * random.uniform(0.5, 4.0, count)
    coulomb = random.uniform(0.1, 1.0, count) * inertia
    delay = np.round(random.uniform(0.0, 5.0, count), 3) * PERIOD_S
    ceiling = max_virtual_damping(inertia, damping, PERIOD_S, delay)
    virtual = random.uniform(0.0, 0.5, count) * ceiling
    limit = critical_stiffness(inertia, damping, virtual, PERIOD_S, delay)
    stiffness = random.uniform(0.1, 0.95, count) * limit
    kick = 10 ** random.uniform(-2.0, 0.0, count)
    return [
        ArrayWall(
            TrueServo(
                inertia=m,
                damping=b,
                coulomb=c if rough else 0.0,
                counts_per_rev=4096 if rough else 0,
                torque_limit=50.0 * m if rough else math.inf,
                delay=t_d,
                position=x,
            ),
            k,
            big_b,
        )
        for m, b, c, t_d, x, k, big_b in zip(
            *(a.tolist() for a in (inertia, damping, coulomb, delay, kick, stiffness, virtual)),
            strict=True,
        )
    ]


def together(walls: list[ArrayWall], periods: int, law: Table | None = None) -> FloatArray:
    """Return the last measured positions [rad] of walls, or of servos under a law."""
    found = []
    for each in walls:
        wall = wall_of(
            each.servo,
            period=PERIOD_S,
            delay=each.servo.delay,
            virtual_damping=each.virtual_damping,
            law=law,
        )
        loop = Loop(wall, each.stiffness, each.servo.position, law=law)
        loop.run(periods)
        found.append(loop.measured)
    return np.array(found)


def _each_alone(walls: list[ArrayWall]) -> list[float]:
    return [alone(wall, _PERIODS_ALONE // _COMPARED) for wall in walls[:_COMPARED]]


def alone(wall: ArrayWall, periods: int) -> float:
    """Return the last measured position [rad] of one simulated servo and wall."""
    clock = SimulatedClock()
    body = open_servo(ServoSettings(true=wall.servo), clock)
    body.start()
    before = math.nan
    for k in range(periods):
        body.request()
        position = body.collect(clock.now_ns()).position
        velocity = (position - before) / PERIOD_S if k else 0.0
        body.write(-wall.stiffness * position - wall.virtual_damping * velocity)
        before = position
        clock.wait_until((k + 1) * _PERIOD_NS)
    body.close()
    return before
