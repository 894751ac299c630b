"""Checks that ordinary busy processes beside a run trip nothing.

    scripts/study busy_neighbours [--runs N] [--seconds S]

One process that never rests on each core, at normal priority, beside runs in ``strict``: on the
servo simulated in the loop's own process, and on the emulated bus, whose process is an ordinary one
too. Needs the rights that ``realtime.profile=strict`` needs. Exit status 1 if a run tripped.
"""

import contextlib
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from scripts.study import Found, Given, Option, Part, Study, table
from scripts.whole_program import middle_and_most, missed_share, run_report

CONFIGS = ("simulated", "emulated-ideal")
_BUSY = "import os, sys\nos.sched_setaffinity(0, {int(sys.argv[1])})\nwhile True:\n    pass\n"


@dataclass(frozen=True, slots=True)
class Run:
    """Figures of one run's report."""

    stop_reason: str
    missed: float
    """Fraction of the periods [1]"""
    interval_ms: float | None
    warned: bool
    """Of more missed periods than ``safety.max_missed``"""


@contextlib.contextmanager
def busy_cores(_given: Given | None = None) -> Iterator[list[int]]:
    """One process at normal priority on each core, until the end; the cores."""
    cores = sorted(os.sched_getaffinity(0))
    busy = [subprocess.Popen([sys.executable, "-c", _BUSY, str(core)]) for core in cores]
    try:
        yield cores
    finally:
        for each in busy:
            each.kill()
            each.wait()


def run(case: tuple[str, float, int]) -> Run:
    """Run the wall once in ``strict``, and return the figures.

    Raises:
        RuntimeError: The run did not start.
    """
    config, seconds, _ = case
    strict = ("--set", "realtime.profile=strict")
    with tempfile.TemporaryDirectory() as folder:
        return of_report(run_report(Path(folder), config, *strict, "--duration", str(seconds)))


def of_report(report: dict[str, Any]) -> Run:
    """Take the figures of a run from its report."""
    interval = (report["guard"] or {}).get("interval_s")
    return Run(
        stop_reason=report["stop_reason"],
        missed=missed_share(report),
        interval_ms=None if interval is None else 1e3 * interval,
        warned=any("safety.max_missed" in warning for warning in report["warnings"]),
    )


def cells(config: str, runs: Sequence[Run]) -> list[str]:
    """One line of the table."""
    trips = [each.stop_reason for each in runs if each.stop_reason != "duration"]
    missed = middle_and_most([each.missed for each in runs], ".2%")
    intervals = [each.interval_ms for each in runs if each.interval_ms is not None]
    counted = middle_and_most(intervals, "g") if intervals else "–"
    by = ", ".join(sorted(set(trips))) or "–"
    return [f"`{config}`", f"{len(runs)}", f"{len(trips)}", by, missed, counted]


def lines(found: Found[tuple[str, float, int], Run]) -> list[str]:
    """A line for each configuration."""
    runs = {name: [row for case, row in found if case[0] == name] for name in CONFIGS}
    head = ["configuration", "runs", "tripped", "by", "periods missed: median, most"]
    return table(
        [*head, "interval counted [ms]: median, most"],
        *(cells(*each) for each in runs.items() if each[1]),
    )


STUDY = Study(
    "evidence/busy-neighbours.md",
    (
        Part(
            "runs",
            lambda given: [(c, given.seconds, n) for c in CONFIGS for n in range(given.runs)],
            run,
            lines,
            case_s=6.5,
            in_turn=True,
            around=busy_cores,
            wanted=lambda found: all(row.stop_reason == "duration" for _, row in found),
        ),
    ),
    (
        Option("runs", 20, "runs of each configuration"),
        Option("seconds", 3.0, "duration of each run [s]"),
    ),
)
