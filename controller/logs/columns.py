"""Names the columns of a log: in its file, in a CSV and on the live page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.runtime.telemetry import ROW

COLUMNS: Final = {
    "time_s": "deadline_ns",
    "position_rad": "position",
    "torque_nm": "torque",
    "velocity_rad_s": "velocity",
    "wall_torque_nm": "wall_torque",
    "stiffness": "stiffness",
    "damping": "damping",
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
    "sampled_s": "sampled_ns",
    "seq": "seq",
}
"""Columns of one axis, and the field of a row that each comes from"""
SHARED: Final = frozenset(("time_s", "missed_ticks", "lateness_us", "work_us", "bus_us", "seq"))
"""Columns that have one value for all axes"""
WHOLE: Final = frozenset(
    name for name, field in COLUMNS.items() if ROW[field].kind == "i" and not field.endswith("_ns")
)
"""Columns of whole numbers"""


def columns_of(axes: Sequence[str]) -> dict[str, tuple[str, int]]:
    """Return the columns of a log: of each the name in ``COLUMNS``, and the index of its axis.

    Args:
        axes: Names of the axes, which become the columns' prefixes; one empty name: no prefix.
    """
    return {
        name if name in SHARED or not axis else f"{axis}.{name}": (name, index)
        for name in COLUMNS
        for index, axis in enumerate(axes)
        if index == 0 or name not in SHARED
    }


def values(rows: NDArray[np.void], column: str, origin_ns: int) -> NDArray[Any]:
    """Return a column's values in the unit that its name gives, shape (n,).

    Args:
        rows: Shape (n,), dtype ``telemetry.ROW``.
        column: A key of ``COLUMNS``.
        origin_ns: Zero of ``time_s`` and ``sampled_s``, on the run's clock [ns].
    """
    raw: NDArray[Any] = rows[COLUMNS[column]]
    if column == "time_s":
        return (raw - origin_ns) / 1e9
    if column == "sampled_s":  # 0: no sample yet
        return np.where(raw != 0, (raw - origin_ns) / 1e9, np.nan)
    return raw / 1e3 if column.endswith("_us") else raw


def rows_of(table: Mapping[str, NDArray[Any]], origin_ns: int) -> NDArray[np.void]:
    """Return the rows that have these values, shape (n, axes), dtype ``telemetry.ROW``.

    It is the inverse of ``values``, exact for runs of up to 26 days.

    Args:
        table: Values of each of ``COLUMNS``, shape (n, axes), or (n, 1) of the ``SHARED`` ones.
        origin_ns: As for ``values`` [ns].

    Raises:
        ValueError: A time is not known, or too large.
    """
    rows = np.empty(table["position_rad"].shape, ROW)
    for name, field in COLUMNS.items():
        value = table[name]
        if field.endswith("_ns"):
            value = value * (1e3 if name.endswith("_us") else 1e9)
            unknown = np.isnan(value) & (name == "sampled_s")
            if not (np.abs(np.where(unknown, 0.0, value)) < _LARGEST_NS).all():
                raise ValueError(f"{name} holds no time")
            value = np.rint(np.where(unknown, 0.0, value)).astype(np.int64)
            if name.endswith("_s"):
                value = np.where(unknown, 0, value + origin_ns)
        rows[field] = value
    return rows


_LARGEST_NS: Final = 2.0**61
