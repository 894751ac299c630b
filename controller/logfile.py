"""Log files: one stream of arrays, each complete by itself, so that a cut-off end costs one block.

A file is a sequence of ``.npy`` arrays with nothing between them: first the metadata, JSON as
bytes, then blocks of rows of one structured dtype. ``numpy.load`` on an open file reads them one
after the other.
"""

from __future__ import annotations

import contextlib
import io
import json
import logging
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from controller.errors import LogFormatError

SUFFIX = ".hwlog"
FORMAT = {"format": "haptic-wall log", "version": 1}
"""What the metadata of every log begins with."""

_logger = logging.getLogger(__name__)


class LogWriter:
    """Writes one log; the same rows in the same blocks give the same bytes.

    Nothing is held back: what ``append`` has taken is with the operating system, and stays
    readable whatever becomes of this process.

    Args:
        path: Where to; a file that is there is replaced.
        metadata: What the rows belong to, as JSON can hold it; NaN is not in JSON.
        dtype: Of the rows, little-endian.

    Attributes:
        rows: How many rows the file holds.
        last: The last of them, shape (1,); None: it holds none.

    Raises:
        OSError: The file cannot be written.
        ValueError: The metadata cannot be JSON.
    """

    def __init__(self, path: Path, metadata: Mapping[str, Any], dtype: np.dtype[np.void]) -> None:
        self._dtype = dtype
        self.rows = 0
        self.last: NDArray[np.void] | None = None
        text = json.dumps({**FORMAT, **metadata}, ensure_ascii=False, allow_nan=False)
        self._file = path.open("wb", buffering=0)
        try:
            self._write(np.frombuffer(text.encode(), np.uint8))
        except OSError:
            self._file.close()
            raise

    @classmethod
    def resume(cls, path: Path, dtype: np.dtype[np.void]) -> LogWriter:
        """Go on with a log whose writer is dead; half a block at its end is cut off.

        Args:
            path: The log; nobody else writes it any more.
            dtype: Of its rows.

        Raises:
            LogFormatError: The file is not a log of such rows, or its metadata was cut off.
            OSError: It cannot be read or written.
        """
        log = cls.__new__(cls)
        log._dtype, log.rows, log.last = dtype, 0, None
        log._file = path.open("r+b", buffering=0)
        with contextlib.ExitStack() as undo:
            undo.callback(log._file.close)
            size = os.fstat(log._file.fileno()).st_size
            _read_metadata(log._file, size, path)
            end = log._file.tell()
            for block in _blocks(log._file, size):
                if block.dtype != dtype:
                    raise LogFormatError(f"{path} is a log of other rows: name another file")
                log._count(block)
                end = log._file.tell()
            log._file.truncate(end)
            log._file.seek(end)
            undo.pop_all()
        return log

    def append(self, rows: NDArray[np.void]) -> None:
        """Write a block of rows, shape (n,); none writes nothing.

        Raises:
            OSError: It could not be written (a full disk); the file is what it was before, and
                may be appended to again.
        """
        if len(rows):
            self._write(rows.astype(self._dtype, copy=False))
            self._count(rows)

    def close(self) -> None:
        """Let go of the file; safe to call twice.

        Raises:
            OSError: The file system has lost something written earlier.
        """
        self._file.close()

    def __enter__(self) -> LogWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def _count(self, rows: NDArray[np.void]) -> None:
        self.rows += len(rows)
        self.last = rows[-1:].copy()

    def _write(self, array: NDArray[Any]) -> None:
        block = io.BytesIO()
        npy.write_array(block, array, version=(1, 0), allow_pickle=False)
        start = self._file.tell()
        rest = memoryview(block.getvalue())
        try:
            while rest:
                rest = rest[self._file.write(rest) :]
        except OSError:
            # Half a block would hide every later one from the reader.
            with contextlib.suppress(OSError):  # a device has no end to cut
                self._file.truncate(start)
                self._file.seek(start)
            raise


def read_log(path: Path) -> tuple[dict[str, Any], NDArray[np.void]]:
    """Read a log; an end that was cut off is skipped with a warning in the program's log.

    Args:
        path: A file written by ``LogWriter``.

    Returns:
        The metadata, and all rows, shape (n,); of no field where no block was written.

    Raises:
        LogFormatError: The file is not a log of ours.
        OSError: It cannot be read.
    """
    with path.open("rb") as file:
        size = os.fstat(file.fileno()).st_size
        metadata = _read_metadata(file, size, path)
        end = file.tell()
        blocks: list[NDArray[np.void]] = []
        for block in _blocks(file, size):
            blocks.append(block)
            end = file.tell()
    if end < size:
        _logger.warning(
            "%s: the last %d bytes are not a complete block and were skipped; the run "
            "that wrote them was cut off",
            path,
            size - end,
        )
    return metadata, np.concatenate(blocks) if blocks else np.empty(0, np.dtype([]))


def _read_metadata(file: BinaryIO, size: int, path: Path) -> dict[str, Any]:
    """The metadata that a log begins with.

    Raises:
        LogFormatError: It does not, or is of another version.
    """
    try:
        head = _read_array(file, size)
        metadata = json.loads(head.tobytes()) if head is not None else None
    except (ValueError, RecursionError):
        metadata = None
    if not isinstance(metadata, dict) or metadata.get("format") != FORMAT["format"]:
        raise LogFormatError(
            f"{path} is not a log of haptic-wall: it does not begin with one's metadata; "
            f"wanted a {SUFFIX} file"
        )
    if metadata.get("version") != FORMAT["version"]:
        raise LogFormatError(
            f"{path} is a log of format version {metadata.get('version')}, this program reads "
            f"version {FORMAT['version']}: read it with the haptic-wall that wrote it"
        )
    return metadata


def _blocks(file: BinaryIO, size: int) -> Iterator[NDArray[np.void]]:
    """The blocks of rows up to the first that is not whole, or not of the type of the others."""
    first: NDArray[np.void] | None = None
    while file.tell() < size:
        try:
            block = _read_array(file, size)
        except ValueError:
            return
        if block is None or (first is not None and block.dtype != first.dtype):
            return
        first = block
        yield block


def _read_array(file: BinaryIO, size: int) -> NDArray[Any] | None:
    """The next array, one-dimensional; None when the file of ``size`` bytes ends before it does.

    Raises:
        ValueError: What is there is not such an array.
    """
    version = npy.read_magic(file)
    if version != (1, 0):
        raise ValueError(f"array format {version}")
    shape, _, dtype = npy.read_array_header_1_0(file)
    if dtype.hasobject or len(shape) != 1:
        raise ValueError(f"array of shape {shape} and type {dtype}")
    needed = shape[0] * dtype.itemsize
    if needed > size - file.tell():
        return None
    return np.frombuffer(file.read(needed), dtype)
