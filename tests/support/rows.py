"""Rows of the shared memory, and of logs, by the names of their fields."""

import itertools
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.runtime.telemetry import FLOAT_FIELDS, INT_FIELDS, ROW

ORIGIN_NS: Final = 5_000_000_000
"""Deadline of row 0 [ns]; the next ones are 1 ms apart"""
_TICKS = itertools.count()


def row(**values: float) -> list[float]:
    """The values to write; fields that are not given are 0."""
    fields = [*INT_FIELDS[1:], *FLOAT_FIELDS]
    assert set(values) <= set(fields)
    return [values.get(name, 0) for name in fields]


def next_row() -> list[float]:
    """The values of a row a period after that of the last call."""
    return row(deadline_ns=next(_TICKS) * 1_000_000)


def rows_of(count: int, start: int = 0, **columns: Any) -> NDArray[np.void]:
    """Rows from a number on, one a millisecond; fields that are not given are 0."""
    made = np.zeros(count, ROW)
    made["seq"] = np.arange(start, start + count)
    made["deadline_ns"] = ORIGIN_NS + 1_000_000 * made["seq"]
    for name, values in columns.items():
        made[name] = values
    return made
