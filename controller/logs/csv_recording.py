"""Reads a recorded motion from a CSV: fixed column names, but written by any program.

It repairs irregular data where that is possible without guessing, and reports each repair: it
splits the record at long gaps, drops rows without a number, and interpolates uneven time stamps
onto a grid.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from haptic_wall.controller.detector.detection import position_step
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.logs.recording import (
    GAP,
    LEAST,
    MOST_ROWS,
    Floats,
    Part,
    Recording,
    parted,
    seconds,
)
from haptic_wall.controller.system.csv_table import read_columns

NEEDED = ("time_s", "position_rad")
TORQUE = "torque_nm"
MOST_BYTES = 1 << 29
_SPARSE = 2.0
"""Largest number of grid points per sample; more would mostly be invented."""
_UNEVEN = 0.25
"""Fraction of a period by which a time stamp may be off and still count as on the grid."""
_MOST_UNEVEN = 0.01
"""Fraction of the time stamps that may be off by more without interpolation."""
_CLOCK_S = 86_400.0
"""A first time from here on comes from a clock that did not start with the record [s]"""
_SLOW_S = 0.2
"""A longer time between samples is more likely in milliseconds [s]"""
_FAR = 4.0 * math.pi
"""A motion over a wider range is more likely in degrees or counts [rad]"""


def recording_of_csv(path: Path) -> Recording:
    """Return the motion in a CSV with the columns ``time_s``, ``position_rad``, ``torque_nm``.

    The torque may be missing.

    Raises:
        UserError: The file holds no usable motion; the message says what was found.
        OSError: It cannot be read, or is no regular file.
    """
    whole, notes = _whole(path)
    period = _period(whole.times)
    notes += _units(whole, period)
    parts = tuple(_even(part, period, notes) for part in parted(whole, period, notes))
    return Recording(period, parts, position_step(whole.positions), tuple(notes))


def columns_in_time(
    path: Path, known: tuple[str, ...], name: str
) -> tuple[dict[str, Floats], list[str]]:
    """Return the columns of the rows whose times increase, and sentences on what was left out.

    Args:
        path: The file.
        known: Columns that are read where they are, besides time and position.
        name: The argument or option that names the file, for messages.

    Raises:
        UserError: The file holds too few rows; the message says what was found.
        OSError: It cannot be read, or is no regular file.
    """
    limits = {"most_rows": MOST_ROWS, "most_bytes": MOST_BYTES}
    found = read_columns(path, NEEDED, known, field=name, **limits)
    columns = {column: np.frombuffer(numbers, np.float64) for column, numbers in found.items()}
    notes = []
    dated = np.isfinite(columns["time_s"])
    if not dated.all():
        notes.append(f"{np.count_nonzero(~dated)} rows have no time and are left out")
        columns = {column: values[dated] for column, values in columns.items()}
    times = columns["time_s"]
    ordered = np.concatenate([[True], times[1:] > np.maximum.accumulate(times)[:-1]])[: times.size]
    if not ordered.all():
        first = float(times[~ordered][0])
        notes.append(
            f"{np.count_nonzero(~ordered)} rows are left out: their time is not later than that of"
            f" the rows before, first at {seconds(first)} s"
        )
        columns = {column: values[ordered] for column, values in columns.items()}
        times = columns["time_s"]
    if times.size and abs(times[0]) >= _CLOCK_S:
        notes.append(f"times count from the first row's, {times[0]:.3f} s")
        columns["time_s"] = times - times[0]
    for count, what in (
        (times.size, "rows with increasing times"),
        (np.count_nonzero(np.isfinite(columns["position_rad"])), "rows with a position"),
    ):
        if count < LEAST:
            raise UserError(
                f"found {count} {what}", field=name, given=path, wanted=f"at least {LEAST}"
            )
    return columns, notes


def _whole(path: Path) -> tuple[Part, list[str]]:
    """Return all samples with increasing times, and sentences on repairs and omissions."""
    columns, notes = columns_in_time(path, (TORQUE,), "LOG")
    times = columns["time_s"]
    positions = columns["position_rad"]
    missing = ~np.isfinite(positions)
    if missing.any():
        at = float(times[missing][0])
        notes.append(f"{np.count_nonzero(missing)} rows have no position, first at {seconds(at)} s")
    torques = columns.get(TORQUE)
    if torques is None:
        notes.append(f"there is no column {TORQUE}: only the motion is judged, not its energy")
    elif not np.isfinite(torques).all():
        notes.append(
            f"{np.count_nonzero(~np.isfinite(torques))} rows have no torque: they count with the"
            " torque before them"
        )
        torques = held(torques, 0.0)
    return Part(times, positions, torques), notes


def held(values: Floats, before: float) -> Floats:
    """Replace missing values with the last known one; those before the first with ``before``."""
    good = np.isfinite(values)
    latest = np.maximum.accumulate(np.where(good, np.arange(values.size), -1))
    return np.where(latest >= 0, values[np.maximum(latest, 0)], before)


def _period(times: Floats) -> float:
    """Return the usual time between samples [s]."""
    steps = np.diff(times)
    median = np.median(steps)
    usual = steps[np.abs(steps - median) <= 0.5 * median]
    mean = float(np.mean(steps[steps <= GAP * median]))
    # Samples in bursts may have no usual step.
    period = float(np.mean(usual)) if usual.size else mean
    return period if mean <= _SPARSE * period else mean


def _units(whole: Part, period: float) -> Iterator[str]:
    """Ask for the units of a record that hardly is in s and rad."""
    if period > _SLOW_S:
        yield (
            f"the samples are {period:.4g} s apart: if time_s is in milliseconds, divide it by 1000"
        )
    moved = float(np.ptp(whole.positions[np.isfinite(whole.positions)]))
    if moved > _FAR:
        yield (
            f"the positions range over {moved:.4g} rad: if position_rad is in degrees or encoder"
            " counts, convert it"
        )


def _even(part: Part, period: float, notes: list[str]) -> Part:
    """Return the samples on a grid of ``period``: unchanged if even, else interpolated."""
    steps = np.diff(part.times) / period
    off = np.abs(steps - np.round(steps)) > _UNEVEN
    if np.count_nonzero(off) <= _MOST_UNEVEN * steps.size:
        return part
    notes.append(
        f"{np.count_nonzero(off)} of {steps.size} time stamps are uneven: positions are"
        f" interpolated onto a grid of {1e3 * period:.4g} ms, so that small or fast oscillations"
        " appear smaller than they are"
    )
    good = np.isfinite(part.positions)
    times = part.times[good]
    grid = np.arange(times[0], times[-1] + 0.5 * period, period)
    positions = np.interp(grid, times, part.positions[good])
    latest = np.clip(np.searchsorted(times, grid, side="right") - 1, 0, times.size - 1)
    torques = None if part.torques is None else part.torques[good][latest]
    return Part(grid, positions, torques)
