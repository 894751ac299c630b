"""Measures the effect of changes from another process on the ticks of a running wall.

    scripts/study changed_ticks [--rounds N] [--seconds S]

In each round the same wall runs four times, one after the other: twice undisturbed, once with
requests that are refused, and once with changes that are made, ten a second. The two undisturbed
runs tell how much runs differ by themselves; a refused request costs the loop nothing but the
machine's time. The order goes on by one with each round.
"""

import itertools
import math
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.logs.reader import LogReader
from haptic_wall.controller.logs.rows import LogRows
from haptic_wall.controller.processes.ask import NotAppliedError
from haptic_wall.controller.processes.started import RunningWall
from haptic_wall.controller.processes.started import run as started
from haptic_wall.controller.runtime.telemetry import FLAG_CHANGED, FLAG_WARM_UP
from scripts.study import Found, Given, Option, Part, Study, table

ARMS = ("undisturbed", "undisturbed again", "refused requests", "changes")
EVERY_S = 0.1
"""From one request to the next [s]"""
BEFORE = 150
"""Ticks before a change, its own included, that may take pieces of it"""
Case = tuple[str, float, int]
"""Arm, duration of the run [s], round"""


@dataclass(frozen=True, slots=True)
class Ticks:
    """Figures of the ticks of one run [µs]."""

    ticks: int
    missed: int
    made: int
    """Changes that were made"""
    work: tuple[float, float, float]
    """Median, 99 % and largest"""
    lateness: tuple[float, float, float]
    near: float
    """Median work of the ticks that may take pieces; NaN: there are none"""
    far: float
    """Median work of the others"""


def figures(rows: NDArray[np.void]) -> Ticks:
    """Return the figures of a run's rows, its warm-up left out.

    Args:
        rows: Rows of the log; each holds the work of the tick before.
    """
    on = np.flatnonzero((rows["flags"] & FLAG_WARM_UP) == 0)
    if on.size < 2:
        raise ValueError(f"{len(rows)} rows with {on.size} of a wall that is on; run it longer")
    rows = rows[on[0] :]
    work = rows["work_ns"][1:] * 1e-3
    changed = np.flatnonzero(rows["flags"] & FLAG_CHANGED)
    near = np.zeros(work.size, dtype=np.bool_)
    for row in changed.tolist():
        near[max(0, row - BEFORE) : row + 1] = True
    return Ticks(
        ticks=len(rows),
        missed=int(rows["missed"].sum()),
        made=changed.size,
        work=_spread(work),
        lateness=_spread(rows["lateness_ns"] * 1e-3),
        near=float(np.median(work[near])) if near.any() else float("nan"),
        far=float(np.median(work[~near])) if not near.all() else float("nan"),
    )


def _spread(values: NDArray[np.float64]) -> tuple[float, float, float]:
    low, high = np.percentile(values, [50, 99]).tolist()
    return low, high, float(values.max())


def tried(case: Case) -> Ticks:
    """Run a wall, disturbed as its arm says."""
    arm, seconds, _ = case
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "run.hwlog"
        with started("simulated", {"servo.hand": "tap"}, duration_s=seconds, log=log) as wall:
            disturbed(wall, ARMS.index(arm), time.monotonic, time.sleep)
            wall.wait()
        rows = list(LogRows.of(LogReader(log)).blocks())
    return figures(np.concatenate(rows))


def disturbed(
    wall: RunningWall, arm: int, now: Callable[[], float], sleep: Callable[[float], None]
) -> None:
    """Send requests to a wall until it ends, as an arm says.

    Args:
        wall: The running wall.
        arm: Index in ``ARMS``.
        now: The present time [s].
        sleep: Waits some time [s].
    """
    requests: Iterator[dict[str, Any]] = itertools.cycle(
        [{"loop.rate_hz": 500}]
        if arm == 2
        else [{"wall.damping": 0.01}, {"wall.damping": 0.02}, {"wall.damping": 0.015}]
    )
    due = now()
    while wall.running():
        if arm >= 2:
            try:
                wall.set(next(requests), wait_s=1.0)
            except NotAppliedError:
                pass  # refused, as it should be; or its moment did not come
            except (OSError, ValueError, RuntimeError):
                return  # the run is over
        due = max(due + EVERY_S, now())
        sleep(max(0.0, due - now()))


def cases(given: Given) -> list[Case]:
    """Return the runs, in rounds."""
    return [
        (ARMS[(n + k) % len(ARMS)], given.seconds, n)
        for n in range(given.rounds)
        for k in range(len(ARMS))
    ]


def lines(found: Found[Case, Ticks]) -> list[str]:
    """Return a line for each arm, and what a change costs the ticks near it."""
    base = {n: row for (arm, _, n), row in found if arm == ARMS[0]}
    rows = [
        [
            "runs",
            "changes made",
            "work, median [µs]",
            "over undisturbed",
            "work, 99 % [µs]",
            "work, largest [µs]",
            "lateness, median [µs]",
            "lateness, 99 % [µs]",
            "missed",
        ]
    ]
    for arm in ARMS:
        some = {n: row for (name, _, n), row in found if name == arm}
        if not some:
            continue
        ratios = [row.work[0] / base[n].work[0] for n, row in some.items() if n in base]
        ticks, missed = (
            sum(getattr(r, name) for r in some.values()) for name in ("ticks", "missed")
        )
        rows.append(
            [
                arm,
                f"{sum(row.made for row in some.values())}",
                *(_middle([row.work[0] for row in some.values()]),),
                f"{statistics.median(ratios):.2f} ({min(ratios):.2f} to {max(ratios):.2f})",
                _middle([row.work[1] for row in some.values()]),
                f"{max(row.work[2] for row in some.values()):.0f}",
                _middle([row.lateness[0] for row in some.values()]),
                _middle([row.lateness[1] for row in some.values()]),
                f"{100.0 * missed / (ticks + missed):.2f} %",
            ]
        )
    changed = [row for (arm, _, _), row in found if arm == ARMS[3] and not math.isnan(row.near)]
    text = table(*rows)
    if changed:
        near, far = (_middle([getattr(r, name) for r in changed]) for name in ("near", "far"))
        text += [
            "",
            f"In the runs with changes: median work {near} µs in the {BEFORE} ticks up to a"
            f" change, {far} µs in the others. Largest values are of all runs, the other ones"
            " medians over the runs.",
        ]
    return text


def _middle(values: list[float]) -> str:
    values = [value for value in values if not math.isnan(value)]
    return f"{statistics.median(values):.0f}" if values else "–"


STUDY = Study(
    "evidence/changed-ticks.md",
    (Part("ticks", cases, tried, lines, case_s=14.0, in_turn=True),),
    (
        Option("rounds", 8, "rounds of four runs", quick=1),
        Option("seconds", 10.0, "duration of each run [s]", quick=2.0),
    ),
)
