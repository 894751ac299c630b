"""Runs loops one after the other on one emulated bus, in rounds, and compares them."""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from haptic_wall.controller.bench.highest_rate import RateSearch, holds
from haptic_wall.controller.bench.loops import Ran, emulated_bus
from haptic_wall.controller.bench.torque_frames import held_up, intervals_us, torque_frames
from haptic_wall.controller.emulated_bus.record import read_rows
from scripts.loop_turn import Side
from scripts.study import Found, table

RATE_HZ = 1000.0
LOW_HZ, HIGH_HZ, STEPS, RATE_S = 500.0, 5500.0, 6, 0.8
"""As in the section ``highest_rate`` of the benchmark"""


@dataclass(frozen=True, slots=True)
class Arm:
    """A loop that is compared."""

    name: str
    base: str
    """Name of the bare loop that it is compared with"""
    loop: str
    """Name in ``LOOPS``"""
    side: Side


@dataclass(frozen=True, slots=True)
class Round:
    """A round in which each loop runs once."""

    number: int
    seconds: float
    """Duration of each loop [s]"""


@dataclass(frozen=True, slots=True)
class Turn:
    """One loop in one round."""

    name: str
    base: str
    work_p50: float
    """[µs]"""
    work_p99: float
    frames_p50: float
    """Deviation of torque frames' intervals from the period, by the bus's record [µs]"""
    frames_p99: float
    missed: float
    """Fraction of the periods [1]"""


FIGURES = {
    "work_p50": "work p50",
    "work_p99": "work p99",
    "frames_p50": "frames p50",
    "frames_p99": "frames p99",
}


def in_turn(case: Round, arms: Sequence[Arm]) -> list[Turn]:
    """Run each loop once; the order goes on by one with each round."""
    first = case.number % len(arms)
    ran, times = {}, {}
    with tempfile.TemporaryDirectory() as folder:
        record = Path(folder) / "bus.csv"
        with emulated_bus("--record", str(record)) as path:
            for arm in (*arms[first:], *arms[:first]):
                began_s = time.monotonic()
                ran[arm.name] = arm.side.loop(arm.loop, path, case.seconds, RATE_HZ)
                times[arm.name] = began_s, time.monotonic()
        sent_s = torque_frames(read_rows(record))
    turns = []
    for arm in arms:
        of, work = ran[arm.name], ran[arm.name].times_us["work"]
        found = intervals_us(sent_s, *times[arm.name], case.seconds, RATE_HZ)
        off = np.abs(found[~held_up(found)] - 1e6 / RATE_HZ)
        p50, p99 = np.percentile(off, [50, 99]).tolist()
        missed = of.missed / (of.ticks + of.missed)
        times_us = work["p50"] or 0.0, work["p99"] or 0.0, p50, p99
        turns.append(Turn(arm.name, arm.base, *times_us, missed))
    return turns


def turn_lines(found: Found[Round, list[Turn]]) -> list[str]:
    """A line for each loop: medians, and the ratios to its bare loop."""
    rounds = [{turn.name: turn for turn in row} for _, row in found]
    rows = []
    for turn in rounds[0].values():
        cells = [turn.name]
        for figure in FIGURES:
            own, base = (
                [getattr(turns[name], figure) for turns in rounds]
                for name in (turn.name, turn.base)
            )
            cells.append(f"{statistics.median(own):.3g}")
            cells.append("" if turn.name == turn.base else ratios(own, base))
        missed = statistics.mean(turns[turn.name].missed for turns in rounds)
        rows.append([*cells, f"{100.0 * missed:.2g} %"])
    head = [word for title in FIGURES.values() for word in (f"{title}, µs", "over the bare loop's")]
    count = f"{len(rounds)} rounds of {found[0][0].seconds:g} s: medians, ranges of the ratios."
    return [*table(["loop", *head, "missed"], *rows), "", count]


def ratios(own: Sequence[float], base: Sequence[float]) -> str:
    """Median and range of the ratios of each round."""
    each = [one / other for one, other in zip(own, base, strict=True)]
    return f"{statistics.median(each):.2f} ({min(each):.2f} to {max(each):.2f})"


def highest_rates(arms: Sequence[Arm]) -> dict[str, float]:
    """Search the highest rate of each loop once [Hz]; 0: none was held."""
    searches = {arm.name: RateSearch(LOW_HZ, HIGH_HZ) for arm in arms}
    with emulated_bus() as path:
        for _ in range(STEPS):
            for arm in arms:
                search = searches[arm.name]

                def loop(path: str, seconds: float, rate_hz: float, arm: Arm = arm) -> Ran:
                    return arm.side.loop(arm.loop, path, seconds, rate_hz)

                search.tell(holds(loop, path, search.rate_hz))
    return {name: search.held_hz or 0.0 for name, search in searches.items()}


def rate_lines(found: Found[int, dict[str, float]], base: str) -> list[str]:
    """A line for each loop: the highest rate, and its ratio to that of the bare loop."""
    rounds = [row for _, row in found]
    rows = []
    for name in rounds[0]:
        own, bare = ([row[each] for row in rounds] for each in (name, base))
        over = "" if name == base or not all((*own, *bare)) else ratios(own, bare)
        held = f"{statistics.median(own):.0f}" if all(own) else f"not always above {LOW_HZ:g}"
        rows.append([name, held, over])
    return table(["loop", "highest rate, Hz", "over the bare loop's"], *rows)
