"""Reading a log block by block, in memory that does not grow with it, past whatever is damaged."""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from controller.errors import LogFormatError
from controller.log.blocks import Block, block_at, last_block, next_magic
from controller.log.plausible import plausible

SUFFIX = ".hwlog"
FORMAT = {"format": "haptic-wall log", "version": 1, "checksum": "crc32"}
"""What the metadata of every log begins with; those of before have no checksums, and say so by
having no ``checksum``."""

_logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Damage:
    """Bytes that hold no intact block."""

    start: int
    """Where in the file [bytes]"""
    size: int
    """[bytes]"""
    last: bool
    """Nothing follows: the end was cut off, or is being written"""


@dataclass(frozen=True, slots=True)
class End:
    """How the run ended, as its own program has written it."""

    ended: dict[str, Any]


Piece = NDArray[np.void] | Damage | End


class LogReader:
    """A log, read block by block in memory that does not grow with it.

    Args:
        path: A file written by ``LogWriter``.

    Attributes:
        metadata: What the rows belong to; empty where that part of the file is damaged.

    Raises:
        LogFormatError: The file is not a log of ours.
        OSError: It cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._start = 0
        self._checked = True
        self.metadata: dict[str, Any] = {}
        with path.open("rb") as file:
            size = _size(file)
            head = block_at(file, 0, size, checked=False)
            metadata = _from_json(head.array) if head is not None else None
            if head is not None and metadata is not None and _is_ours(metadata):
                self._start = head.end
                self.metadata = metadata
                self._checked = "checksum" in metadata
            elif not any(isinstance(piece, np.ndarray) for piece in _pieces(file, 0, size, True)):
                raise LogFormatError(
                    f"{path} is not a log of haptic-wall: it does not begin with one's metadata; "
                    f"wanted a {SUFFIX} file"
                )
        version = self.metadata.get("version", FORMAT["version"])
        if version != FORMAT["version"]:
            raise LogFormatError(
                f"{path} is a log of format version {version}, this program reads "
                f"version {FORMAT['version']}: read it with the haptic-wall that wrote it"
            )

    def pieces(self) -> Iterator[Piece]:
        """What is in the file, in its order: blocks of rows, damage between them, the end.

        May be asked for any number of times; a file that grows is read to where it ended then.

        Raises:
            OSError: It cannot be read.
        """
        with self._path.open("rb") as file:
            yield from _pieces(file, self._start, _size(file), self._checked)

    def last(self) -> Block | None:
        """The last intact block of rows, found from the end; None: there is none.

        Raises:
            OSError: It cannot be read.
        """
        with self._path.open("rb") as file:
            return last_block(file, self._start, _size(file), self._checked)

    @property
    def start(self) -> int:
        """Where what follows the metadata begins [bytes]."""
        return self._start

    def warn(self, damage: Damage) -> None:
        """Say in the program's log what was skipped."""
        if damage.last:
            _logger.warning(
                "%s: the last %d bytes are not a complete block and were skipped; the run that "
                "wrote them was cut off",
                self._path,
                damage.size,
            )
        else:
            _logger.warning(
                "%s: %d bytes from byte %d on are damaged and were skipped",
                self._path,
                damage.size,
                damage.start,
            )


def _pieces(file: BinaryIO, start: int, size: int, checked: bool) -> Iterator[Piece]:
    dtype: np.dtype[np.void] | None = None
    damaged: int | None = None
    while start < size:
        block = block_at(file, start, size, checked)
        piece: Piece | None = None
        if block is not None and block.array.dtype.names is None:
            ended = _from_json(block.array)
            piece = End(ended) if ended is not None else None
        elif (
            block is not None
            and dtype in (None, block.array.dtype)
            and (checked or plausible(block.array))
        ):
            piece = block.array
            dtype = block.array.dtype
        if block is None or piece is None:
            damaged = start if damaged is None else damaged
            start = next_magic(file, start + 1, size)
            continue
        if damaged is not None:
            yield Damage(damaged, start - damaged, last=False)
            damaged = None
        yield piece
        start = block.end
    if damaged is not None:
        yield Damage(damaged, size - damaged, last=True)


def _size(file: BinaryIO) -> int:
    return os.fstat(file.fileno()).st_size


def _is_ours(metadata: Mapping[str, Any]) -> bool:
    return metadata.get("format") == FORMAT["format"]


def _from_json(array: NDArray[Any]) -> dict[str, Any] | None:
    """The object that an array of bytes holds; None: it holds none."""
    if array.dtype != np.uint8:
        return None
    try:
        content = json.loads(array.tobytes())
    except (ValueError, RecursionError):
        return None
    return content if isinstance(content, dict) else None
