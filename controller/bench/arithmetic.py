"""Measures how many multiply-adds and divisions one core does a second, in compiled vector code.

The numbers stay in the first-level cache or in registers: no loop around a wall can be quicker than
its operations at these rates.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from functools import lru_cache, partial
from typing import Any

import numpy as np

from haptic_wall.controller.theory.checks import FloatArray

SIZE = 128
"""Numbers that are worked on together, in registers or the first-level cache"""
_TIMES = 100_000
OPERATIONS = SIZE * _TIMES
"""Operations of one call"""


def multiply_adds(x: FloatArray, times: int) -> float:
    """Multiply and add to each number of ``x``, shape (SIZE,), ``times`` times."""
    for _ in range(times):
        for i in range(SIZE):
            x[i] = x[i] * 0.999 + 0.001
    return float(x[0])


def divisions(x: FloatArray, times: int) -> float:
    """Divide each number of ``x``, shape (SIZE,), ``times`` times."""
    for _ in range(times):
        for i in range(SIZE):
            x[i] = 1.5 / x[i]  # to and fro between two numbers
    return float(x[0])


def work(times: int = 1) -> dict[str, Callable[[], object]]:
    """Return the measured functions by name, each of ``OPERATIONS``; none without Numba.

    Each call of this function gives them numbers of their own, and they hold no lock of the
    interpreter, so that two threads can run them side by side.

    Args:
        times: How often each does its ``OPERATIONS`` in one call.
    """
    made: dict[str, Callable[[], object]] = {}
    for name, part in _compiled().items():
        # The middle of a larger array: no other thread writes to its cache lines.
        numbers = np.full(3 * SIZE, 1.2)[SIZE : 2 * SIZE]
        made[name] = partial(part, numbers, times * _TIMES)
    return made


@lru_cache(maxsize=1)
def _compiled() -> dict[str, Callable[[FloatArray, int], float]]:
    try:
        numba: Any = importlib.import_module("numba")
    except ImportError:
        return {}
    compiled = numba.njit(fastmath={"contract"}, error_model="numpy", nogil=True)
    return {part.__name__.replace("_", "-"): compiled(part) for part in (multiply_adds, divisions)}
