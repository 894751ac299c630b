"""Defines the result of a benchmark section as plain data, and measures times."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Measurement:
    """One number of the report; with quartiles where it was measured in several rounds."""

    name: str
    """The measured quantity"""
    value: float
    unit: str
    low: float | None = None
    """Lower quartile of the rounds; None: not given"""
    high: float | None = None
    """Upper quartile of the rounds"""


@dataclass(frozen=True, slots=True)
class Section:
    """Result of one section."""

    rows: tuple[Measurement, ...]
    notes: tuple[str, ...] = ()
    """Missing measurements, and the reasons"""


def over_rounds(name: str, values: Sequence[float], unit: str) -> Measurement:
    """Return a quantity that was measured once a round: its median and quartiles.

    Args:
        name: The measured quantity.
        values: One for each round, at least one.
        unit: Unit of the values; ``1``: a ratio.
    """
    if len(values) == 1:
        return Measurement(name, values[0], unit, values[0], values[0])
    low, middle, high = statistics.quantiles(values, n=4, method="inclusive")
    return Measurement(name, middle, unit, low, high)


def ratio(name: str, ours: Sequence[float], theirs: Sequence[float]) -> Measurement:
    """Return our value over theirs, divided round by round.

    Other load of the machine affects both values of a round alike.

    Args:
        name: The compared quantity.
        ours: A value each round.
        theirs: Of the same rounds, not zero.
    """
    each = [one / other for one, other in zip(ours, theirs, strict=True)]
    return over_rounds(name, each, "1")


def compared(what: str, rounds: Mapping[str, Sequence[float]], unit: str) -> list[Measurement]:
    """Return a quantity of this program and of the bare loop, and ours over theirs.

    Args:
        what: The measured quantity.
        rounds: A value each round of ``haptic-wall`` and ``bare loop``.
        unit: Unit of the values.
    """
    return [
        *(over_rounds(f"{name}, {what}", values, unit) for name, values in rounds.items()),
        ratio(
            f"haptic-wall, {what}: over that of the bare loop",
            rounds["haptic-wall"],
            rounds["bare loop"],
        ),
    ]


def interleaved(work: Mapping[str, Callable[[], object]], rounds: int) -> dict[str, list[float]]:
    """Time every piece of work once in each round; return the times by name [s].

    Other load of the machine then affects all of them alike. The first round is not counted: it
    pays for imports and caches.

    Args:
        work: Functions to time, by name.
        rounds: Number of counted rounds, >= 1.
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
