"""Reads a log into one NumPy table in SI units, for people's own programs."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.errors import UserError
from haptic_wall.controller.logs.columns import COLUMNS, columns_of, values
from haptic_wall.controller.logs.reader import LogReader
from haptic_wall.controller.runtime.telemetry import ROW


def _kind(name: str) -> Any:  # noqa: ANN401 - what NumPy takes for a type
    return "<f8" if name.endswith(("_s", "_us")) else ROW[COLUMNS[name]]


@dataclass(frozen=True, slots=True)
class Log:
    """A log as one table."""

    rows: NDArray[np.void]
    """One tick each, shape (n,); its columns are those of ``haptic-wall log LOG --csv FILE``, with
    the unit in each name. A value that is not known is NaN."""
    metadata: Mapping[str, Any]
    """``program``, ``name``, ``config`` (the configuration at the start), ..."""
    end: Mapping[str, Any] | None
    """The run's report; None: the run goes on, or was killed"""
    changes: tuple[Mapping[str, Any], ...]
    """Each request to change the running wall, as in the report's ``changes``"""


def read_log(
    path: str | os.PathLike[str], *, start_s: float = -math.inf, end_s: float = math.inf
) -> Log:
    """Read a log, or a stretch of it.

    Args:
        path: A file that a run has written, also one that is still being written.
        start_s: Only rows from this time on [s]; the log's first row has time 0.
        end_s: Only rows before this time [s].

    Raises:
        LogFormatError: It is not a log of this program, or damaged.
        UserError: It cannot be read.
    """
    try:
        log = LogReader.open(Path(path), (start_s, end_s))
        blocks = [*log.ticks()]
    except OSError as error:
        raise UserError(
            f"cannot be read: {error.strerror or error}",
            given=os.fspath(path),
            advice="wanted the log of a run, a .hwlog file",
        ) from None
    columns = columns_of(log.axes)
    kinds = [(column, _kind(name)) for column, (name, _) in columns.items()]
    raw = np.concatenate([np.empty((0, len(log.axes)), ROW), *blocks])
    rows = np.empty(len(raw), np.dtype(kinds))
    for column, (name, axis) in columns.items():
        rows[column] = values(raw[:, axis], name, log.origin_ns)
    return Log(rows=rows, metadata=log.metadata, end=log.end, changes=log.changes)
