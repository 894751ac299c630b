"""Converts a log's rows to the names and units of other tools: CSV, MCAP, the live stream."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

COLUMNS = {
    "time_s": "deadline_ns",
    "position_rad": "position",
    "torque_nm": "torque",
    "velocity_rad_s": "velocity",
    "wall_torque_nm": "wall_torque",
    "stiffness_nm_per_rad": "stiffness",
    "damping_nms_per_rad": "damping",
    "delay_s": "delay_s",
    "outcome": "outcome",
    "missed_ticks": "missed",
    "lateness_us": "lateness_ns",
    "work_us": "work_ns",
    "bus_us": "bus_ns",
    "sample_age_us": "age_ns",
    "flags": "flags",
    "phase": "phase",
    "oscillation": "oscillation",
    "measured_torque_nm": "measured_torque",
    "held_torque_nm": "held_torque",
}
"""Column names, and the field of a row that each comes from."""


def values(rows: NDArray[np.void], column: str, origin_ns: int) -> NDArray[Any]:
    """Return a column's values in the unit that its name gives, shape (n,).

    Args:
        rows: Shape (n,), dtype ``telemetry.ROW``.
        column: A key of ``COLUMNS``.
        origin_ns: Zero of ``time_s``, on the run's clock [ns].
    """
    raw: NDArray[Any] = rows[COLUMNS[column]]
    if column == "time_s":
        return (raw - origin_ns) / 1e9
    return raw / 1e3 if column.endswith("_us") else raw


def finite_rows(rows: NDArray[np.void], origin_ns: int) -> list[dict[str, float | int]]:
    """Return each row as a mapping from column to number, without unknown values."""
    columns = {name: values(rows, name, origin_ns) for name in COLUMNS}
    listed = {name: column.tolist() for name, column in columns.items()}
    known = [name for name, column in columns.items() if np.isfinite(column).all()]
    partly = [name for name in columns if name not in known]
    objects: list[dict[str, float | int]] = []
    for k in range(len(rows)):
        row = {name: listed[name][k] for name in known}
        row |= {name: listed[name][k] for name in partly if np.isfinite(listed[name][k])}
        objects.append(row)
    return objects
