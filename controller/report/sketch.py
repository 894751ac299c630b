"""Selects as many rows of a long run as a picture can show, in bounded memory.

A picture has fewer columns than a long run has ticks. The run is divided into slices, and each
slice keeps the rows with the extremes of each drawn value. So no peak is lost, and no drawn point
is an average.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.runtime.telemetry import (
    FLAG_ALARM,
    FLAG_CHANGED,
    FLAG_CONTACT,
    FLAG_OFF,
    FLAG_PROBED,
    FLAG_SATURATED,
    FLAG_WARM_UP,
)

Floats = NDArray[np.float64]

SLICES = 2500
"""Number of slices: more than a picture has columns"""
WHOLE = 4 * SLICES
"""Runs of up to this many rows are drawn completely."""
TIMES = ("bus_ns", "work_ns", "lateness_ns")
"""Fields that are durations"""

_EXTREME = ("position", "velocity", "wall_torque", "torque", "stiffness", *TIMES)
_FLAGS = (
    FLAG_ALARM,
    FLAG_CHANGED,
    FLAG_CONTACT,
    FLAG_OFF,
    FLAG_PROBED,
    FLAG_SATURATED,
    FLAG_WARM_UP,
)


@dataclass(frozen=True, slots=True)
class Sketch:
    """The selected rows of a run, and the mean velocity that its picture shows."""

    rows: NDArray[np.void]
    """The drawn rows in order, the first and the last of the run among them"""
    time: Floats
    """Time of each [s]"""
    mean_time: Floats
    """Middles of the slices [s]; empty where every row is drawn"""
    mean_velocity: Floats
    """Mean of the velocity over each slice [rad/s]"""


def sketched(blocks: Iterable[NDArray[np.void]], count: int, origin_ns: int) -> Sketch:
    """Select the rows of a run that its picture shows.

    Args:
        blocks: The rows, n > 0 in all, shape (m,) each, dtype ``telemetry.ROW``.
        count: Their number.
        origin_ns: Zero of the time, on the run's clock [ns].
    """
    kept: list[NDArray[np.void]] = []
    middles: list[float] = []
    means: list[float] = []
    slices = count if count <= WHOLE else SLICES
    edges = [count] if count <= WHOLE else np.linspace(0, count, slices + 1).astype(int)[1:]
    for rows in _parted(blocks, edges):
        if count <= WHOLE:
            kept.append(rows)
            continue
        kept.append(rows[_telling(rows)])
        middles.append((float(np.mean(rows["deadline_ns"][[0, -1]])) - origin_ns) * 1e-9)
        velocity = rows["velocity"][np.isfinite(rows["velocity"])]
        means.append(float(np.mean(velocity)) if velocity.size else np.nan)
    chosen = np.concatenate(kept)
    return Sketch(
        chosen,
        (chosen["deadline_ns"] - origin_ns) * 1e-9,
        np.array(middles),
        np.array(means),
    )


def _parted(blocks: Iterable[NDArray[np.void]], edges: Iterable[int]) -> Iterator[NDArray[np.void]]:
    """Split the rows at ``edges`` (row numbers); rows after the last edge follow."""
    waiting: list[NDArray[np.void]] = []
    held = begun = 0
    ends = iter(edges)
    end = next(ends, None)
    for block in blocks:
        waiting.append(block)
        held += len(block)
        while end is not None and held >= end - begun:
            # Splitting a long block must not copy its rest for every part.
            rows = waiting[0] if len(waiting) == 1 else np.concatenate(waiting)
            if end > begun:
                yield rows[: end - begun]
            waiting, held, begun = [rows[end - begun :]], held - (end - begun), end
            end = next(ends, None)
    if held:
        yield np.concatenate(waiting)


def _telling(rows: NDArray[np.void]) -> NDArray[np.intp]:
    """Return the rows of a slice to keep: both ends, each field's extremes, flag changes."""
    places = {0, len(rows) - 1}
    for field in _EXTREME:
        numbers = rows[field]
        known = np.flatnonzero(np.isfinite(numbers))
        if known.size:
            places |= {int(known[np.argmin(numbers[known])]), int(known[np.argmax(numbers[known])])}
        if known.size < len(rows):  # keep a gap
            places.add(int(np.flatnonzero(~np.isfinite(numbers))[0]))
    if rows["missed"].any():
        places.add(int(np.argmax(rows["missed"])))
    if rows["outcome"].any():
        places.add(int(np.argmax(rows["outcome"])))
    for flag in _FLAGS:
        changes = np.flatnonzero(np.diff(rows["flags"] & flag))
        if changes.size:
            places |= {int(changes[0]), int(changes[0]) + 1, int(changes[-1]) + 1}
    return np.array(sorted(places))
