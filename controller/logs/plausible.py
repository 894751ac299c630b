"""Checks whether a loop can have written the given rows.

Checksums show that a block is unchanged, not that this program wrote it.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.detector.oscillation import State
from haptic_wall.controller.runtime.telemetry import FLOAT_FIELDS, INT_FIELDS, ROW
from haptic_wall.hw.servo import Outcome

_GROW: Final = ("seq", "deadline_ns")
_LONGEST_NS: Final = 1 << 50
"""Longest plausible time within a tick: some thirteen days"""
_RANGES: Final = {
    "seq": (0, 1 << 53),
    "deadline_ns": (0, 1 << 61),
    "sampled_ns": (-_LONGEST_NS, 1 << 61),
    "outcome": (0, max(Outcome)),
    "oscillation": (0, max(State)),
    "flags": (0, (1 << 16) - 1),
    "phase": (-1, 1 << 20),
    "missed": (0, 1 << 40),
}
"""Least and largest values of the columns that hold no time within a tick"""
_LARGEST: Final = 1e18
"""Largest plausible value of other columns, in SI units; NaN is unknown, and a defect may be
infinite"""


@dataclass(frozen=True, slots=True)
class _Columns:
    """Field names of a row, grouped by the check they need."""

    whole: list[int]
    low: NDArray[np.int64]
    high: NDArray[np.int64]
    real: list[int]
    grow: list[int]


def fault(rows: NDArray[Any]) -> str | None:
    """Name an implausible value in a block of rows; None: all of it is plausible.

    Args:
        rows: Shape (n,); columns of today's rows may be missing, in any order.
    """
    columns = _columns(rows.dtype)
    if columns is None:
        return "its columns are not a loop's"
    if rows.size == 0 or not rows.dtype.names:
        return "it has no rows"
    numbers = rows.view(np.int64).reshape(rows.size, -1)
    whole = numbers[:, columns.whole]
    wrong = np.argwhere((whole < columns.low) | (whole > columns.high))
    if wrong.size:
        row, place = wrong[0]
        name = rows.dtype.names[columns.whole[place]]
        return (
            f"{name} is {whole[row, place]} in it, wanted {columns.low[place]} to"
            f" {columns.high[place]}"
        )
    real = numbers.view(np.float64)[:, columns.real]
    wrong = np.argwhere((np.abs(real) > _LARGEST) & np.isfinite(real))
    if wrong.size:
        row, place = wrong[0]
        name = rows.dtype.names[columns.real[place]]
        return f"{name} is {real[row, place]:g} in it, which is too large"
    back = np.argwhere(np.diff(numbers[:, columns.grow], axis=0) <= 0)
    if back.size:
        name = rows.dtype.names[columns.grow[back[0][1]]]
        return f"{name} does not increase in it"
    return None


def refusal(dtype: np.dtype[Any]) -> str | None:
    """Return why no loop writes rows of this type; None: one does, or did without later columns."""
    for name in dtype.names or ():
        if name not in _OURS:
            return f"its rows have a column {name[:40]!r} that this program does not know"
        if dtype[name] != _OURS[name]:
            return (
                f"its column {name} is of type {str(dtype[name])[:40]!r}, wanted"
                f" {_OURS[name].str!r}"
            )
    return None


_OURS: Final = {name: ROW[name] for name in (*INT_FIELDS, *FLOAT_FIELDS)}


@functools.lru_cache(maxsize=8)
def _columns(dtype: np.dtype[Any]) -> _Columns | None:
    if refusal(dtype) is not None or dtype.itemsize != 8 * len(dtype.names or ()):
        return None
    names = dtype.names or ()
    whole = [place for place, name in enumerate(names) if name in INT_FIELDS]
    ranges = [_RANGES.get(names[place], (-_LONGEST_NS, _LONGEST_NS)) for place in whole]
    return _Columns(
        whole,
        np.array([low for low, _ in ranges], np.int64),
        np.array([high for _, high in ranges], np.int64),
        [place for place, name in enumerate(names) if name in FLOAT_FIELDS],
        [place for place, name in enumerate(names) if name in _GROW],
    )
