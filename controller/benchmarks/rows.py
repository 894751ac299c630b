"""What a section of the benchmark gives back, and how its times are taken."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Row:
    """One figure."""

    name: str
    """What was measured"""
    value: float
    unit: str
    shows_not: str
    """What this figure must not be taken for"""


@dataclass(frozen=True, slots=True)
class Histogram:
    """Samples to be drawn over each other."""

    name: str
    """What was measured"""
    unit: str
    series: Mapping[str, Sequence[float]]
    """The samples of each that is compared, by name; at most some ten thousand"""


@dataclass(frozen=True, slots=True)
class Section:
    """What one section found."""

    rows: tuple[Row, ...]
    notes: tuple[str, ...] = ()
    """What could not be measured, and why"""
    histograms: tuple[Histogram, ...] = ()


def interleaved(work: Mapping[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """Median time of each piece of work [s], all of them once in every round.

    Whatever else the machine does then falls on all of them alike. A round before the first one
    is not counted: it pays for imports and caches.

    Args:
        work: What is timed, by name.
        rounds: How many are counted, >= 1.
    """
    times: dict[str, list[float]] = {name: [] for name in work}
    for counted in range(rounds + 1):
        for name, function in work.items():
            begin = time.perf_counter()
            function()
            elapsed = time.perf_counter() - begin
            if counted:
                times[name].append(elapsed)
    return {name: statistics.median(each) for name, each in times.items()}
