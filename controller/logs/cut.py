"""A stretch of a log as a log of its own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from haptic_wall.controller.logs.file import LogWriter
from haptic_wall.controller.logs.reader import End
from haptic_wall.controller.logs.rows import LogRows
from haptic_wall.controller.runtime.telemetry import ROW


def cut_log(path: Path, rows: LogRows, name: str, from_s: float, to_s: float) -> None:
    """Write the rows of a stretch, with the log's metadata and where they were cut from.

    Rows keep their numbers and their times; how the run ended goes along with its last rows.

    Args:
        path: Where to.
        rows: Of the log.
        name: What the log is called that they are cut from.
        from_s: Where the first of them lies in that log [s].
        to_s: And the last [s].

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
            elif isinstance(piece, End):
                log.end(piece.ended)
