"""Result of a section of the benchmark, and how its times are taken."""

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
    low: float | None = None
    """Lower quartile of the rounds; None: not told"""
    high: float | None = None
    """Upper quartile of the rounds"""


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
    """Result of one section."""

    rows: tuple[Row, ...]
    notes: tuple[str, ...] = ()
    """What could not be measured, and why"""
    histograms: tuple[Histogram, ...] = ()


def over_rounds(name: str, values: Sequence[float], unit: str, shows_not: str) -> Row:
    """A row of one value a round: the median, and the quartiles.

    Args:
        name: What was measured.
        values: At least one.
        unit: Of the values; ``1``: a ratio.
        shows_not: What it must not be taken for.
    """
    if len(values) == 1:
        return Row(name, values[0], unit, shows_not, values[0], values[0])
    low, middle, high = statistics.quantiles(values, n=4, method="inclusive")
    return Row(name, middle, unit, shows_not, low, high)


def ratio(name: str, ours: Sequence[float], theirs: Sequence[float], shows_not: str) -> Row:
    """Ours over theirs, round by round: what the machine does falls on both alike.

    Args:
        name: What is compared.
        ours: A value each round.
        theirs: Of the same rounds, not zero.
        shows_not: What it must not be taken for.
    """
    each = [one / other for one, other in zip(ours, theirs, strict=True)]
    return over_rounds(name, each, "1", shows_not)


def interleaved(work: Mapping[str, Callable[[], object]], rounds: int) -> dict[str, list[float]]:
    """Time of each piece of work in each round [s], all of them once in every round.

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
    return times
