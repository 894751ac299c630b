"""Reads a recorded motion, and finds the stretches in which every torque is known."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.detector.detection import position_step
from haptic_wall.controller.experiments.identify.motion import Motion, Pieces
from haptic_wall.controller.experiments.identify.motion import pieces_of as cut_at
from haptic_wall.controller.experiments.recorded.friction import LONGEST_DELAY_S
from haptic_wall.controller.logs.csv_recording import TORQUE, columns_in_time, held
from haptic_wall.controller.logs.recording import GAP, seconds
from haptic_wall.controller.theory.checks import FloatArray

CURRENT = "current_a"
ENABLED = "torque_enabled"
OPTION = "--record"
_ROW_S = 0.006
"""Rows are thinned to about this interval [s]"""
_LONGEST_GAP_S = 0.1
_FASTEST = 60.0
"""Faster than any servo turns [rad/s]: such a jump is none of motion"""
_LET_GO_S = 0.01
"""From the row that says "free" until no current flows any more, at most [s]"""
_MOVES = 6
"""Least excursion of a stretch that moves, in encoder steps"""
_LEAST_MOVED = 0.01
"""The same for an encoder whose step is smaller [rad]"""
_LEAST_ROWS = 30
_REST_S = 0.15
"""Rest that is kept at the end of a free swing [s]"""
_FEWEST = 8
"""Least number of steps of a piece"""
_STEP_S, _BEFORE_S = 0.0085, 1e-6
"""Longest step of the simulation [s]; from the end of a stretch until its torque ceases [s]"""
DRIVEN_S, FREE_S = 1.0, 12.0
"""Longest piece that is moved in one go [s]"""
MOST_PIECES = 80
_MOST_TOLD = 5
"""Largest number of places reported one by one"""


@dataclass(frozen=True, slots=True)
class Record:
    """A recorded motion."""

    stretches: tuple[Motion, ...]
    """Consecutive rows in which every torque is known; torques in ``unit``, 0 where the motor is
    off"""
    unit: str | None
    """Unit of the torques: "N·m" or "A"; None: none is known"""
    step: float
    """Encoder step [rad]; 0: none"""
    notes: tuple[str, ...]
    """Sentences about rows that were repaired or left out"""


def read_record(path: Path) -> Record:
    """Read a CSV with the columns ``time_s`` and ``position_rad``, and what it has of torques.

    Raises:
        UserError: The file holds no motion; the message says what was found.
        OSError: It cannot be read, or is no regular file.
    """
    columns, notes = columns_in_time(path, (TORQUE, CURRENT, ENABLED), OPTION)
    return record_of(columns, notes)


def record_of(columns: dict[str, FloatArray], notes: list[str] | None = None) -> Record:
    """Return the stretches of a record.

    Args:
        columns: ``time_s``, ``position_rad`` and, where known, ``torque_nm``, ``current_a`` and
            ``torque_enabled``; arrays of one length, times increasing.
        notes: Sentences about the reading.
    """
    notes = list(notes or ())
    seen = np.isfinite(columns["position_rad"])
    if not seen.all():
        first = float(columns["time_s"][~seen][0])
        count = np.count_nonzero(~seen)
        notes.append(f"{count} rows have no position, first at {seconds(first)} s")
    step = position_step(columns["position_rad"])
    torque, unit = _torque(columns, notes)
    enabled = columns.get(ENABLED)
    free = np.zeros(seen.shape, dtype=bool) if enabled is None else held(enabled, 1.0) == 0.0
    torque = np.where(free, 0.0, torque)
    time = columns["time_s"]
    position = columns["position_rad"]
    found = []
    least = max(_MOVES * step, _LEAST_MOVED)
    still = short = 0
    for part in _known_rows(time, position, torque, seen, notes):
        rows, since = part, part[0]
        if bool(free[since]) and since > 0 and not free[since - 1]:
            rows = rows[time[rows] >= time[since] + _LET_GO_S]
        rows = rows if np.any(torque[rows] != 0.0) else _until_rest(time, position, rows)
        if rows.size < _LEAST_ROWS:
            short += rows.size
        elif float(np.ptp(position[rows])) < least:
            still += 1
        else:
            found.append(Motion(time[rows], position[rows], time[rows], torque[rows]))
    if short:
        notes.append(f"{short} rows with a known torque are left out: their parts are too short")
    if still:
        notes.append(f"in {still} parts with a known torque the shaft rests: they are left out")
    return Record(tuple(found), unit, step, tuple(notes))


def _torque(columns: dict[str, FloatArray], notes: list[str]) -> tuple[FloatArray, str | None]:
    """Return torque or current, NaN where unknown, and its unit."""
    for name, unit in ((TORQUE, "N·m"), (CURRENT, "A")):
        values = columns.get(name)
        if values is not None and np.isfinite(values).any():
            if unit == "N·m" and CURRENT in columns:
                notes.append(f"the column {CURRENT} is not used, since there is {TORQUE}")
            return values, unit
    return np.full(columns["time_s"].shape, np.nan), None


def _known_rows(
    time: FloatArray,
    position: FloatArray,
    torque: FloatArray,
    seen: NDArray[np.bool_],
    notes: list[str],
) -> list[NDArray[np.intp]]:
    """Return the rows of each stretch with known torques, without gaps and jumps."""
    rows = np.flatnonzero(seen)
    steps = np.diff(time[rows])
    period = float(np.median(steps))
    longest = min(max(GAP * period, 0.02), max(_LONGEST_GAP_S, 1.5 * period))
    gaps = steps > longest
    jumps = np.abs(np.diff(position[rows])) > _FASTEST * np.maximum(steps, period)
    for what, breaks in (("nothing is known", gaps), ("the position jumps", jumps & ~gaps)):
        at = np.flatnonzero(breaks)
        for each in at[:_MOST_TOLD]:
            begin, end = seconds(time[rows[each]]), seconds(time[rows[each + 1]])
            notes.append(f"{what} from {begin} to {end} s: a new part begins there")
        if at.size > _MOST_TOLD:
            unit = "; is position_rad in radians?" if 4 * at.size > rows.size else ""
            notes.append(f"there are {at.size - _MOST_TOLD} more such places{unit}")
    known = np.isfinite(torque[rows])
    edges = np.flatnonzero(gaps | jumps | np.diff(known)) + 1
    parts = np.split(rows, edges)
    return [part for part in parts if part.size and np.isfinite(torque[part[0]])]


def _until_rest(time: FloatArray, position: FloatArray, rows: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return the rows until the shaft has come to rest."""
    if not rows.size:
        return rows
    away = np.flatnonzero(np.abs(position[rows] - position[rows[-1]]) > 1e-9)
    if not away.size:
        return rows[:1]
    end = int(np.searchsorted(time[rows], time[rows[away[-1]]] + _REST_S, side="right"))
    return rows[:end]


def pieces_of(
    stretches: tuple[Motion, ...],
    longest_free_s: float = FREE_S,
    longest_driven_s: float = DRIVEN_S,
) -> tuple[Pieces, NDArray[np.intp]]:
    """Cut stretches into pieces, and thin their rows.

    Args:
        stretches: Stretches of a record.
        longest_free_s: Longest piece of a free swing [s].
        longest_driven_s: Longest piece of a driven stretch [s].

    Returns:
        The pieces, and the stretch of each.
    """
    parts = []
    cuts: list[tuple[int, int]] = []
    of: list[int] = []
    begin, end = 0, -math.inf
    for at, stretch in enumerate(stretches):
        time, position, sent, torque = _thinned(stretch)
        if time[0] <= end:  # of another record
            later = end - time[0] + 1.0
            time, sent = time + later, sent + later
        ceases = max(float(time[0]) - LONGEST_DELAY_S, end + _BEFORE_S)
        parts.append((time, position, np.append(ceases, sent), np.append(0.0, torque)))
        longest = longest_driven_s if stretch.driven else longest_free_s
        count = max(1, round(float(time[-1] - time[0]) / longest))
        edges = np.searchsorted(time, np.linspace(time[0], time[-1], count + 1)[1:-1])
        for a, b in pairwise([0, *edges.tolist(), time.size - 1]):
            if b - a >= _FEWEST:
                cuts.append((begin + a, begin + b + 1))
                of.append(at)
        begin, end = begin + time.size, float(time[-1])
    motion = Motion(*(np.concatenate(each) for each in zip(*parts, strict=True)))
    chosen = range(len(cuts))
    if len(cuts) > MOST_PIECES:
        chosen = np.linspace(0, len(cuts) - 1, MOST_PIECES).round().astype(int).tolist()
    return cut_at(motion, [cuts[each] for each in chosen]), np.array([of[each] for each in chosen])


def _thinned(stretch: Motion) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the fields of a ``Motion``: no row, and no torque, lasts longer than a step may.

    The torque is the mean from one kept row to the next.
    """
    every = max(1, round(_ROW_S / float(np.median(np.diff(stretch.sampled)))))
    time, position = stretch.sampled[::every], stretch.position[::every]
    steps = max(1, math.ceil(float(np.median(np.diff(time))) / _STEP_S))
    sent = np.interp(np.arange(steps * (time.size - 1) + 1) / steps, np.arange(time.size), time)
    work = np.concatenate([[0.0], np.cumsum(stretch.torque[:-1] * np.diff(stretch.sampled))])
    torque = np.diff(np.interp(sent, stretch.sent, work)) / np.diff(sent)
    return time, position, sent, np.append(torque, torque[-1])
