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
from collections.abc import Mapping
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

    Raises:
        OSError: The file cannot be written.
        ValueError: The metadata cannot be JSON.
    """

    def __init__(self, path: Path, metadata: Mapping[str, Any], dtype: np.dtype[np.void]) -> None:
        self._dtype = dtype
        text = json.dumps({**FORMAT, **metadata}, ensure_ascii=False, allow_nan=False)
        self._file = path.open("wb", buffering=0)
        try:
            self._write(np.frombuffer(text.encode(), np.uint8))
        except OSError:
            self._file.close()
            raise

    def append(self, rows: NDArray[np.void]) -> None:
        """Write a block of rows, shape (n,); none writes nothing.

        Raises:
            OSError: It could not be written (a full disk); the file is what it was before, and
                may be appended to again.
        """
        if len(rows):
            self._write(rows.astype(self._dtype, copy=False))

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
        blocks: list[NDArray[np.void]] = []
        while (start := file.tell()) < size:
            try:
                block = _read_array(file, size)
            except ValueError:
                block = None
            if block is None or (blocks and block.dtype != blocks[0].dtype):
                _logger.warning(
                    "%s: the last %d bytes are not a complete block and were skipped; the run "
                    "that wrote them was cut off",
                    path,
                    size - start,
                )
                break
            blocks.append(block)
    return metadata, np.concatenate(blocks) if blocks else np.empty(0, np.dtype([]))


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
