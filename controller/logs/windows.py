"""A log's rows in overlapping windows, for what looks at motions and must not hold all of them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

WINDOW = 120_000
"""Rows in a window, those of the one before not counted"""
BEFORE_S = 10.0
"""How much of the window before comes again [s]: what sees an oscillation needs some of its
swings."""


@dataclass(frozen=True, slots=True)
class Window:
    """Some rows, the first of which may have been in the window before."""

    rows: NDArray[np.void]
    seen: int
    """How many of them were"""


def windows(blocks: Iterable[NDArray[np.void]]) -> Iterator[Window]:
    """All rows in windows; one, if they fit into it.

    Args:
        blocks: The rows, in their order, dtype ``telemetry.ROW``.
    """
    held: list[NDArray[np.void]] = []
    seen = new = 0
    for block in blocks:
        if new >= WINDOW:
            rows = np.concatenate(held)
            yield Window(rows, seen)
            since = rows["deadline_ns"][-1] - round(BEFORE_S * 1e9)
            again = rows[-WINDOW:][rows["deadline_ns"][-WINDOW:] > since].copy()
            del rows  # not to be held beside the next
            held, seen, new = [again], len(again), 0
        held.append(block)
        new += len(block)
    if new:
        yield Window(np.concatenate(held), seen)
