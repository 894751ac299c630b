"""Measures how much quicker two cores simulate than one: the same halves, in turn and at once.

The pool, its threads, the halves and their loops are made before the clock starts, so that only the
simulation is timed. Time passes on the clock, so the figures need a machine that does nothing else.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np

from haptic_wall.controller.experiments.maps.many_walls import Loops
from haptic_wall.controller.experiments.maps.walls import Walls
from haptic_wall.controller.theory.checks import FloatArray

ROUNDS = 15
"""Number of counted rounds, each with one core and with two"""
RUNS = 10
"""Simulations of a round, each from its start: a longer one would come to rest"""

Work = Callable[[], object]
Made = Callable[[], tuple[Work, Work]]
"""Makes the work of two threads anew; it is not timed"""


def simulation(many: Walls, start: FloatArray, periods: int) -> Made:
    """Return what makes the work of simulating each half of a block of walls.

    Args:
        many: Walls that can be simulated together, shape (n,).
        start: Their positions at the start [rad], shape (n,).
        periods: Number of periods of each simulation.
    """
    halves = np.array_split(np.arange(many.size), 2)
    parts = [(many.take(half), start[half]) for half in halves]

    def made() -> tuple[Work, Work]:
        first, second = ([Loops(*part) for _ in range(RUNS)] for part in parts)
        return partial(_run, first, periods), partial(_run, second, periods)

    return made


def in_turn_and_at_once(works: dict[str, Made]) -> dict[str, tuple[list[float], list[float]]]:
    """Time the two parts of each work, one after the other and on two threads at once.

    The first round is not counted.

    Args:
        works: What makes the parts of a work, by name.

    Returns:
        By name the times in turn and those at once, one for each round [s].
    """
    times: dict[str, tuple[list[float], list[float]]] = {name: ([], []) for name in works}
    with ThreadPoolExecutor(1) as other:
        other.submit(int).result()  # its thread lives from here on
        for counted in range(ROUNDS + 1):
            for name, made in works.items():
                for at_once in (False, True):
                    first, second = made()
                    begin = time.perf_counter()
                    if at_once:
                        rest = other.submit(second)
                        first()
                        rest.result()
                    else:
                        first()
                        second()
                    elapsed = time.perf_counter() - begin
                    if counted:
                        times[name][at_once].append(elapsed)
    return times


def _run(loops: Sequence[Loops], periods: int) -> None:
    for one in loops:
        one.run(periods)
