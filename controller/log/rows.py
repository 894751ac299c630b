"""A stretch of a log, block by block: the rows between two instants, and the damage among them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from controller.log.reader import Damage, LogReader, Piece


@dataclass(frozen=True, slots=True)
class Stretch:
    """From ``start_s`` up to, but without, ``end_s``, in seconds since the log's first row."""

    start_s: float = -math.inf
    end_s: float = math.inf


WHOLE = Stretch()


_GATHERED = 8192
"""Rows that are worth a look at a time: a recorder's blocks are a few hundred"""


@dataclass(frozen=True, slots=True)
class LogRows:
    """The rows of a run's log within a stretch; may be gone through any number of times."""

    log: LogReader
    origin_ns: int
    """Deadline of the log's first row [ns]; 0 where there is none"""
    stretch: Stretch = WHOLE

    @classmethod
    def of(cls, log: LogReader, stretch: Stretch = WHOLE) -> LogRows:
        """Those of a log, whose first row tells where the time is 0."""
        for piece in log.pieces():
            if isinstance(piece, np.ndarray) and len(piece):
                return cls(log, int(piece["deadline_ns"][0]), stretch)
        return cls(log, 0, stretch)

    def started_at(self) -> float:
        """The first position of the run [rad]; NaN: the log's begin is cut off or damaged."""
        for piece in self.log.pieces():
            if not isinstance(piece, np.ndarray):
                break
            if len(piece) and (known := piece["position"][np.isfinite(piece["position"])]).size:
                return float(known[0]) if "cut" not in self.log.metadata else math.nan
        return math.nan

    def blocks(self) -> Iterator[NDArray[np.void]]:
        """Blocks of rows, shape (n,), n > 0."""
        return (piece for piece in self.pieces() if isinstance(piece, np.ndarray))

    def pieces(self) -> Iterator[Piece]:
        """Blocks of rows, damage that borders on rows of the stretch, and the end if it reaches it.

        Damage that nothing intact precedes or follows belongs to any stretch.
        """
        damage: Damage | None = None
        inside = self.stretch.start_s == -math.inf
        for piece in self.log.pieces():
            if isinstance(piece, Damage):
                if inside:
                    yield piece
                else:
                    damage = piece
            elif isinstance(piece, np.ndarray):
                rows, past = self._within(piece)
                if len(rows):
                    if damage is not None and len(rows) == len(piece):
                        yield damage
                    inside = True
                    yield rows
                damage = None
                if past:
                    return
            elif inside:
                yield piece

    def _within(self, block: NDArray[np.void]) -> tuple[NDArray[np.void], bool]:
        """The block's rows in the stretch, and whether the log has gone past it."""
        if self.stretch == WHOLE:
            return block, False
        time = (block["deadline_ns"] - self.origin_ns) * 1e-9
        # Half a nanosecond: 0.003 s is not to miss the row at 3 ms by the last binary digit.
        after = time >= self.stretch.start_s - 5e-10
        before = time < self.stretch.end_s - 5e-10
        return block[after & before], bool(len(time)) and not bool(before[-1])


def gathered(pieces: Iterable[Piece]) -> Iterator[Piece]:
    """The same with blocks put together: what is counted by NumPy is quicker in large ones."""
    held: list[NDArray[np.void]] = []
    rows = 0
    for piece in pieces:
        if isinstance(piece, np.ndarray):
            held.append(piece)
            rows += len(piece)
            if rows < _GATHERED:
                continue
        if held:
            together = np.concatenate(held)
            held, rows = [], 0
            yield together
            del together  # or it would be there beside the next one
        if not isinstance(piece, np.ndarray):
            yield piece
    if held:
        yield np.concatenate(held)
