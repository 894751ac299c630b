"""A recorded motion from a CSV of anybody's.

What it does not hold as it should is mended where that can be done honestly, and told where not:
rows without a number are left out, uneven time stamps are brought onto a grid.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from controller.errors import UserError
from controller.log.reader import SUFFIX
from controller.log.recording import (
    GAP,
    LEAST,
    Floats,
    Knowledge,
    Part,
    Recording,
    parted,
    position_count,
)

NEEDED = ("time_s", "position_rad")
TORQUE = "torque_nm"
_UNEVEN = 0.25
"""Share of a period by which time stamps may be off and still count as on the grid."""
_MOST_UNEVEN = 0.01
"""Share of the time stamps that may be off by more without a new grid."""


def recording_of_csv(path: Path) -> Recording:
    """The motion in a CSV with the columns ``time_s``, ``position_rad``, perhaps ``torque_nm``.

    Raises:
        UserError: There is nothing in it to look at; the message says what was found.
        OSError: It cannot be read.
    """
    try:
        columns, notes = _columns(path)
    except csv.Error as error:
        raise UserError(
            f"LOG {path}: cannot be read as a CSV: {error}; wanted rows of numbers: is a quote left"
            " open?"
        ) from None
    times = columns["time_s"]
    ordered = np.concatenate([[True], times[1:] > np.maximum.accumulate(times)[:-1]])
    if not ordered.all():
        first = float(times[~ordered][0])
        notes.append(
            f"{np.count_nonzero(~ordered)} rows are left out: their time does not lie after that of"
            f" the rows before, first at {first:g} s"
        )
        columns = {name: values[ordered] for name, values in columns.items()}
        times = columns["time_s"]
    if times.size < LEAST:
        raise UserError(
            f"LOG {path}: found {times.size} rows with a time of their own, wanted at least {LEAST}"
        )
    missing = ~np.isfinite(columns["position_rad"])
    if np.count_nonzero(~missing) < LEAST:
        raise UserError(
            f"LOG {path}: found {np.count_nonzero(~missing)} rows with a position, wanted at least"
            f" {LEAST}"
        )
    if missing.any():
        at = float(times[missing][0])
        notes.append(f"{np.count_nonzero(missing)} rows have no position, first at {at:g} s")
    torques = columns.get(TORQUE)
    if torques is None:
        notes.append(f"there is no column {TORQUE}: judged by the motion alone, not by its energy")
    elif not np.isfinite(torques).all():
        notes.append(
            f"{np.count_nonzero(~np.isfinite(torques))} rows have no torque: the one before is"
            " taken to hold"
        )
        torques = _held(torques)
    steps = np.diff(times)
    usual = steps[np.abs(steps - np.median(steps)) <= 0.5 * np.median(steps)]
    # Samples that come in bursts may have no usual step.
    period = float(np.mean(usual if usual.size else steps))
    step = position_count(columns["position_rad"])
    whole = _even(Part(times, columns["position_rad"], torques, None), period, notes)
    return Recording(
        period, parted(whole, period, notes), Knowledge(position_step=step), tuple(notes)
    )


def _columns(path: Path) -> tuple[dict[str, Floats], list[str]]:
    """The known columns as numbers; a cell that is empty or nan is NaN."""
    with path.open(newline="", encoding="utf-8-sig", errors="replace") as file:
        reader = csv.reader(file)
        header = [name.strip() for name in next(reader, [])]
        absent = [name for name in NEEDED if name not in header]
        if absent:
            found = ", ".join(header[:8]) if any(header) else "nothing"
            raise UserError(
                f"LOG {path}: its first line has no column {' and no '.join(absent)}, found"
                f" {found[:200]}; wanted a CSV with {', '.join(NEEDED)} and, if known, {TORQUE},"
                f" or a {SUFFIX} file"
            )
        names = [name for name in (*NEEDED, TORQUE) if name in header]
        places = [header.index(name) for name in names]
        rows = list(_numbers(path, reader, places, names))
    table = np.array(rows, dtype=np.float64).reshape(-1, len(names))
    dated = np.isfinite(table[:, 0])
    notes = []
    if not dated.all():
        notes.append(f"{np.count_nonzero(~dated)} rows have no time and are left out")
    return dict(zip(names, table[dated].T, strict=True)), notes


def _numbers(
    path: Path, reader: Iterator[list[str]], places: list[int], names: list[str]
) -> Iterator[list[float]]:
    for line, row in enumerate(reader, 2):
        if not row:
            continue
        values = []
        for place, name in zip(places, names, strict=True):
            text = row[place].strip() if place < len(row) else ""
            try:
                values.append(float(text) if text else math.nan)
            except ValueError:
                raise UserError(
                    f"LOG {path}: line {line}, column {name}: found {text[:40]!r}, wanted a number"
                    " or an empty cell"
                ) from None
        yield values


def _even(whole: Part, period: float, notes: list[str]) -> Part:
    """The samples on a grid of ``period``: as they are, or interpolated where they are uneven."""
    steps = np.diff(whole.times) / period
    off = np.abs(steps - np.round(steps)) > _UNEVEN
    if np.count_nonzero(off) <= _MOST_UNEVEN * steps.size:
        return whole
    notes.append(
        f"{np.count_nonzero(off)} of {steps.size} time stamps are uneven: positions are"
        f" interpolated onto a grid of {1e3 * period:.4g} ms, so that small or fast oscillations"
        " are seen smaller than they are"
    )
    good = np.isfinite(whole.positions)
    times = whole.times[good]
    grid = np.arange(times[0], times[-1] + 0.5 * period, period)
    positions = np.interp(grid, times, whole.positions[good])
    latest = np.clip(np.searchsorted(times, grid, side="right") - 1, 0, times.size - 1)
    following = np.minimum(latest + 1, times.size - 1)
    positions[times[following] - times[latest] > GAP * period] = np.nan
    torques = None if whole.torques is None else whole.torques[good][latest]
    return Part(grid, positions, torques, None)


def _held(values: Floats) -> Floats:
    """The last known value where one is missing; 0 before the first."""
    good = np.isfinite(values)
    latest = np.maximum.accumulate(np.where(good, np.arange(values.size), -1))
    return np.where(latest >= 0, values[np.maximum(latest, 0)], 0.0)
