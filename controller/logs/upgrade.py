"""Converts rows of earlier log versions to today's: fills later columns with their old meaning."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.errors import LogFormatError
from haptic_wall.controller.runtime.telemetry import ROW

_LATER: Final = {"phase": 0, "oscillation": 0, "measured_torque": math.nan, "held_torque": 0.0}
"""Columns that the first logs lacked, with the values that applied then: no program, no watch, no
measurement, nothing held"""


def upgraded(rows: NDArray[Any], path: Path) -> NDArray[np.void]:
    """Return the rows with all columns of ``telemetry.ROW``, shape (n,).

    Args:
        rows: Shape (n,), of columns in ``ROW``.
        path: The log, for the message.

    Raises:
        LogFormatError: A column is missing that every version has.
    """
    if rows.dtype == ROW:
        return rows
    names = rows.dtype.names or ()
    missing = [name for name in ROW.names or () if name not in names and name not in _LATER]
    if missing:
        raise LogFormatError(
            f"{path}: its rows have no column {' and no '.join(missing)}",
            advice="read it with the haptic-wall that wrote it",
        )
    whole = np.zeros(len(rows), ROW)
    for name in names:
        whole[name] = rows[name]
    for name in _LATER:
        if name not in names:
            whole[name] = _LATER[name]
    return whole
