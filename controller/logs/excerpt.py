"""Writes a stretch of a log as a log of its own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from haptic_wall.controller.logs.file import LogWriter
from haptic_wall.controller.logs.reader import End, Event
from haptic_wall.controller.logs.rows import LogRows
from haptic_wall.controller.runtime.telemetry import ROW


def write_excerpt(path: Path, rows: LogRows, name: str, from_s: float, to_s: float) -> None:
    """Write the rows of a stretch, with the log's metadata and the excerpt's place in the log.

    Rows keep their numbers and their times. The events up to them come along; with the log's last
    rows the run's end does, too.

    Args:
        path: The file to write.
        rows: Rows of the log.
        name: The name of the log.
        from_s: Time of the first row in that log [s].
        to_s: Time of the last row [s].

    Raises:
        OSError: The file cannot be written.
    """
    metadata = rows.metadata
    cut: dict[str, Any] = {"log": name, "from_s": from_s, "to_s": to_s}
    if "cut" in metadata:
        cut["earlier"] = metadata["cut"]
    with LogWriter(path, {**metadata, "cut": cut}, ROW) as log:
        for piece in rows.pieces():
            if isinstance(piece, np.ndarray):
                log.append(piece)
            elif isinstance(piece, Event):
                log.event(piece.change)
            elif isinstance(piece, End):
                log.end(piece.ended)
