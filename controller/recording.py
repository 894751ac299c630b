"""A recorded motion, from a log of ours or from a CSV of anybody's, on an even grid of samples.

What the record does not hold as it should is mended where that can be done honestly, and told
where not: rows without a number are left out, uneven time stamps are brought onto a grid, and a gap
parts the record, since nobody knows what happened in it.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from controller.errors import UserError
from controller.logreader import SUFFIX

Floats = NDArray[np.float64]

NEEDED = ("time_s", "position_rad")
TORQUE = "torque_nm"
LEAST = 10
"""Samples that are worth a look."""
_GAP = 10
"""Periods without a sample from which on the record is in parts."""
_UNEVEN = 0.25
"""Share of a period by which time stamps may be off and still count as on the grid."""
_MOST_UNEVEN = 0.01
"""Share of the time stamps that may be off by more without a new grid."""
_ON_COUNTS = 0.02
"""Share of a count within which all steps of a counted position are whole ones."""


@dataclass(frozen=True, slots=True)
class Knowledge:
    """What the record itself says of the servo and its loop; NaN: nothing."""

    inertia: float = math.nan
    """[kg·m²], per torque commanded, as the others"""
    damping: float = math.nan
    """[N·m·s/rad]"""
    coulomb: float = math.nan
    """[N·m]"""
    lag: float = math.nan
    """From a sample to its torque acting [s]"""
    position_step: float = math.nan
    """Encoder count [rad]; 0: none"""
    virtual_damping: float = 0.0
    """Commanded [N·m·s/rad]"""
    surface: float = math.nan
    """Where the wall stands [rad]"""
    side: int = 0
    """0: two-sided; +1 or -1: it fills the positions above or below"""


@dataclass(frozen=True, slots=True)
class Recording:
    """A motion in parts, each on one even grid."""

    period: float
    """[s]"""
    parts: tuple[Part, ...]
    known: Knowledge
    notes: tuple[str, ...]
    """What was mended or left out, in sentences"""
    since_s: float = -math.inf
    """Samples before were in the recording before this one, and are here for what comes [s]"""
    of: int = 1
    """How many recordings there are in all"""

    @property
    def samples(self) -> int:
        """Of all parts."""
        return sum(part.times.size for part in self.parts)


@dataclass(frozen=True, slots=True)
class Part:
    """An uninterrupted stretch; arrays of one length."""

    times: Floats
    """[s]"""
    positions: Floats
    """[rad]; NaN where one is missing"""
    torques: Floats | None
    """Commanded at each sample [N·m]; None: not recorded"""
    stiffness: Floats | None
    """Commanded [N·m/rad]; None: not recorded"""


def read_recordings(path: Path) -> Iterator[Recording]:
    """Read a log of ours, or a CSV with the columns ``time_s``, ``position_rad``, ``torque_nm``.

    Args:
        path: What ends in .hwlog is a log, of which a long one comes in several recordings that
            overlap, so that never the whole is in memory; anything else is a CSV, one recording.
            The torque, the one commanded at that sample, may be missing.

    Raises:
        UserError: There is nothing in it to look at; the message says what was found.
        LogFormatError: It is not a log of ours.
        OSError: It cannot be read.
    """
    if path.suffix == SUFFIX:
        from controller.log_recording import recordings_of_log

        yield from recordings_of_log(path)
    else:
        yield _from_csv(path)


def _from_csv(path: Path) -> Recording:
    columns, notes = _columns(path)
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
    period = float(np.mean(usual))
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
    positions[times[following] - times[latest] > _GAP * period] = np.nan
    torques = None if whole.torques is None else whole.torques[good][latest]
    return Part(grid, positions, torques, None)


def parted(whole: Part, period: float, notes: list[str]) -> tuple[Part, ...]:
    """The record cut where samples are missing for long."""
    seen = np.flatnonzero(np.isfinite(whole.positions))
    breaks = np.flatnonzero(np.diff(whole.times[seen]) > _GAP * period)
    for at in breaks:
        start, end = whole.times[seen[at]], whole.times[seen[at + 1]]
        if at in breaks[:5]:
            notes.append(
                f"nothing is known from {start:.6g} to {end:.6g} s: looked at anew from there on"
            )
    if breaks.size > 5:
        notes.append(f"there are {breaks.size - 5} more such gaps")
    edges = [0, *(int(seen[at + 1]) for at in breaks), whole.times.size]
    parts = []
    for begin, end in pairwise(edges):
        inside = seen[(seen >= begin) & (seen < end)]
        if inside.size < LEAST:
            notes.append(f"{inside.size} samples from {whole.times[begin]:.6g} s on are too few")
            continue
        cut = slice(int(inside[0]), int(inside[-1]) + 1)
        parts.append(
            replace(
                whole,
                times=whole.times[cut],
                positions=whole.positions[cut],
                torques=None if whole.torques is None else whole.torques[cut],
                stiffness=None if whole.stiffness is None else whole.stiffness[cut],
            )
        )
    return tuple(parts)


def position_count(positions: Floats) -> float:
    """The encoder's count, if all steps of the position are whole counts [rad]; else 0."""
    moved = np.abs(np.diff(positions[np.isfinite(positions)]))
    least = float(np.max(moved, initial=0.0)) * 1e-9
    moved = moved[moved > least]
    if moved.size == 0:
        return 0.0
    small = float(moved.min())
    counts = moved / small
    few = counts < 50.0  # where rounding of the record's last digits does not yet tell
    whole = np.abs(counts - np.round(counts))[few] < _ON_COUNTS
    return small if few.sum() >= LEAST and bool(whole.all()) else 0.0


def _held(values: Floats) -> Floats:
    """The last known value where one is missing; 0 before the first."""
    good = np.isfinite(values)
    latest = np.maximum.accumulate(np.where(good, np.arange(values.size), -1))
    return np.where(latest >= 0, values[np.maximum(latest, 0)], 0.0)
