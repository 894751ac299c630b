"""Yields a log's rows in overlapping windows, for analyses that need bounded memory."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

WINDOW = 120_000
"""Rows in a window, without the overlap"""
BEFORE_S = 10.0
"""Overlap with the window before [s]: the detector needs some half-cycles of an oscillation."""


@dataclass(frozen=True, slots=True)
class Window:
    """Consecutive rows, the first of which may overlap with the window before."""

    rows: NDArray[np.void]
    seen: int
    """Number of overlapping rows"""


def windows(blocks: Iterable[NDArray[np.void]]) -> Iterator[Window]:
    """Yield all rows in windows; one window if they fit.

    Args:
        blocks: The rows, in order, dtype ``telemetry.ROW``.
    """
    held: list[NDArray[np.void]] = []
    seen = new = 0
    for block in blocks:
        if new >= WINDOW:
            rows = np.concatenate(held)
            yield Window(rows, seen)
            since = rows["deadline_ns"][-1] - round(BEFORE_S * 1e9)
            again = rows[-WINDOW:][rows["deadline_ns"][-WINDOW:] > since].copy()
            del rows  # free it before the next one comes
            held, seen, new = [again], len(again), 0
        held.append(block)
        new += len(block)
    if new:
        yield Window(np.concatenate(held), seen)
