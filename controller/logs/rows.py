"""Reads a stretch of a log block by block: the rows between two instants, and faults."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.errors import LogFormatError
from haptic_wall.controller.logs.pieces import End, Event, Head, Piece
from haptic_wall.controller.logs.reader import LogReader
from haptic_wall.controller.runtime.telemetry import ROW

_LATER: Final = {"phase": 0, "oscillation": 0, "measured_torque": math.nan, "held_torque": 0.0}
"""Columns that the first logs lacked, with the values that applied then: no program, no watch, no
measurement, nothing held"""


def upgraded(rows: NDArray[Any], path: Path) -> NDArray[np.void]:
    """Return the rows with all columns of ``telemetry.ROW``, shape (n,).

    Args:
        rows: Shape (n,), of columns in ``ROW``.
        path: The log, for the message.

    Raises:
        LogFormatError: A column is missing that every version has.
    """
    if rows.dtype == ROW:
        return rows
    names = rows.dtype.names or ()
    missing = [name for name in ROW.names or () if name not in names and name not in _LATER]
    if missing:
        raise LogFormatError(
            f"{path}: its rows lack the column {' and '.join(missing)}",
            advice="read it with the haptic-wall that wrote it",
        )
    whole = np.zeros(len(rows), ROW)
    for name in names:
        whole[name] = rows[name]
    for name in _LATER:
        if name not in names:
            whole[name] = _LATER[name]
    return whole


@dataclass(frozen=True, slots=True)
class TimeSpan:
    """The times t with ``start_s <= t < end_s``, counted from the log's first row [s]."""

    start_s: float = -math.inf
    end_s: float = math.inf


WHOLE = TimeSpan()
JOINT_NS = 1_000_000_000
"""Time between two logs joined in one file, whenever they were written [ns]"""

_MOST_LOGS = 100
"""Largest number of logs in one file"""
_LAST_NS = 1 << 62
_GATHERED = 8192
"""Wanted number of rows in a block; a recorder's blocks have a few hundred"""


@dataclass(frozen=True, slots=True)
class LogRows:
    """The rows of a run's log within a stretch; can be iterated any number of times.

    If logs are joined in one file, the time of each continues that of the log before.
    """

    log: LogReader
    origin_ns: int
    """Deadline of the log's first row [ns]; 0: it has none"""
    metadata: Mapping[str, Any]
    """Metadata of their log, the first where logs are joined"""
    stretch: TimeSpan = WHOLE
    watched: bool = True
    """Whether the rows contain the detector's state; those of the first versions do not"""

    @classmethod
    def of(cls, log: LogReader, stretch: TimeSpan = WHOLE) -> LogRows:
        """Return the rows of a log in a stretch; the log's first row has time 0.

        Raises:
            LogFormatError: The rows are not those of a run.
        """
        for piece in log.pieces():
            if isinstance(piece, np.ndarray):
                first = upgraded(piece[:1], log.path)
                watched = "oscillation" in (piece.dtype.names or ())
                return cls(log, int(first["deadline_ns"][0]), log.metadata, stretch, watched)
        return cls(log, 0, log.metadata, stretch)

    def blocks(self) -> Iterator[NDArray[np.void]]:
        """Yield blocks of rows, shape (n,), n > 0."""
        return (piece for piece in self.pieces() if isinstance(piece, np.ndarray))

    def pieces(self) -> Iterator[Piece]:
        """Yield the pieces of the stretch: blocks of rows, faults, ends of logs.

        The log's events up to the stretch's last rows come too.

        A fault without intact rows before or after it belongs to any stretch. The ``Head`` of a
        joined log comes before its rows.
        """
        held: list[Piece] = []  # until rows of the stretch follow
        inside = self.stretch.start_s == -math.inf
        past = False
        for piece in self._in_one_time():
            if past and not isinstance(piece, Event):
                return
            if isinstance(piece, np.ndarray):
                rows, past = self._within(piece)
                if len(rows):
                    if len(rows) < len(piece):
                        held = [*(other for other in held if isinstance(other, Head | Event))]
                    yield from held
                    inside = True
                    yield rows
                    held = []
                else:
                    held = [*(other for other in held if isinstance(other, Head | Event))]
            elif isinstance(piece, Head):
                held = [piece]
            elif inside:
                yield from held
                held = []
                yield piece
            elif not isinstance(piece, End):
                held.append(piece)

    def _in_one_time(self) -> Iterator[Piece]:
        """Yield all pieces of the file with the present columns and one continuous time."""
        shift_ns = logs = 0
        last_ns: int | None = None
        joined = False
        for piece in self.log.pieces():
            if isinstance(piece, np.ndarray):
                rows = upgraded(piece, self.log.path)
                if joined and last_ns is not None:
                    shift_ns = last_ns + JOINT_NS - int(rows["deadline_ns"][0])
                joined = False
                rows = _shifted(rows, shift_ns, self.log.path)
                last_ns = int(rows["deadline_ns"][-1])
                yield rows
                continue
            if isinstance(piece, Head):
                joined = True
                logs += 1
                if logs >= _MOST_LOGS:
                    raise LogFormatError(
                        f"{self.log.path}: found more than {_MOST_LOGS} logs joined in one file",
                        advice="wanted fewer",
                    )
            yield piece

    def _within(self, block: NDArray[np.void]) -> tuple[NDArray[np.void], bool]:
        """Return the block's rows in the stretch, and whether the stretch is over."""
        if self.stretch == WHOLE:
            return block, False
        time = (block["deadline_ns"] - self.origin_ns) * 1e-9
        # Half a nanosecond, so that rounding of 0.003 s does not miss the row at 3 ms.
        after = time >= self.stretch.start_s - 5e-10
        before = time < self.stretch.end_s - 5e-10
        return block[after & before], bool(len(time)) and not bool(before[-1])


def _shifted(rows: NDArray[np.void], shift_ns: int, path: Path) -> NDArray[np.void]:
    if shift_ns == 0:
        return rows
    if int(rows["deadline_ns"][-1]) + shift_ns > _LAST_NS:
        raise LogFormatError(
            f"{path}: found logs of more than 146 years in all", wanted="shorter ones"
        )
    moved = rows.copy()
    moved["deadline_ns"] += shift_ns
    moved["sampled_ns"] += shift_ns
    return moved


def gathered(pieces: Iterable[Piece]) -> Iterator[Piece]:
    """Merge small blocks into large ones, which NumPy processes faster."""
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
            del together  # free it before the next one is made
        if not isinstance(piece, np.ndarray):
            yield piece
    if held:
        yield np.concatenate(held)
