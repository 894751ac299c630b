"""Runs with and without the live page, in turns: lateness, and how regular the torques are.

The runs without a page take part twice: what differs between the two is no effect of the page.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binom

from haptic_wall.controller.bench.loops import FORGIVING
from haptic_wall.controller.bench.torque_frames import held_up, torque_frames
from haptic_wall.controller.emulated_bus.record import read_rows
from haptic_wall.controller.logs.file import read_log
from haptic_wall.controller.runtime.realtime import pick_cores
from scripts.study import Found, Given, table
from scripts.whole_program import PROGRAM, ROOT, with_sets

PATIENCE_S = 60.0
TRIES = 3
SKIPPED_S, END_S = 2.0, 0.2
"""Ignored time at the beginning of a run, in which clients come, and at its end [s]"""
SERVOS = {"loop": "simulated", "bus": "emulated-xm430"}
"""The measured servos by the name of the study's part"""
BASE, AGAIN = "no page", "no page, again"
MODES = {BASE: None, AGAIN: None, "one client": 1, "20 clients": 20}
"""Clients of the page by the name of the mode; None: there is no page"""
MOST_RATIO = 1.05


def address_of(run: subprocess.Popen[str]) -> str:
    """Wait for the address of a run's page."""
    assert run.stderr is not None
    said = ""
    for line in run.stderr:
        if line.startswith("live: "):
            return line.removeprefix("live: ").strip()
        said += line
    raise RuntimeError(f"the run did not start: {said}")


class Case(NamedTuple):
    """A run that is measured."""

    servo: str
    mode: str
    turn: int
    seconds: float


@dataclass(frozen=True, slots=True)
class Cost:
    """Figures of one run; NaN: it had too few ticks [µs]."""

    late_p50: float
    late_p99: float
    frames_p50: float
    """Deviation of the interval of two torques from the period"""
    frames_p99: float
    ended: int = 0
    """Number of runs before it that a trip or the loss of the servo ended"""


FIGURES = {
    "late_p50": "lateness, p50",
    "late_p99": "lateness, p99",
    "frames_p50": "torque intervals, p50",
    "frames_p99": "torque intervals, p99",
}


def turns(given: Given, servo: str) -> list[Case]:
    """Every mode in each round; each round begins with another one."""
    modes = list(MODES)
    return [
        Case(servo, modes[(turn + k) % len(modes)], turn, given.seconds)
        for turn in range(given.rounds)
        for k in range(len(modes))
    ]


def cost(case: Case) -> Cost:
    """Run a wall in a mode, and return its figures; a run that the machine ended is repeated."""
    for ended in range(TRIES):
        try:
            return replace(_cost(case), ended=ended)
        except EndedError as error:
            sys.stderr.write(f"{error}\n")
    raise RuntimeError(f"{case}: all of {TRIES} runs ended early")


class EndedError(Exception):
    """A run was ended by a trip, or the servo was lost: a stalled machine does that."""


def _cost(case: Case) -> Cost:
    clients = MODES[case.mode]
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name:
        log, record = Path(name) / "run.hwlog", Path(name) / "bus.csv"
        words = [*PROGRAM, "run", case.servo, "--no-plot", "--json", "--log", str(log)]
        words += ["--duration", str(case.seconds)]
        if case.servo != "simulated":
            words += ["--witness", str(record), *with_sets(tuple(FORGIVING))]
        if clients is not None:
            words.append("--live")
        run = subprocess.Popen(
            words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, process_group=0
        )
        readers = None
        if clients is not None:
            readers = subprocess.Popen(
                [
                    *[sys.executable, "-m", "scripts.live_clients", address_of(run)],
                    *[str(clients), str(case.seconds + PATIENCE_S)],
                ],
                cwd=ROOT,
                stdout=subprocess.PIPE,
                text=True,
            )
            os.sched_setaffinity(readers.pid, pick_cores()[1])  # as if on another machine
        _, said = run.communicate(timeout=PATIENCE_S + case.seconds)
        if run.returncode:
            if readers is not None:
                readers.kill()
                readers.communicate()
            kind = EndedError if run.returncode in {3, 4} else RuntimeError
            raise kind(f"{case} ended with {run.returncode}: {said}")
        if readers is not None and not int(readers.communicate(timeout=PATIENCE_S)[0]):
            raise RuntimeError(f"{case}: the clients read nothing")
        rows = read_log(log)[1]
        if case.servo == "simulated":
            sent_s = 1e-9 * (rows["sampled_ns"] + rows["age_ns"])[rows["sampled_ns"] > 0]
        else:
            sent_s = torque_frames(read_rows(record))
    began_s, ended_s = (1e-9 * float(rows["deadline_ns"][k]) for k in (0, -1))
    inside = (began_s + SKIPPED_S, ended_s - END_S)
    due_s = 1e-9 * rows["deadline_ns"]
    late_us = 1e-3 * rows["lateness_ns"][(due_s > inside[0]) & (due_s < inside[1])]
    intervals_us = 1e6 * np.diff(sent_s[(sent_s > inside[0]) & (sent_s < inside[1])])
    if case.servo != "simulated":
        intervals_us = intervals_us[~held_up(intervals_us)]
    return Cost(*percentiles(late_us), *percentiles(np.abs(intervals_us - 1e3)))


def percentiles(values: NDArray[np.float64]) -> tuple[float, float]:
    """Median and 99th percentile."""
    if len(values) < 100:
        return float("nan"), float("nan")
    return float(np.percentile(values, 50)), float(np.percentile(values, 99))


def ratios(found: Found[Case, Cost], mode: str, figure: str) -> list[float]:
    """A figure over that without a page, round by round."""
    of = {(case.mode, case.turn): row for case, row in found}
    return [
        getattr(row, figure) / getattr(of[BASE, turn], figure)
        for (name, turn), row in of.items()
        if name == mode and (BASE, turn) in of
    ]


def middle(values: Sequence[float]) -> tuple[float, float, float]:
    """Return the median and its bounds, within which it lies in 95 % by the rounds' order alone.

    With fewer than six values the bounds are the least and the largest one.
    """
    ordered = sorted(values)
    outside = max(int(binom.ppf(0.025, len(ordered), 0.5)) - 1, 0)
    return statistics.median(ordered), ordered[outside], ordered[-1 - outside]


def cost_lines(found: Found[Case, Cost]) -> list[str]:
    """A line for each mode of a servo."""
    rows = []
    for mode in MODES:
        cells = []
        for figure in FIGURES:
            if mode == BASE:
                of = [getattr(row, figure) for case, row in found if case.mode == mode]
                cells.append(f"{statistics.median(of):.3g} µs")
            else:
                ratio, low, high = middle(ratios(found, mode, figure))
                cells.append(f"{ratio:.2f} ({low:.2f} to {high:.2f})")
        rows.append([mode, *cells])
    first = found[0][0]
    count = max(case.turn for case, _ in found) + 1
    over = beyond(found)
    ended = {mode: sum(row.ended for case, row in found if case.mode == mode) for mode in MODES}
    again = "; ".join(f"{mode}, {number}" for mode, number in ended.items() if number)
    return [
        *table([f"`{first.servo}`", *FIGURES.values()], *rows),
        "",
        f"{count} rounds of {first.seconds:g} s, load of the machine {os.getloadavg()[0]:.1f}."
        " Ratios to `no page` of the same round: median, and its bounds of 95 %."
        f" Wanted: every median at most {MOST_RATIO:g}. "
        + (f"It is more for: {'; '.join(over)}." if over else "It holds.")
        + (
            f" Runs that a trip or a lost servo ended, and that were repeated: {again}."
            * bool(again)
        ),
    ]


def beyond(found: Found[Case, Cost]) -> list[str]:
    """The figures whose median ratio is more than is wanted."""
    listed = []
    for figure, words in FIGURES.items():
        for mode, clients in MODES.items():
            ratio, low, _ = middle(ratios(found, mode, figure))
            if clients is not None and ratio > MOST_RATIO:
                listed.append(f"{mode}, {words}" + (" (undecided)" if low <= MOST_RATIO else ""))
    return listed


def cheap(found: Found[Case, Cost]) -> bool:
    """Whether no ratio is surely more than is wanted."""
    return all(words.endswith("(undecided)") for words in beyond(found))
