"""Reads a log block by block, in bounded memory, and skips damaged parts."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.errors import LogFormatError
from haptic_wall.controller.logs.blocks import Block, block_at, last_block, next_begin
from haptic_wall.controller.logs.content import FORMAT, from_json, is_ours, judged, refused
from haptic_wall.controller.logs.pieces import (
    Damage,
    End,
    Event,
    Head,
    Misplaced,
    Piece,
    fault_text,
)
from haptic_wall.controller.system.printable import in_line
from haptic_wall.controller.system.regular_file import opened

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


__all__ = ["FORMAT", "SUFFIX", "Damage", "End", "Event", "Head", "LogReader", "Misplaced", "Piece"]

SUFFIX = ".hwlog"
_logger = logging.getLogger(__name__)


BEGINS_WITHIN = 1 << 26
"""A log with damaged metadata is recognised by an intact block of rows in this many bytes."""
_LOOKED = 1 << 20
"""A file with another name is a log only if a block begins within this many bytes"""
_AGAIN = 4
"""How often false candidates of a block may make the reader scan a file's bytes again..."""
_AGAIN_BYTES = 1 << 26
"""...and this many bytes in a small file; the rest then counts as damage"""
_LEAST_LOOK = 1 << 12
"""Smallest number of bytes charged for each such scan"""


class LogReader:
    """Reads a log block by block, in bounded memory.

    Bounds: 16 MB a block, 4 MB of metadata, and time in proportion to the size on the disk.

    Args:
        path: A file written by ``LogWriter``.

    Attributes:
        path: See above.
        metadata: Description of the rows; empty where that part of the file is damaged.

    Raises:
        LogFormatError: The file is not a log of this program.
        OSError: It cannot be read, or is no regular file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._start = 0
        self._checked = True
        self.metadata: dict[str, Any] = {}
        with opened(path) as file:
            size = _size(file)
            self._file, self._size = _identity(file), size
            head = block_at(file, 0, size)
            metadata = from_json(head.array) if head is not None else None
            if head is not None and metadata is not None and is_ours(metadata):
                self._start = head.end
                self.metadata = metadata
                self._checked = "checksum" in metadata
                _refuse_later(path, metadata)
            elif not _has_rows(path, file, min(size, BEGINS_WITHIN)):
                raise LogFormatError(
                    f"{path} is not a log of haptic-wall: it does not begin with metadata",
                    advice=f"wanted a {SUFFIX} file",
                )

    def pieces(self) -> Iterator[Piece]:
        """Yield the file's pieces in order: rows, faults between them, ends.

        Rows come in their order; rows that come late or twice are omitted and reported. It may be
        called any number of times; a growing file is read to its end at that time.

        Raises:
            LogFormatError: A log of another version is joined to this one; or the file was replaced
                or truncated since it was first opened.
            OSError: It cannot be read.
        """
        with self._opened() as file:
            yield from in_order(_pieces(self.path, file, self._start, _size(file), self._checked))

    def last(self) -> Block | None:
        """Return the last intact block of rows, searched from the end; None: there is none.

        Raises:
            LogFormatError: The file was replaced or truncated since it was first opened.
            OSError: It cannot be read.
        """
        with self._opened() as file:
            return last_block(file, self._start, _size(file), self._checked)

    def _opened(self) -> BinaryIO:
        """Open the same file again; it may have grown.

        Raises:
            LogFormatError: It is another file, or shorter.
            OSError: It cannot be read.
        """
        file = opened(self.path)
        if _identity(file) == self._file and _size(file) >= self._size:
            return file
        file.close()
        raise LogFormatError(
            f"{self.path}: replaced or cut off while it was read", advice="try again"
        )

    @property
    def start(self) -> int:
        """Return the offset of the first block after the metadata [bytes]."""
        return self._start

    def warn(self, piece: Piece) -> None:
        """Write the fault of a piece, if it has one, to the program's log."""
        for text in fault_text(piece):
            _logger.warning("%s: %s", self.path, text)


def is_log(path: Path) -> bool:
    """Whether a file is a log by its content or, where its beginning is damaged, by its name.

    Raises:
        OSError: It cannot be read, or is no regular file.
    """
    with opened(path) as file:
        looked = min(_size(file), _LOOKED)
        return path.suffix == SUFFIX or next_begin(file, 0, looked) < looked


def _pieces(path: Path, file: BinaryIO, start: int, size: int, checked: bool) -> Iterator[Piece]:
    """Yield the file's pieces in order.

    Args:
        path: Its name, for messages.
        file: Open for reading.
        start: Offset to begin at [bytes].
        size: Offset to end at [bytes].
        checked: Blocks carry checksums.
    """
    dtype: np.dtype[np.void] | None = None
    damage: Damage | None = None
    written = min(size, os.fstat(file.fileno()).st_blocks * 512)
    may_look = _AGAIN * written + _AGAIN_BYTES
    while start < size:
        block = block_at(file, start, size)
        looked = file.tell() - start
        if block is not None and dtype is None and (why := refused(block)) is not None:
            raise LogFormatError(
                f"{path}: {why}", advice="read it with the haptic-wall that wrote it"
            )
        piece, why = judged(block, dtype, checked) if block is not None else (None, None)
        if block is None or piece is None:
            may_look -= max(looked, _LEAST_LOOK)
            damage = damage or Damage(start, 0, last=False, why=why)
            # The shape of a block with correct checksums is known.
            after = start + 1 if block is None or not block.summed else block.end
            start = next_begin(file, after, size)
            if may_look < 0:
                why = "too many places in them look like the beginning of a block"
                damage, start = Damage(damage.start, 0, last=False, why=why), size
            continue
        if damage is not None:
            yield Damage(damage.start, start - damage.start, last=False, why=damage.why)
            damage = None
        if isinstance(piece, Head):
            _refuse_later(path, piece.metadata)
            dtype, checked = None, "checksum" in piece.metadata
        elif isinstance(piece, np.ndarray):
            dtype = piece.dtype
        yield piece
        start = block.end
    if damage is not None:
        yield Damage(damage.start, size - damage.start, last=True, why=damage.why)


def _has_rows(path: Path, file: BinaryIO, size: int) -> bool:
    return any(isinstance(piece, np.ndarray) for piece in _pieces(path, file, 0, size, True))


def _refuse_later(path: Path, metadata: Mapping[str, Any]) -> None:
    version = metadata.get("version", FORMAT["version"])
    if version != FORMAT["version"]:
        raise LogFormatError(
            f"{path} is a log of format version {in_line(str(version), 20)}, this program reads "
            f"version {FORMAT['version']}: read it with the haptic-wall that wrote it"
        )


def _identity(file: BinaryIO) -> tuple[int, int]:
    found = os.fstat(file.fileno())
    return found.st_dev, found.st_ino


def _size(file: BinaryIO) -> int:
    return os.fstat(file.fileno()).st_size
