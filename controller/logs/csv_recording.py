"""Reads a recorded motion from a CSV: fixed column names, but written by any program.

It repairs irregular data where that is possible without guessing, and reports each repair: it
splits the record at long gaps, drops rows without a number, and interpolates uneven time stamps
onto a grid.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.detector.detection import position_step
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.logs.csv_table import TORQUE, columns_of
from haptic_wall.controller.logs.recording import (
    GAP,
    LEAST,
    MOST_TOLD,
    Floats,
    Knowledge,
    Part,
    Recording,
    gap_text,
    parted,
    seconds,
    short_text,
    sliced,
)
from haptic_wall.controller.logs.windows import BEFORE_S, WINDOW

_DEEPEST = 4
"""Largest number of times that a stretch is split again at its own rate"""
_SPARSE = 2.0
"""Largest number of grid points per sample; more would mostly be invented."""


@dataclass(frozen=True, slots=True)
class Stretch:
    """Samples from ``start`` up to, but without, ``end``."""

    start: int
    end: int
    period: float
    """Usual time between samples [s]; NaN: there is one sample"""

    @property
    def size(self) -> int:
        """Return the number of samples."""
        return self.end - self.start


def stretches(times: Floats) -> list[Stretch]:
    """Split samples at long gaps, measured by the rate before and after.

    Two recordings a day apart, or of different rates, are two stretches.

    Args:
        times: Increasing, shape (n,), n > 0 [s].
    """
    return [
        Stretch(start, end, _period(times[start:end]))
        for start, end in _parted(times, 0, times.size, _DEEPEST)
    ]


def _parted(times: Floats, start: int, end: int, deeper: int) -> list[tuple[int, int]]:
    steps = np.diff(times[start:end])
    breaks = np.flatnonzero(steps > GAP * np.median(steps)) if steps.size else steps
    if breaks.size == 0 or deeper == 0:
        return [(start, end)]
    edges = start + np.concatenate([[0], breaks + 1, [end - start]])
    # Samples that are isolated at this rate may belong to a slower recording.
    short = np.diff(edges) < LEAST
    edges = np.concatenate([edges[:1], edges[1:-1][~(short[:-1] & short[1:])], edges[-1:]])
    if edges.size == 2:
        return [(start, end)]
    found = []
    for first, last in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        found += _parted(times, first, last, deeper - 1)
    return found


def _period(times: Floats) -> float:
    """Return the usual time between samples [s]."""
    if times.size < 2:
        return np.nan
    steps = np.diff(times)
    median = np.median(steps)
    usual = steps[np.abs(steps - median) <= 0.5 * median]
    mean = float(np.mean(steps))
    # Samples in bursts may have no usual step.
    period = float(np.mean(usual)) if usual.size else mean
    return period if mean <= _SPARSE * period else mean


_UNEVEN = 0.25
"""Fraction of a period by which a time stamp may be off and still count as on the grid."""
_MOST_UNEVEN = 0.01
"""Fraction of the time stamps that may be off by more without interpolation."""
_SAME = 0.02
"""Fraction by which the periods of two stretches may differ at one rate"""
_MOST_RECORDINGS = 20
"""Largest number of recordings, each with its own times, read from one file"""
_JOINT_S = 1.0
"""Time inserted between the end of one recording and the beginning of the next [s]"""
_CLOCK_S = 86_400.0
"""A first time from here on comes from a clock that did not start with the record [s]"""


_SLOW_S = 0.2
"""A longer time between samples is more likely in milliseconds [s]"""
_FAR = 4.0 * math.pi
"""A motion over a wider range is more likely in degrees or counts [rad]"""


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


def recordings_of_csv(path: Path) -> Iterator[Recording]:
    """Yield the motion in a CSV with the columns ``time_s``, ``position_rad``, ``torque_nm``.

    The torque may be missing. A long record gives several recordings that overlap. A change of the
    sampling rate starts another recording.

    Raises:
        UserError: The file holds no usable motion; the message says what was found.
        OSError: It cannot be read, or is no regular file.
    """
    whole, notes = _whole(path)
    known = Knowledge(position_step=position_step(whole.positions))
    found = stretches(whole.times)
    notes += _gaps(whole.times, found)
    groups = list(_alike([stretch for stretch in found if stretch.size >= LEAST]))
    of = -(-whole.times.size // WINDOW)
    for number, group in enumerate(groups):
        period = float(np.average([s.period for s in group], weights=[s.size for s in group]))
        notes += _units(whole, period) if not number else ()
        if number:
            since = whole.times[group[0].start]
            notes.append(f"from {seconds(since)} s on the samples are {1e3 * period:.4g} ms apart")
        parts = [
            part
            for stretch in group
            for part in parted(
                _even(sliced(whole, stretch.start, stretch.end), period, notes), period, notes
            )
        ]
        for some, since_s in _windowed(parts):
            yield Recording(period, some, known, tuple(notes), since_s, of)
            notes = []
    if not groups or notes:
        yield Recording(np.nan, (), known, tuple(notes))


def columns_in_time(
    path: Path, known: tuple[str, ...], name: str
) -> tuple[dict[str, Floats], list[str]]:
    """Return the columns of the rows whose times increase, and sentences on what was changed.

    Recordings that follow each other in one file are shifted to follow each other in time.

    Args:
        path: The file.
        known: Columns that are read where they are, besides time and position.
        name: The argument or option that names the file, for messages.

    Raises:
        UserError: The file holds too few rows; the message says what was found.
        OSError: It cannot be read, or is no regular file.
    """
    columns, notes = columns_of(path, known, name)
    times = columns["time_s"]
    times, going_on = _going_on(times)
    notes += going_on
    columns["time_s"] = times
    ordered = _ordered(times)
    if not ordered.all():
        first = float(times[~ordered][0])
        notes.append(
            f"{np.count_nonzero(~ordered)} rows are left out: their time is not later than that of"
            f" the rows before, first at {seconds(first)} s"
        )
        columns = {column: values[ordered] for column, values in columns.items()}
        times = columns["time_s"]
    if times.size < LEAST:
        raise UserError(
            f"found {times.size} rows with increasing times",
            field=name,
            given=path,
            wanted=f"at least {LEAST}",
        )
    if abs(times[0]) >= _CLOCK_S:
        notes.append(f"times count from the first row's, {times[0]:.3f} s")
        columns["time_s"] = times - times[0]
    found = np.count_nonzero(np.isfinite(columns["position_rad"]))
    if found < LEAST:
        raise UserError(
            f"found {found} rows with a position",
            field=name,
            given=path,
            wanted=f"at least {LEAST}",
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
        torques = _held(torques)
    return Part(times, positions, torques, None), notes


def _ordered(times: Floats) -> NDArray[np.bool_]:
    """Whether each sample's time is later than all times before it."""
    return np.concatenate([[True], times[1:] > np.maximum.accumulate(times)[:-1]])


def _going_on(times: Floats) -> tuple[Floats, list[str]]:
    """Shift the times of recordings that restart, so that each follows the last by one second."""
    notes = []
    for _ in range(_MOST_RECORDINGS):
        anew = _begin_anew(times)
        if anew.size == 0:
            break
        at = int(anew[0])
        before = float(np.max(times[:at]))
        notes.append(
            f"time goes back from {seconds(before)} to {seconds(times[at])} s: the rows from there"
            " count as another recording, one second after the one before"
        )
        times = np.concatenate([times[:at], times[at:] + (before + _JOINT_S - times[at])])
    return times, notes


def _begin_anew(times: Floats) -> NDArray[np.intp]:
    """Find where times go back and then continue evenly below the earlier times."""
    if times.size <= LEAST:
        return np.empty(0, np.intp)
    latest = np.maximum.accumulate(times)
    backs = np.concatenate([[0], np.cumsum(np.diff(times) <= 0.0)])  # up to each sample
    at = np.flatnonzero(np.diff(backs) > 0) + 1
    at = at[at + LEAST <= times.size]
    goes_on = backs[at + LEAST - 1] == backs[at]
    anew: NDArray[np.intp] = at[goes_on & (times[at + LEAST - 1] <= latest[at - 1])]
    return anew


def _gaps(times: Floats, found: list[Stretch]) -> Iterator[str]:
    """Describe the gaps between stretches, and the stretches that are too short."""
    gaps = [(times[a.end - 1], times[b.start]) for a, b in pairwise(found)]
    yield from (gap_text(start, end) for start, end in gaps[:MOST_TOLD])
    if len(gaps) > MOST_TOLD:
        yield f"there are {len(gaps) - MOST_TOLD} more such gaps"
    short = [stretch for stretch in found if stretch.size < LEAST]
    yield from (short_text(s.size, times[s.start]) for s in short[:MOST_TOLD])
    if len(short) > MOST_TOLD:
        lost = sum(stretch.size for stretch in short[MOST_TOLD:])
        yield f"there are {lost} more samples in stretches that are too short"


def _alike(found: list[Stretch]) -> Iterator[list[Stretch]]:
    """Group consecutive stretches that have one rate."""
    group: list[Stretch] = []
    for stretch in found:
        if group and abs(stretch.period - group[0].period) > _SAME * group[0].period:
            yield group
            group = []
        group.append(stretch)
    if group:
        yield group


def _windowed(parts: list[Part]) -> Iterator[tuple[tuple[Part, ...], float]]:
    """Yield the parts in pieces of bounded size, and the time from which each piece is new [s]."""
    held: list[Part] = []
    samples = 0
    for part in parts:
        samples += part.times.size
        if held and samples > WINDOW:
            yield tuple(held), -math.inf
            held, samples = [], part.times.size
        if part.times.size <= WINDOW:
            held.append(part)
            continue
        samples = 0
        for start in range(0, part.times.size, WINDOW):
            since_s = float(part.times[start]) if start else -math.inf
            again = int(np.searchsorted(part.times, since_s - BEFORE_S))
            again = max(again, start - WINDOW, 0)
            yield (sliced(part, again, start + WINDOW),), since_s
    if held:
        yield tuple(held), -math.inf


def _even(whole: Part, period: float, notes: list[str]) -> Part:
    """Return the samples on a grid of ``period``: unchanged if even, else interpolated."""
    steps = np.diff(whole.times) / period
    off = np.abs(steps - np.round(steps)) > _UNEVEN
    if np.count_nonzero(off) <= _MOST_UNEVEN * steps.size:
        return whole
    notes.append(
        f"{np.count_nonzero(off)} of {steps.size} time stamps are uneven: positions are"
        f" interpolated onto a grid of {1e3 * period:.4g} ms, so that small or fast oscillations"
        " appear smaller than they are"
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
    """Replace missing values with the last known one; 0 before the first."""
    good = np.isfinite(values)
    latest = np.maximum.accumulate(np.where(good, np.arange(values.size), -1))
    return np.where(latest >= 0, values[np.maximum(latest, 0)], 0.0)
