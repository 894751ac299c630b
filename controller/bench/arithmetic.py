"""Measures how many multiply-adds and divisions one core does a second, in compiled vector code.

The numbers stay in the first-level cache or in registers: no loop around a wall can be quicker than
its operations at these rates.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from functools import partial
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


def work() -> dict[str, Callable[[], object]]:
    """Return the measured functions by name, each of ``OPERATIONS``; none without Numba."""
    try:
        numba: Any = importlib.import_module("numba")
    except ImportError:
        return {}
    made: dict[str, Callable[[], object]] = {}
    for part in (multiply_adds, divisions):
        compiled = numba.njit(fastmath={"contract"}, error_model="numpy")(part)
        made[part.__name__.replace("_", "-")] = partial(compiled, np.full(SIZE, 1.2), _TIMES)
    return made
