"""Reads a log of any origin, in bounded memory: every value is checked before it is used.

The file may be one that no run has written. Its tables must be those of ``file.SCHEMA``, so no
view, trigger or generated column is ever evaluated.
"""

from __future__ import annotations

import contextlib
import math
import sqlite3
import time
from array import array
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.detector.state import State
from haptic_wall.controller.errors import LogFormatError, UserError
from haptic_wall.controller.logs.columns import COLUMNS, SHARED, WHOLE, columns_of, rows_of
from haptic_wall.controller.logs.file import (
    FAILED,
    MOST_BYTES,
    ONE_AXIS,
    as_os_error,
    axes_in,
    connected,
    quoted,
    refuse_other,
    schema,
)
from haptic_wall.controller.runtime.telemetry import ROW
from haptic_wall.controller.settings.axis_names import MOST_AXES, of_axis
from haptic_wall.controller.system import json_text
from haptic_wall.hw.names import did_you_mean
from haptic_wall.hw.servo import Outcome

_ROWS: Final = 1000
"""Rows in a block"""
_MOST_TEXT: Final = 1 << 24
"""Largest sum of all texts in a log [bytes]"""
_OPENING_S: Final = 3.0
"""Longest time to read everything but the rows [s]"""
_LARGEST: Final = 1e30
"""Larger than any number of a run; what is computed of such numbers stays finite"""
_STEPS: Final = 10_000
"""Steps of SQLite between two looks at the clock"""


ALL: Final = -math.inf, math.inf
"""The stretch that is a whole log"""


@dataclass(frozen=True, slots=True)
class LogReader:
    """A log, or a stretch of it; its rows, of one axis, can be read any number of times."""

    path: Path
    metadata: Mapping[str, Any]
    """``program``, ``name``, ``config`` (the configuration at the start), ..."""
    changes: tuple[dict[str, Any], ...]
    """Each request to change the running wall, as in the report's ``changes``"""
    end: Mapping[str, Any] | None
    """The run's report; None: the run goes on, or was killed"""
    stretch: tuple[float, float]
    """The times t with ``stretch[0] <= t < stretch[1]``, counted from the log's first row [s]"""
    axes: tuple[str, ...]
    """Names of the axes; one empty name: the log of one servo"""
    columns: Mapping[str, tuple[str, int]]
    """Columns that are read, as from ``columns_of``"""

    @classmethod
    def open(cls, path: Path, stretch: tuple[float, float] = ALL) -> LogReader:
        """Read everything but the rows; a log that is being written is read as far as it is.

        Raises:
            LogFormatError: The file is not a log of this program.
            OSError: It cannot be read, or is no regular file.
        """
        with _opened(path) as (db, axes):
            db.set_progress_handler(_clock(), _STEPS)
            metadata = {}
            for key, value in _texts(path, db, "SELECT key, value FROM meta"):
                metadata[key.decode("utf-8", "replace")] = _parsed(path, value)
            told = [
                _parsed(path, text) for _, text in _texts(path, db, "SELECT '', text FROM events")
            ]
        end = metadata.pop("report", None)
        origin_ns = metadata.get("origin_ns", 0)
        if end is not None and not isinstance(end, dict):
            raise refusal(path, "its report is no object")
        if type(origin_ns) is not int or abs(origin_ns) > 1 << 61:
            raise refusal(path, "its origin_ns is no time")
        if not all(map(_is_change, told)):
            raise refusal(path, "an event is no change of the wall")
        changes = tuple(_UNKNOWN | change for change in told)
        return cls(path, metadata, changes, end, stretch, axes, columns_of(axes))

    def axis(self, name: str | None) -> LogReader:
        """Return the log of one axis, as if it had run alone.

        Args:
            name: Its name; None: that of the only one.

        Raises:
            UserError: There is no such axis, or there are several.
        """
        if name is None and len(self.axes) == 1:
            name = self.axes[0]
        if name not in self.axes:
            names = ", ".join(filter(None, self.axes))
            raise UserError(
                "found none" if name is None else f"found {name}",
                field="--axis",
                wanted=f"one of {names}" if names else "none: the log is of one servo",
                advice=did_you_mean(name or "", self.axes),
            )
        if self.axes == ONE_AXIS:
            return self
        config, end = self.metadata.get("config"), self.end
        if isinstance(config, dict) and isinstance(config.get("axes"), dict):
            config = _alone(config, name)
        parts = end.get("axes") if end is not None else None
        if (
            end is not None
            and isinstance(parts, dict)
            and isinstance(part := parts.get(name), dict)
        ):
            if isinstance(end.get("bus"), dict) and isinstance(part.get("bus"), dict):
                part = part | {"bus": end["bus"] | part["bus"]}
            end = {key: value for key, value in end.items() if key != "axes"} | part
        changes = []
        for change in self.changes:
            new = change["changed"] or {}
            if (mine := of_axis(new, name)) or not new:
                changes.append({**change, "changed": mine or change["changed"]})
        return replace(
            self,
            metadata={**self.metadata, "config": config},
            changes=tuple(changes),
            end=end,
            axes=ONE_AXIS,
            columns={
                column: (each, 0)
                for column, (each, place) in self.columns.items()
                if each in SHARED or self.axes[place] == name
            },
        )

    @property
    def origin_ns(self) -> int:
        """Return the deadline of the log's first row [ns]; 0: it has none."""
        return int(self.metadata.get("origin_ns", 0))

    def blocks(self) -> Iterator[NDArray[np.void]]:
        """Yield the rows of the stretch, shape (n,), n > 0, dtype ``telemetry.ROW``.

        Those of the first axis, if there are several.

        Raises:
            LogFormatError: Some are not what a run writes.
            OSError: The file cannot be read.
        """
        return (rows[:, 0] for rows in self.ticks())

    def ticks(self) -> Iterator[NDArray[np.void]]:
        """Yield the rows of the stretch, shape (n, axes), n > 0, dtype ``telemetry.ROW``.

        Raises:
            LogFormatError: As ``blocks``.
            OSError: As ``blocks``.
        """
        where, values = self._where()
        last = None
        some = map(quoted, self.columns)
        with _opened(self.path) as (db, _):
            found = db.execute(
                f"SELECT {', '.join(some)} FROM rows NOT INDEXED {where} ORDER BY seq", values
            )
            while chunk := found.fetchmany(_ROWS):
                rows = self._typed(chunk)
                if (why := _fault(rows, last)) is not None:
                    raise refusal(self.path, why)
                last = rows[-1, 0]
                yield rows

    def _where(self) -> tuple[str, tuple[float, ...]]:
        """Return the condition of the stretch, and its values."""
        if self.stretch == ALL:
            return "", ()
        # Half a nanosecond, so that rounding of 0.003 s does not miss the row at 3 ms.
        start_s, end_s = self.stretch
        return "WHERE time_s >= ? AND time_s < ?", (start_s - 5e-10, end_s - 5e-10)

    def count(self) -> int:
        """Return the number of rows of the stretch, without looking at them.

        Raises:
            LogFormatError: As ``blocks``.
            OSError: As ``blocks``.
        """
        with _opened(self.path) as (db, _):
            where, values = self._where()
            found = db.execute(f"SELECT count(*) FROM rows NOT INDEXED {where}", values)
            return int(found.fetchone()[0])

    def rows(self) -> NDArray[np.void]:
        """Return all rows of the stretch, shape (n,), dtype ``telemetry.ROW``.

        Raises:
            LogFormatError: As ``blocks``.
            OSError: As ``blocks``.
        """
        return np.concatenate([np.empty(0, ROW), *self.blocks()])

    def _typed(self, chunk: list[tuple[Any, ...]]) -> NDArray[np.void]:
        """Return rows of SQLite as an array; texts and blobs are refused."""
        found: dict[str, list[NDArray[Any]]] = {}
        for (name, _), column in zip(self.columns.values(), zip(*chunk, strict=True), strict=True):
            try:
                numbers = _numbers(column, whole=name in WHOLE)
            except TypeError:
                why = f"its column {name} holds something else than numbers"
                raise refusal(self.path, why) from None
            if name not in WHOLE and (np.abs(numbers) > _LARGEST).any():
                raise refusal(self.path, f"its column {name} holds a number that nothing has")
            found.setdefault(name, []).append(numbers)
        table = {name: np.stack(columns, axis=1) for name, columns in found.items()}
        try:
            return rows_of(table, self.origin_ns)
        except ValueError as error:
            raise refusal(self.path, str(error)) from None


def _fault(rows: NDArray[np.void], before: np.void | None) -> str | None:
    """Name an implausible value in rows; None: all are plausible.

    Args:
        rows: Shape (n, axes), n > 0, dtype ``telemetry.ROW``.
        before: The row before them, of the first axis.
    """
    times = rows["deadline_ns"][:, 0]
    if (np.diff(times) <= 0).any() or (before is not None and times[0] <= before["deadline_ns"]):
        return "time_s does not increase in it"
    for name, kind in (("outcome", Outcome), ("oscillation", State)):
        if not np.isin(rows[name], list(kind)).all():
            return f"{name} has a value without a meaning in it"
    return None


def _is_change(told: object) -> bool:
    """Whether an event has what its readers use, each of the kind that they use."""
    if not isinstance(told, dict) or not {"set", "outcome"} <= {*told}:
        return False
    kinds = all(isinstance(told.get(name), kind) for name, kind in _EVENT.items())
    return kinds and all(isinstance(text, str) for text in told["set"])


_EVENT: Final = {
    **{"set": list, "outcome": str, "why": str | None, "at_s": float | int | None},
    **{"row": int | None, "changed": dict | None, "commanded": dict | None},
}
_UNKNOWN: Final = dict.fromkeys(("at_s", "row", "changed", "why"))


def _numbers(column: tuple[Any, ...], *, whole: bool) -> NDArray[Any]:
    """Return the numbers of a column, NaN for those that are missing.

    Raises:
        TypeError: There is something else in it.
    """
    if whole:
        return np.frombuffer(array("q", column), np.int64)
    try:
        return np.frombuffer(array("d", column), np.float64)
    except TypeError:
        known = [math.nan if each is None else each for each in column]
        return np.frombuffer(array("d", known), np.float64)


def _alone(config: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Return what ``Config.each`` has of an axis, of a configuration that need not be valid."""
    axes = config["axes"]
    found = {key: value for key, value in config.items() if key not in ("axes", "arm")}
    if isinstance(own := axes.get(name), dict):
        found |= own
    if isinstance(model := found.get("model"), dict) and len(axes) > 1:
        found["model"] = model | {"bare": True}
    return found


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[tuple[sqlite3.Connection, tuple[str, ...]]]:
    """Open a log for reading, with nothing of SQLite that a log does not need; name its axes.

    Raises:
        LogFormatError: It is not a log, or damaged.
        OSError: It cannot be read.
    """
    refuse_other(path)
    with _refused(path), contextlib.ExitStack() as stack:
        try:
            db, axes = _looked_at(path, "mode=ro", stack)
        except sqlite3.OperationalError as error:
            if error.sqlite_errorcode & 0xFF not in _NOT_WRITABLE:
                raise
            db, axes = _looked_at(path, "mode=ro&immutable=1", stack)
        yield db, axes


def _looked_at(
    path: Path, mode: str, stack: contextlib.ExitStack
) -> tuple[sqlite3.Connection, tuple[str, ...]]:
    """Return a connection to a file with the tables of a log, and the names of its axes."""
    db = stack.enter_context(contextlib.closing(connected(path, mode)))
    db.text_factory = bytes
    db.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MOST_BYTES)
    db.setlimit(sqlite3.SQLITE_LIMIT_COLUMN, (1 + MOST_AXES) * len(COLUMNS))
    db.set_progress_handler(_clock(), _STEPS)
    for pragma in ("trusted_schema=OFF", "query_only=ON", "cell_size_check=ON"):
        db.execute(f"PRAGMA {pragma}")
    tables = {}
    for name in schema(ONE_AXIS):
        found = db.execute(
            "SELECT sql FROM sqlite_master WHERE type = 'table' AND name = ? LIMIT 2", (name,)
        )
        tables[name] = [str(sql or b"", "utf-8", "replace") for (sql,) in found]
    axes = axes_in("".join(tables["rows"]))
    wanted = schema(axes)
    for name, made in tables.items():
        if made != [wanted[name]]:
            raise refusal(path, f"its table {name} is not one that this program makes")
    db.set_progress_handler(None, 0)
    return db, axes


@contextlib.contextmanager
def _refused(path: Path) -> Iterator[None]:
    """Turn an error of SQLite about the content into a refusal, about the file into an OSError."""
    with as_os_error(path):
        try:
            yield
        except FAILED as error:
            if getattr(error, "sqlite_errorcode", 0) & 0xFF in _CLOSED:
                raise
            raise refusal(path, str(error)) from None


_NOT_WRITABLE: Final = sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_READONLY
"""Errors of a file in a folder that cannot be written"""
_CLOSED: Final = (*_NOT_WRITABLE, sqlite3.SQLITE_BUSY, sqlite3.SQLITE_IOERR)


def _clock() -> Any:  # noqa: ANN401 - a callable
    end_s = time.monotonic() + _OPENING_S
    return lambda: time.monotonic() > end_s


def refusal(path: Path, why: str) -> LogFormatError:
    """Return the error about a file that no run has written, or that is damaged."""
    return LogFormatError(
        f"{path} is damaged or was not written by a run: {why}",
        advice="`sqlite3 FILE .recover` shows what is left",
    )


def _texts(path: Path, db: sqlite3.Connection, query: str) -> Iterator[tuple[bytes, bytes]]:
    size = 0
    for row in db.execute(query):
        if not all(isinstance(text, bytes) for text in row):
            raise refusal(path, "a text is missing in it")
        size += len(row[1]) + 1000
        if size > _MOST_TEXT:
            raise refusal(path, f"its texts have more than {_MOST_TEXT} bytes")
        yield row


def _parsed(path: Path, text: bytes) -> Any:  # noqa: ANN401 - JSON
    try:
        return json_text.parse(text)
    except (ValueError, RecursionError):
        raise refusal(path, "a text in it is no JSON") from None
