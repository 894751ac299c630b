"""Measures how many wall periods are simulated a second."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from haptic_wall.controller.bench.rows import Section, interleaved, over_rounds
from haptic_wall.controller.experiments.maps.compiled import compiled
from haptic_wall.controller.experiments.maps.walls import Loop, wall_of
from haptic_wall.controller.theory import critical_stiffness, max_virtual_damping
from haptic_wall.hw.truth import TrueServo

_PERIOD_S = 1e-3
_ROUNDS = 5
_WALLS, _PERIODS = 64, 10_000
_SHORT = 75
"""Periods where nothing is compiled"""
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
    fast = compiled() is not None
    periods = _PERIODS if fast else _SHORT
    work: dict[str, Callable[[], object]] = {}
    for what, rough in _KINDS.items():
        walls = _random_walls(rough, _WALLS)
        together(walls[:1], periods)  # compiles
        work[what] = partial(together, walls, periods)
    times = interleaved(work, _ROUNDS)
    how = "compiled" if fast else "not compiled"
    rows = [
        over_rounds(
            f"{how}, {_WALLS} random walls, {what}",
            [_WALLS * periods / seconds for seconds in each],
            "wall-periods/s",
        )
        for what, each in times.items()
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


def together(walls: list[_Released], periods: int) -> None:
    """Simulate walls."""
    for servo, stiffness, damping in walls:
        wall = wall_of(servo, period=_PERIOD_S, delay=servo.delay, virtual_damping=damping)
        Loop(wall, stiffness, servo.position).run(periods)
