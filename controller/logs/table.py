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
from haptic_wall.controller.logs.columns import COLUMNS, values
from haptic_wall.controller.logs.pieces import End, Event, fault_text
from haptic_wall.controller.logs.reader import LogReader
from haptic_wall.controller.logs.rows import LogRows, TimeSpan
from haptic_wall.controller.runtime.telemetry import ROW

_KINDS = [
    (name, "<f8" if name.endswith(("_s", "_us")) else ROW[field]) for name, field in COLUMNS.items()
]


@dataclass(frozen=True, slots=True)
class Log:
    """A log as one table."""

    rows: NDArray[np.void]
    """One tick each, shape (n,); its columns are those of ``haptic-wall log LOG --csv FILE``, with
    the unit in each name. A value that is not known is NaN."""
    metadata: Mapping[str, Any]
    """``program``, ``name``, ``config`` (the configuration at the start), ...; empty where that
    part of the file is damaged"""
    end: Mapping[str, Any] | None
    """``stop_reason``, ``message``, ``ticks``, ...; None: the run was cut off"""
    changes: tuple[Mapping[str, Any], ...]
    """Each request to change the running wall, as in the report's ``changes``"""
    faults: tuple[str, ...]
    """A sentence for each damaged part that was skipped"""


def read_log(
    path: str | os.PathLike[str], *, start_s: float = -math.inf, end_s: float = math.inf
) -> Log:
    """Read a log, or a stretch of it.

    Args:
        path: A file that a run has written, also one that is still being written.
        start_s: Only rows from this time on [s]; the log's first row has time 0.
        end_s: Only rows before this time [s].

    Raises:
        LogFormatError: It is not a log of this program.
        UserError: It cannot be read.
    """
    try:
        log = LogRows.of(LogReader(Path(path)), TimeSpan(start_s, end_s))
        pieces = list(log.pieces())
    except OSError as error:
        raise UserError(
            f"cannot be read: {error.strerror or error}",
            given=os.fspath(path),
            advice="wanted the log of a run, a .hwlog file",
        ) from None
    blocks = [piece for piece in pieces if isinstance(piece, np.ndarray)]
    rows = np.empty(sum(map(len, blocks)), np.dtype(_KINDS))
    at = 0
    for block in blocks:
        part = rows[at : at + len(block)]
        for column in COLUMNS:
            part[column] = values(block, column, log.origin_ns)
        at += len(block)
    ends = [piece.ended for piece in pieces if isinstance(piece, End)]
    return Log(
        rows=rows,
        metadata=log.metadata,
        end=ends[-1] if ends else None,
        changes=tuple(piece.change for piece in pieces if isinstance(piece, Event)),
        faults=tuple(text for piece in pieces for text in fault_text(piece)),
    )
