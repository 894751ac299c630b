"""Defines a log's file: one SQLite database, and how it is opened and refused."""

from __future__ import annotations

import contextlib
import errno
import os
import re
import sqlite3
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from haptic_wall.controller.errors import LogFormatError
from haptic_wall.controller.logs.columns import WHOLE, columns_of
from haptic_wall.controller.settings.axis_names import MOST_AXES, NAME
from haptic_wall.controller.system.files import opened

SUFFIX: Final = ".hwlog"
APPLICATION: Final = 0x6877_6C67
"""``application_id`` of the file: the letters hwlg"""
VERSION: Final = 1
"""``user_version`` of the file. A new column or a new meaning raises it."""
ONE_AXIS: Final = ("",)
"""Names of the axes of a log of one servo"""
_PREFIX: Final = re.compile(rf'"({NAME})\.position_rad"')
MOST_BYTES: Final = 1 << 22
"""Largest text in a log: its configuration, an event, its report [bytes]"""
BESIDE: Final = ("-wal", "-shm", "-journal")
"""Ends of the names of files that SQLite keeps beside a database while it is written"""
_HEAD: Final = b"SQLite format 3\x00"
_BEFORE: Final = b"\x93NUMPY"
"""Beginning of the logs of version 0.1"""
FAILED: Final = (sqlite3.Error, UnicodeDecodeError)
"""Errors of SQLite; the last is its complaint about a damaged name, which Python cannot read"""
_ERRORS: Final = {
    sqlite3.SQLITE_FULL: errno.ENOSPC,
    sqlite3.SQLITE_BUSY: errno.EBUSY,
    sqlite3.SQLITE_READONLY: errno.EROFS,
    sqlite3.SQLITE_CANTOPEN: errno.EACCES,
}


def schema(axes: Sequence[str]) -> dict[str, str]:
    """Return the statement that makes each table of a log of these axes."""
    kinds = {
        quoted(column): "INTEGER" if name in WHOLE else "REAL"
        for column, (name, _) in columns_of(axes).items()
    } | {"seq": "INTEGER PRIMARY KEY"}
    return {
        "rows": f"CREATE TABLE rows ({', '.join(map(' '.join, kinds.items()))})",
        "events": "CREATE TABLE events (time_s REAL, text TEXT)",
        "meta": "CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT)",
    }


def axes_in(statement: str) -> tuple[str, ...]:
    """Return the names of the axes in the statement that made ``rows``."""
    return tuple(_PREFIX.findall(statement)[:MOST_AXES]) or ONE_AXIS


def quoted(column: str) -> str:
    """Return a column's name as SQL wants it."""
    return f'"{column}"' if "." in column else column


def is_log(path: Path) -> bool:
    """Whether a file is to be read as a log, by its content or its name.

    Raises:
        OSError: It cannot be read, or is no regular file.
    """
    with opened(path) as file:
        begin = file.read(len(_HEAD))
    return begin == _HEAD or begin.startswith(_BEFORE) or path.suffix == SUFFIX


def in_the_way(path: Path) -> Path | None:
    """Return a file that SQLite would take for one beside a new log; None: there is none.

    Those beside a database, or an empty file, belong to it.

    Args:
        path: The log.
    """
    with contextlib.suppress(OSError), opened(path) as file:
        if file.read(len(_HEAD)) in (b"", _HEAD):
            return None
    places = (path.with_name(path.name + end) for end in BESIDE)
    return next(filter(os.path.lexists, places), None)


def is_held(path: Path) -> bool:
    """Whether a program has a log open, such as the run that writes it; False: it is no log."""
    try:
        with contextlib.closing(connected(path, "mode=rw")) as db:
            db.execute("PRAGMA busy_timeout=0")
            (mode,) = db.execute("PRAGMA journal_mode=DELETE").fetchone()
            return bool(mode == "wal")
    except FAILED as error:
        return getattr(error, "sqlite_errorcode", 0) & 0xFF == sqlite3.SQLITE_BUSY


def refuse_other(path: Path) -> None:
    """Refuse a file that is no log of this program by its first bytes.

    Raises:
        LogFormatError: It is not.
        OSError: It cannot be read, or is no regular file.
    """
    with opened(path) as file:
        head = file.read(100)
    if head.startswith(_BEFORE):
        raise LogFormatError(
            f"{path} is a log of a version before 0.2",
            advice="read it with the haptic-wall that wrote it",
        )
    if not head.startswith(_HEAD) or head[68:72] != APPLICATION.to_bytes(4, "big"):
        raise LogFormatError(
            f"{path} is not a log of haptic-wall", advice=f"wanted a {SUFFIX} file of a run"
        )
    if head[60:64] != VERSION.to_bytes(4, "big"):
        raise LogFormatError(
            f"{path} is a log of format version {int.from_bytes(head[60:64], 'big')}, this program"
            f" reads version {VERSION}",
            advice="read it with the haptic-wall that wrote it",
        )


def connected(path: Path, mode: str) -> sqlite3.Connection:
    """Open a database as a URI, so that no character of its name has a meaning.

    Args:
        path: The file.
        mode: Parameters of the URI.
    """
    place = Path(os.path.realpath(path)).as_uri()
    return sqlite3.connect(f"{place}?{mode}", uri=True, isolation_level=None)


@contextlib.contextmanager
def as_os_error(path: Path) -> Iterator[None]:
    """Turn an error of SQLite into an ``OSError`` that says what the system said."""
    try:
        yield
    except FAILED as error:
        number = _ERRORS.get(getattr(error, "sqlite_errorcode", 0) & 0xFF, errno.EIO)
        text = os.strerror(number) if number == errno.ENOSPC else str(error)
        raise OSError(number, text, str(path)) from error
