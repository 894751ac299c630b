"""Compiles the loop of ``lanes``, where Numba is installed; without it arrays do the same.

The compiled code is kept on the disk, beside the program or in the user's cache, so that only the
first map on a machine waits for the compiler.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import lru_cache
from types import FunctionType
from typing import Any

import numpy as np

from haptic_wall.controller.experiments.maps import lanes
from haptic_wall.controller.theory.checks import FloatArray, IntArray

Run = Callable[..., int]
_OFF = "NUMBA_DISABLE_JIT"
"""Numba's own variable; 1: nothing is compiled"""


@lru_cache(maxsize=1)
def compiled() -> Run | None:
    """Return the compiled ``lanes.run``; None: Numba is missing or switched off.

    It holds no lock of the interpreter, so that threads run it side by side.
    """
    if os.environ.get(_OFF, "0") not in ("", "0"):
        return None
    try:
        import numba
        from numba.extending import register_jitable
    except ImportError:  # also where it is too old for this NumPy
        return None
    for part in vars(lanes).values():
        if isinstance(part, FunctionType) and part is not lanes.run:
            register_jitable(part)
    how: dict[str, Any] = {"nogil": True, "error_model": "numpy"}
    try:
        return _typed(numba.njit(cache=True, **how)(lanes.run))
    except RuntimeError:  # no place for the cache
        return _typed(numba.njit(**how)(lanes.run))


def _typed(run: Run) -> Run:
    return run


class Lanes:
    """A block of walls for the compiled loop; the state stays with the caller.

    Args:
        traits: By name in ``lanes``.
        delays: Whole periods, first and last wall of each delay, shape (delays, 3).
        fixed: What does not change, shape (FIXED, n).
    """

    def __init__(
        self, run: Run, traits: dict[int, int], delays: IntArray, fixed: FloatArray
    ) -> None:
        self._run = run
        self._traits = np.zeros(lanes.TRAITS, dtype=np.int64)
        for which, value in traits.items():
            self._traits[which] = value
        self._delays = delays
        self.fixed = fixed
        self._nothing = np.empty((0, 0))

    def seen(self, *first: FloatArray) -> FloatArray:
        """Return the memory of an observer, which begins with these rows."""
        memory = np.zeros((lanes.SEEN, self.fixed.shape[1]))
        for row, values in zip(memory, first, strict=False):
            row[:] = values
        return memory

    def run(
        self,
        k: int,
        periods: int,
        body: FloatArray,
        measured: FloatArray,
        torques: FloatArray,
        *,
        hands: FloatArray | None = None,
        observer: int = lanes.NOBODY,
        seen: FloatArray | None = None,
        turned: FloatArray | None = None,
        course: FloatArray | None = None,
    ) -> int:
        """Simulate some periods in place; see ``lanes.run``."""
        self._traits[lanes.OBSERVER] = observer
        return self._run(
            k,
            periods,
            self._traits,
            self._delays,
            self.fixed,
            self._nothing if hands is None else hands,
            self.seen() if seen is None else seen,
            body,
            measured,
            torques,
            self._nothing if turned is None else turned,
            self._nothing if course is None else course,
        )
