"""Writes a log: rows, events and the run's report, each whole or not at all.

The journal is a write-ahead log, because in that mode a reader never holds up the recorder; see
docs/decisions/log-file.md.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import sqlite3
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.logs.columns import columns_of, values
from haptic_wall.controller.logs.file import (
    APPLICATION,
    BESIDE,
    ONE_AXIS,
    VERSION,
    as_os_error,
    connected,
    in_the_way,
    refuse_other,
    schema,
)
from haptic_wall.controller.system.files import would_be_lost


class LogWriter:
    """Writes one log.

    After ``append`` the rows survive a crash of this process; after ``sync`` also one of the
    machine.

    Args:
        path: The file to write.
        metadata: Values by their keys in the table ``meta``, as JSON can hold them.
        axes: Names of the axes.
        force: Replace a file; else one that exists is refused.
        resume: Continue the log of a dead writer; ``metadata`` and ``force`` do not matter.
        begun: Called with the value of ``identity`` as soon as the file is there, before it is a
            log: a writer that dies in between leaves no file that nobody may replace.

    Raises:
        OSError: The file cannot be written, or exists.
        LogFormatError: The file to resume is not a log.
    """

    def __init__(
        self,
        path: Path,
        metadata: Mapping[str, Any],
        axes: Sequence[str] = ONE_AXIS,
        *,
        force: bool = False,
        resume: bool = False,
        begun: Callable[[int], None] = lambda _identity: None,
    ) -> None:
        self._path = Path(os.path.realpath(path))
        self._columns = columns_of(axes).values()
        self._origin_ns: int | None = None
        self._closed = False
        if resume:
            refuse_other(self._path)
        else:
            _make(self._path, force=force)
        begun(identity(self._path))
        with contextlib.ExitStack() as undo, as_os_error(path):
            if not resume:
                undo.callback(self._path.unlink, missing_ok=True)
            self._db = undo.enter_context(contextlib.closing(connected(self._path, "mode=rw")))
            self._db.execute("PRAGMA synchronous=NORMAL")  # with a WAL: syncs at checkpoints only
            if resume:
                found = self._db.execute("SELECT value FROM meta WHERE key = 'origin_ns'")
                self._origin_ns = next((int(value) for (value,) in found), None)
            else:
                with self._whole():
                    self._db.execute(f"PRAGMA application_id={APPLICATION}")
                    self._db.execute(f"PRAGMA user_version={VERSION}")
                    for statement in schema(axes).values():
                        self._db.execute(statement)
                    self._set(metadata)
            self._db.execute("PRAGMA journal_mode=WAL")
            undo.pop_all()

    def append(self, rows: NDArray[np.void]) -> None:
        """Write rows, shape (ticks, axes), dtype ``telemetry.ROW``.

        Raises:
            OSError: They could not be written (a full disk); the log is as before, and ``append``
                may be called again.
        """
        if not len(rows):
            return
        origin_ns = self._origin_ns
        with as_os_error(self._path), self._whole():
            if origin_ns is None:
                origin_ns = int(rows[0, 0]["deadline_ns"])
                self._set({"origin_ns": origin_ns})
            columns = [
                values(rows[:, axis], name, origin_ns).tolist() for name, axis in self._columns
            ]
            into = f"INSERT INTO rows VALUES ({', '.join('?' * len(columns))})"
            self._db.executemany(into, zip(*columns, strict=True))
        self._origin_ns = origin_ns

    def seqs_from(self, seq: int) -> NDArray[np.int64]:
        """Return the numbers of the rows from ``seq`` on that are in the log, shape (n,)."""
        with as_os_error(self._path):
            found = self._db.execute("SELECT seq FROM rows WHERE seq >= ? ORDER BY seq", (seq,))
            return np.array([number for (number,) in found], np.int64)

    def event(self, change: Mapping[str, Any]) -> None:
        """Write a change of the running wall, as JSON can hold it.

        Raises:
            OSError: As ``append``.
        """
        with as_os_error(self._path), self._whole():
            self._db.execute(
                "INSERT INTO events VALUES (?, ?)", (change.get("at_s"), _json(change))
            )

    def end(self, report: Mapping[str, Any]) -> None:
        """Write the run's report, as JSON can hold it.

        Raises:
            OSError: As ``append``.
        """
        with as_os_error(self._path), self._whole():
            self._set({"report": report})

    def sync(self) -> None:
        """Move the rows written so far into the database, and wait until the disk keeps them.

        Raises:
            OSError: The disk fails. On a full one they stay in the journal.
        """
        with as_os_error(self._path), _unless(sqlite3.SQLITE_FULL):
            self._db.execute("PRAGMA wal_checkpoint").fetchall()

    def close(self) -> None:
        """Close the log as one file without a journal, if nobody reads it at this moment.

        Safe to call twice.

        Raises:
            OSError: As ``sync``.
        """
        if self._closed:
            return
        self._closed = True
        full_or_busy = _unless(sqlite3.SQLITE_FULL, sqlite3.SQLITE_BUSY)
        with contextlib.closing(self._db), as_os_error(self._path), full_or_busy:
            self._db.execute("PRAGMA journal_mode=DELETE").fetchall()

    def __enter__(self) -> LogWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _set(self, metadata: Mapping[str, Any]) -> None:
        self._db.executemany(
            "INSERT OR REPLACE INTO meta VALUES (?, ?)",
            [(key, _json(value)) for key, value in metadata.items()],
        )

    @contextlib.contextmanager
    def _whole(self) -> Iterator[None]:
        """Do all of it in one transaction, or none."""
        self._db.execute("BEGIN IMMEDIATE")
        try:
            yield
            self._db.execute("COMMIT")
        except BaseException:
            if self._db.in_transaction:
                self._db.execute("ROLLBACK")
            raise


def identity(path: Path) -> int:
    """Return a number that differs for a file put in place of this one; 0: there is no file."""
    try:
        return path.stat().st_ino & ((1 << 63) - 1)  # fits a word of shared memory
    except OSError:
        return 0


def append_end(
    path: Path, report: Mapping[str, Any], changes: Sequence[Mapping[str, Any]] = ()
) -> None:
    """Add the run's report to a log, even if the recorder has left it incomplete.

    Args:
        path: The log.
        report: As ``LogWriter.end``.
        changes: Changes that the recorder could not take.

    Raises:
        OSError: It cannot be written; the log stays readable.
        LogFormatError: The file is not a log.
    """
    with LogWriter(path, {}, resume=True) as log:
        for change in changes:
            log.event(change)
        log.end(report)


@contextlib.contextmanager
def _unless(*codes: int) -> Iterator[None]:
    """Ignore errors of these primary codes."""
    try:
        yield
    except sqlite3.OperationalError as error:
        if error.sqlite_errorcode & 0xFF not in codes:
            raise


def _make(path: Path, *, force: bool) -> None:
    """Make an empty file, and remove what an earlier log has left in its place.

    Raises:
        FileExistsError: It exists, and ``force`` is not given; or another file is where SQLite
            would put one.
        OSError: It cannot be made.
    """
    if (other := in_the_way(path)) is not None:
        raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(other))
    if force and path.is_file():  # a device stays
        path.unlink()
    try:
        os.close(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))
    except FileExistsError:
        if would_be_lost(path) or not path.is_file():
            raise
    for end in BESIDE:  # SQLite would take them for those of the new file
        path.with_name(path.name + end).unlink(missing_ok=True)


def _json(value: object) -> str:
    """Return a value as JSON, in which NaN is null."""
    return json.dumps(json.loads(json.dumps(value), parse_constant=lambda _: None))
