"""Compiles the simulation of ``loop`` and the search on it, where Numba is installed.

The compiled code is kept on the disk, beside the program or in the user's cache, so that only the
first map on a machine waits for the compiler. It holds no lock of the interpreter: threads run it
side by side.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from types import FunctionType
from typing import Any, Final, NamedTuple

from haptic_wall.controller.experiments.maps import bounce, loop, search, turning
from haptic_wall.hw.plant import current_loop, mechanics, motion, step, two_masses

Run = Callable[..., Any]
_MODULES = (motion, mechanics, step, two_masses, current_loop, loop, turning, bounce, search)
"""Modules whose functions are compiled"""
_OFF: Final = "NUMBA_DISABLE_JIT"
"""Numba's own variable; 1: nothing is compiled"""


class Compiled(NamedTuple):
    """The compiled functions."""

    course: Run
    onset: Run


@lru_cache(maxsize=1)
def compiled() -> Compiled | None:
    """Return the compiled functions; None: Numba is missing or switched off."""
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
    sources = _fingerprint()
    found = []
    for part in (_course(sources), _onset(sources)):
        try:
            found.append(numba.njit(cache=True, **how)(part))
        except RuntimeError:  # no place for the cache
            found.append(numba.njit(**how)(part))
    return Compiled(*found)


def _fingerprint() -> int:
    """Return a number that changes with the source of what is compiled."""
    texts = [Path(str(module.__file__)).read_bytes() for module in _MODULES]
    return int.from_bytes(hashlib.sha256(b"".join(texts)).digest()[:7], "big")


# Numba keeps compiled code by the file of the function and by the values in its closure; it does
# not look at the files of the functions that this one calls.
def _course(sources: int) -> Run:
    def keyed(wall, s, z, first, periods, pushes, found):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
        if sources:
            loop.course(wall, s, z, first, periods, pushes, found)

    return keyed


def _onset(sources: int) -> Run:
    def keyed(wall, s, z, kick, guess, tolerance):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
        return search.onset(wall, s, z, kick, guess, tolerance) if sources else 0.0

    return keyed
