"""Defines a recorded motion on an even grid of samples.

A gap splits the record, because the motion in it is unknown.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

LEAST = 10
"""Least number of samples worth analysing."""
GAP = 10
"""Periods without a sample that split the record."""
WINDOW = 120_000
"""Samples that are analysed at once, without the overlap"""
BEFORE_S = 10.0
"""Overlap with the window before [s]: the detector needs some half-cycles of an oscillation."""
MOST_TOLD = 5
"""Largest number of gaps and short stretches reported one by one"""


@dataclass(frozen=True, slots=True)
class Knowledge:
    """Servo and loop parameters that the record contains; NaN: not contained."""

    inertia: float = math.nan
    """[kg·m²], per commanded torque, as the others"""
    damping: float = math.nan
    """[N·m·s/rad]"""
    coulomb: float = math.nan
    """[N·m]"""
    lag: float = math.nan
    """From a sample until its torque acts [s]"""
    position_step: float = math.nan
    """Encoder count [rad]; 0: none"""
    virtual_damping: float = 0.0
    """Commanded [N·m·s/rad]"""
    surface: float = math.nan
    """Position of the wall's surface [rad]"""
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
    """Sentences about repaired or omitted samples"""
    since_s: float = -math.inf
    """Earlier samples belong to the recording before; they give the detector its history [s]"""
    of: int = 1
    """Number of recordings in all"""

    @property
    def samples(self) -> int:
        """Return the number of samples of all parts."""
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


def parted(whole: Part, period: float, notes: list[str]) -> tuple[Part, ...]:
    """Split the record where samples are missing for long."""
    seen = np.flatnonzero(np.isfinite(whole.positions))
    breaks = np.flatnonzero(np.diff(whole.times[seen]) > GAP * period)
    for at in breaks[:MOST_TOLD]:
        start, end = whole.times[seen[at]], whole.times[seen[at + 1]]
        notes.append(gap_text(start, end))
    if breaks.size > MOST_TOLD:
        notes.append(f"there are {breaks.size - MOST_TOLD} more such gaps")
    edges = np.concatenate([[0], breaks + 1, [seen.size]])
    short = edges[1:] - edges[:-1] < LEAST
    for start, end in zip(edges[:-1][short][:MOST_TOLD], edges[1:][short], strict=False):
        since = whole.times[seen[start]] if start < seen.size else whole.times[0]
        notes.append(short_text(end - start, since))
    if np.count_nonzero(short) > MOST_TOLD:
        lost = int((edges[1:] - edges[:-1])[short][MOST_TOLD:].sum())
        notes.append(f"there are {lost} more samples in stretches that are too short")
    return tuple(
        sliced(whole, int(seen[start]), int(seen[end - 1]) + 1)
        for start, end in zip(edges[:-1][~short], edges[1:][~short], strict=True)
    )


def seconds(moment_s: float) -> str:
    """Format a moment [s] for a sentence, to a tenth of a millisecond."""
    return f"{round(float(moment_s), 4):.14g}"


def gap_text(start_s: float, end_s: float) -> str:
    """Describe a gap between two moments [s]."""
    since, until = seconds(start_s), seconds(end_s)
    return f"nothing is known from {since} to {until} s: the analysis restarts there"


def short_text(samples: int, since_s: float) -> str:
    """Describe omitted samples, the first of them at ``since_s`` [s]."""
    return f"{samples} samples from {seconds(since_s)} s on are too few"


def sliced(whole: Part, start: int, end: int) -> Part:
    """Return the samples from ``start`` up to, but without, ``end``."""
    inside = slice(start, end)
    return Part(
        whole.times[inside],
        whole.positions[inside],
        None if whole.torques is None else whole.torques[inside],
        None if whole.stiffness is None else whole.stiffness[inside],
    )


def windowed(parts: Sequence[Part]) -> Iterator[tuple[tuple[Part, ...], float]]:
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
