"""Compiles the loop of ``lanes``, where Numba is installed; without it arrays do the same.

The compiled code is kept on the disk, beside the program or in the user's cache, so that only the
first map on a machine waits for the compiler.
"""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Callable
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from types import FunctionType
from typing import Any, Final, TextIO

import numpy as np

from haptic_wall.controller.experiments.maps import (
    lane_bodies,
    lane_drives,
    lane_laws,
    lane_loop,
    lane_observers,
    lane_rest,
    lane_rows,
    lane_two_masses,
    lanes,
)
from haptic_wall.controller.theory.checks import FloatArray, IntArray

Run = Callable[..., int]
PATIENCE_S: Final = 120.0
"""Longest wait for another process that compiles, which takes 15 s on an idle machine [s]"""
_MODULES = (
    *(lane_rows, lane_rest, lane_bodies, lane_two_masses),
    *(lane_drives, lane_laws, lane_loop, lane_observers, lanes),
)
"""Modules whose functions are compiled"""
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
    for module in _MODULES:
        for part in vars(module).values():
            if isinstance(part, FunctionType) and part.__module__ == module.__name__:
                register_jitable(part)
    how: dict[str, Any] = {"nogil": True, "error_model": "numpy"}
    run = _keyed(fingerprint())
    try:
        return compiled_once(numba.njit(cache=True, **how)(run))
    except RuntimeError:  # no place for the cache
        return _typed(numba.njit(**how)(run))


def fingerprint() -> int:
    """Return a number that changes with the source of what is compiled."""
    texts = [Path(str(module.__file__)).read_bytes() for module in _MODULES]
    return int.from_bytes(hashlib.sha256(b"".join(texts)).digest()[:7], "big")


def _keyed(sources: int) -> Run:
    """Return ``lanes.run`` with a key for the cache.

    Numba keeps compiled code by the file of the function and by the values in its closure; it does
    not look at the files of the functions that this one calls.
    """

    def keyed(*given: Any) -> int:  # noqa: ANN401 - as ``lanes.run``
        return lanes.run(*given) if sources else 0

    return keyed


def compiled_once(run: Run) -> Run:
    """Return the same function, which only one process compiles.

    Others that call it meanwhile wait, at most ``PATIENCE_S``, and read what that process has kept.
    """
    ready = False

    def once(*given: Any) -> int:  # noqa: ANN401 - as ``lanes.run``
        nonlocal ready
        if ready:
            return run(*given)
        with Path(str(lanes.__file__)).open() as sources:
            with suppress(ImportError, OSError):  # Windows, or a file system without locks
                _lock(sources)
            found = run(*given)
        ready = True
        return found

    return once


def _lock(file: TextIO) -> None:
    """Lock a file until it is closed, or give up: the process that holds it may be stopped."""
    import fcntl

    end_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < end_s:
        try:
            return fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            time.sleep(0.05)


def _typed(run: Run) -> Run:
    return run


class Lanes:
    """A block of walls for the compiled loop; the state stays with the caller.

    Args:
        traits: By name in ``lane_rows``.
        delays: Whole periods, first and last wall of each delay, shape (delays, 3).
        fixed: What does not change, shape (FIXED, n).
        loads: The same of servos with a load, shape (LOADS, n); None: they are rigid.
        drives: The same of servos with a current loop, shape (DRIVES, n); None: they have none.
        table: Positions and elongations of a law, shape (2, rows); None: walls.
    """

    def __init__(
        self,
        run: Run,
        traits: dict[int, int],
        delays: IntArray,
        fixed: FloatArray,
        loads: FloatArray | None,
        drives: FloatArray | None,
        table: FloatArray | None,
    ) -> None:
        self._run = run
        self._traits = np.zeros(lane_rows.TRAITS, dtype=np.int64)
        for which, value in traits.items():
            self._traits[which] = value
        self._delays = delays
        self.fixed = fixed
        self._nothing = np.empty((0, 0))
        self._loads = self._nothing if loads is None else loads
        self._table = self._nothing if table is None else table
        self._drives = self._nothing if drives is None else drives

    def seen(self, *first: FloatArray) -> FloatArray:
        """Return the memory of an observer, which begins with these rows."""
        memory = np.zeros((lane_rows.SEEN, self.fixed.shape[1]))
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
        observer: int = lane_rows.NOBODY,
        seen: FloatArray | None = None,
        turned: FloatArray | None = None,
        course: FloatArray | None = None,
        masses: FloatArray | None = None,
        currents: FloatArray | None = None,
    ) -> int:
        """Simulate some periods in place; see ``lanes.run``."""
        self._traits[lane_rows.OBSERVER] = observer
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
            self._loads,
            self._nothing if masses is None else masses,
            self._drives,
            self._nothing if currents is None else currents,
            self._table,
        )
