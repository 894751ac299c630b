"""Sorts out rows of a log that come late or twice, and reports them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.logs.pieces import Head, Misplaced, Piece

_GROW = ("seq", "deadline_ns")
_MOST_GAPS = 1000
"""Largest number of remembered gaps; a row from a forgotten gap counts as a repeat."""


def in_order(pieces: Iterable[Piece]) -> Iterator[Piece]:
    """Yield the pieces in order; rows that come late or twice are replaced by a ``Misplaced``.

    Args:
        pieces: Their rows increase within each block.
    """
    order = _Order()
    for piece in pieces:
        if isinstance(piece, Head):
            order = _Order()
        if isinstance(piece, np.ndarray):
            yield from order.sorted(piece)
        else:
            yield piece


class _Order:
    """Tracks the order of one log's rows."""

    def __init__(self) -> None:
        self._last: dict[str, int] = {}
        self._gaps: list[tuple[int, int]] = []

    def sorted(self, rows: NDArray[np.void]) -> Iterator[NDArray[np.void] | Misplaced]:
        """Yield the rows of a block that are misplaced, then those that are new."""
        names = [name for name in _GROW if name in (rows.dtype.names or ())]
        old = 0
        if any(int(rows[name][0]) <= self._last.get(name, -1) for name in names):
            new = np.ones(len(rows), np.bool_)
            for name in names:
                new &= rows[name] > self._last.get(name, -1)
            old = int(np.argmax(new)) if new.any() else len(rows)
            yield Misplaced(old, old - self._missing(rows[:old]))
        if old < len(rows):
            rows = rows[old:]
            if "seq" in names:
                self._note_gap(self._last.get("seq", -1) + 1, int(rows["seq"][0]))
            self._last = {name: int(rows[name][-1]) for name in names}
            yield rows

    def _note_gap(self, start: int, end: int) -> None:
        if end > start and len(self._gaps) < _MOST_GAPS:
            self._gaps.append((start, end))

    def _missing(self, rows: NDArray[np.void]) -> int:
        """Return how many of these rows have not come yet."""
        if "seq" not in (rows.dtype.names or ()):
            return 0
        seq = rows["seq"]
        counts = (
            np.searchsorted(seq, end) - np.searchsorted(seq, start) for start, end in self._gaps
        )
        return int(sum(counts))
