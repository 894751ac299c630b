"""Writes and reads log files: a stream of self-contained arrays, so that damage stays local.

A file is a sequence of ``.npy`` arrays with nothing between them: first the metadata, JSON as
bytes, then blocks of rows of one structured dtype, between them events, and last the run's end,
both JSON again.
``numpy.load`` on an open file reads them one after the other; each carries checksums, see
``blocks``.

A killed recorder or a full disk costs at most a block, and a reader skips damaged blocks. Equal
rows give equal bytes. Nothing is unpickled, so no log can run code. The file gets its name with its
first rows, so a run that cannot start costs no old log.

Other formats were rejected: CSV is slow and has no configuration; a killed writer ruins an HDF5,
``.npz`` or Parquet file; MCAP needs its library. Checksums in each row would not find a lost block.
A new field changes only the dtype; a new meaning of a field or of the framing raises ``version``.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import json
import os
import stat
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO, cast

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.errors import LogFormatError
from haptic_wall.controller.logs.blocks import MOST_BYTES, block_at, encoded
from haptic_wall.controller.logs.content import EVENT
from haptic_wall.controller.logs.reader import FORMAT, SUFFIX, Head, LogReader
from haptic_wall.controller.system.whole_file import Beside

__all__ = ["SUFFIX", "LogWriter", "append_end", "identity", "read_log"]


class LogWriter:
    """Writes one log; the same rows in the same blocks give the same bytes.

    Nothing is buffered: after ``append`` the rows are with the operating system and survive a crash
    of this process; after ``sync`` they also survive a crash of the machine.

    Args:
        path: The file to write; an existing file is replaced.
        metadata: Description of the rows, as JSON can hold it; NaN is not in JSON.
        dtype: Dtype of the rows, little-endian.
        beside: Temporary name of ``path``: the log is written there until it has rows, and then
            replaces the file at ``path``. None: it replaces it at once.

    Attributes:
        found: The last rows of a log that is continued, shape (n,); None: it had none.
        identity: The value of ``identity`` for the file.

    Raises:
        OSError: The file cannot be written.
        ValueError: The metadata cannot be JSON.
    """

    def __init__(
        self,
        path: Path,
        metadata: Mapping[str, Any],
        dtype: np.dtype[np.void],
        beside: Beside | None = None,
    ) -> None:
        # FORMAT comes first and overrides the metadata, which may come from another log.
        head = _json({**FORMAT, **metadata, **FORMAT})
        self._beside = beside
        if beside is not None:
            beside.begin()
        self._begin(path if beside is None else beside.part, dtype, "wb")
        try:
            self._write(head)
        except OSError:
            self.close()
            raise

    def _begin(self, path: Path, dtype: np.dtype[np.void], mode: str) -> None:
        self._folder = path.parent
        self._dtype = dtype
        self.found: NDArray[np.void] | None = None
        self._unsynced = True
        self._placed = False
        self._shortened = False
        self._file = cast(BinaryIO, path.open(mode, buffering=0))
        status = os.fstat(self._file.fileno())
        self.identity = _identity(status)
        self._is_file = stat.S_ISREG(status.st_mode)
        if self._is_file:  # a device (/dev/null) may have many writers
            with contextlib.suppress(OSError):  # a dying writer may still have it
                fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)

    @classmethod
    def resume(cls, path: Path, dtype: np.dtype[np.void]) -> LogWriter:
        """Continue a log whose writer is dead; bytes after its last whole block are removed.

        It takes the same time for a log of days as for one of minutes.

        Args:
            path: The log; it has no other writer any more.
            dtype: Dtype of its rows.

        Raises:
            LogFormatError: The file is not a log of such rows, or its metadata is incomplete.
            OSError: It cannot be read or written.
        """
        reader = LogReader(path)
        last = reader.last()
        if last is not None and last.array.dtype != dtype:
            raise LogFormatError(f"{path} is a log with other columns", advice="name another file")
        log = cls.__new__(cls)
        log._beside = None
        log._begin(path, dtype, "r+b")
        with contextlib.ExitStack() as undo:
            undo.callback(log._file.close)
            end = reader.start if last is None else last.end
            size = os.fstat(log._file.fileno()).st_size
            while (event := block_at(log._file, end, size)) is not None:
                end = event.end
            log.found = None if last is None else last.array
            log._file.truncate(end)
            log._file.seek(end)
            undo.pop_all()
        return log

    def append(self, rows: NDArray[np.void]) -> None:
        """Write rows, shape (n,), in blocks that a reader accepts; no rows write nothing.

        Raises:
            OSError: The rows could not be written (a full disk), or the file not put in place; the
                file is as before, and ``append`` may be called again.
        """
        if not len(rows):
            return
        most = MOST_BYTES // self._dtype.itemsize
        self._look_for_its_end()
        with _all_or_nothing(self._file):
            for start in range(0, len(rows), most):
                self._write(rows[start : start + most].astype(self._dtype, copy=False))
            if self._beside is not None:
                self._beside.place()
                self._beside = None

    def event(self, change: Mapping[str, Any]) -> None:
        """Write a change of the running wall, as JSON can hold it.

        Raises:
            OSError: As ``append``.
        """
        self._look_for_its_end()
        self._write(_json({EVENT: change}))

    def end(self, ended: Mapping[str, Any]) -> None:
        """Write the run's end, the last block of a log, as JSON can hold it.

        Raises:
            OSError: As ``append``.
        """
        self._write(_json(ended))

    def sync(self) -> None:
        """Wait until the disk keeps the rows written so far.

        Raises:
            OSError: The disk has lost data, or the file was truncated; raised once, and it is
                unknown which rows are lost.
        """
        self._tell_if_shortened()
        if not self._unsynced:
            return
        self._unsynced = False
        try:
            os.fdatasync(self._file.fileno())
            if not self._placed:  # without a sync of its folder the new file could be lost
                with contextlib.suppress(PermissionError):  # writable but not readable
                    self._place()
        except OSError as error:
            # Some file systems do not support this, and a device (/dev/null) keeps nothing.
            if error.errno != errno.EINVAL and self._is_file:
                raise

    def _look_for_its_end(self) -> None:
        """Seek to the file's present end, and note if the file became shorter."""
        if self._is_file and self._file.tell() > os.fstat(self._file.fileno()).st_size:
            self._file.seek(0, os.SEEK_END)  # a hole would be taken for rows
            self._shortened = True

    def _tell_if_shortened(self) -> None:
        self._look_for_its_end()
        if self._shortened:
            self._shortened = False
            raise OSError(errno.EIO, "another program has cut off its end")

    def _place(self) -> None:
        folder = os.open(self._folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
        self._placed = True

    def close(self) -> None:
        """Close the file; remove it if it never had rows.

        Safe to call twice.

        Raises:
            OSError: The file system has lost earlier data; or as ``sync``.
        """
        if self._beside is not None:
            self._beside.discard()
        if not self._file.closed:
            with self._file:
                self._tell_if_shortened()

    def __enter__(self) -> LogWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _write(self, array: NDArray[Any]) -> None:
        _write_block(self._file, array)
        self._unsynced = True


def identity(path: Path) -> int:
    """Return a number that differs for a file put in place of this one; 0: there is no file."""
    try:
        return _identity(path.stat())
    except OSError:
        return 0


def _identity(status: os.stat_result) -> int:
    return status.st_ino & ((1 << 63) - 1)  # fits a word of shared memory


def append_end(path: Path, ended: Mapping[str, Any], *, sync: bool = True) -> None:
    """Append the run's end to a log, even if the recorder has left it incomplete.

    Args:
        path: The log; if it is missing or empty, none is made.
        ended: Content, as JSON can hold it.
        sync: Wait until the disk keeps it.

    Raises:
        OSError: It cannot be written; the log stays readable.
    """
    if not path.is_file() or not path.stat().st_size:
        return
    with path.open("ab", buffering=0) as file:
        _write_block(file, _json(ended))
        if sync:
            os.fdatasync(file.fileno())


def _write_block(file: BinaryIO, array: NDArray[Any]) -> None:
    """Write a whole block to an unbuffered file, or none of it; writes may be partial."""
    with _all_or_nothing(file):
        for part in encoded(array):
            rest = memoryview(part)
            while rest:
                rest = rest[file.write(rest) :]


@contextlib.contextmanager
def _all_or_nothing(file: BinaryIO) -> Iterator[None]:
    """Truncate the file to its former end if an OSError interrupts a write."""
    start = file.tell() if file.seekable() else None  # a device cannot be truncated
    try:
        yield
    except OSError:
        # A reader would notice half a block, but none is better.
        if start is not None:
            with contextlib.suppress(OSError):
                file.truncate(start)
                file.seek(start)
        raise


def read_log(path: Path) -> tuple[dict[str, Any], NDArray[np.void]]:
    """Read a whole log; damaged parts are skipped with a warning in the program's log.

    Args:
        path: A file written by ``LogWriter``.

    Returns:
        The metadata, and all rows in the file's order, shape (n,); rows without fields if no block
        was written.

    Raises:
        LogFormatError: The file is not a log of this program.
        OSError: It cannot be read.
    """
    log = LogReader(path)
    blocks: list[NDArray[np.void]] = []
    for piece in log.pieces():
        if isinstance(piece, np.ndarray):
            blocks.append(piece)
        elif isinstance(piece, Head):
            raise LogFormatError(
                f"{path}: another log is joined to it", advice="part them with --cut"
            )
        else:
            log.warn(piece)
    return log.metadata, np.concatenate(blocks) if blocks else np.empty(0, np.dtype([]))


def _json(content: Mapping[str, Any]) -> NDArray[np.uint8]:
    text = json.dumps(content, ensure_ascii=False, allow_nan=False)
    # An excerpt keeps the metadata of a log, which may hold lone surrogates.
    return np.frombuffer(text.encode("utf-8", "surrogatepass"), np.uint8)
