"""Tries the emulated bus in a second terminal on a loaded machine.

    scripts/study second_terminal [--runs N] [--seconds S] [--quiet-cores]

For each run a bus is started as the README's first terminal does, and the wall as its second does,
beside one process on each core that never rests. Beside that preset, ``xm430-w350`` on the same
port shows what the patience of the preset is for. Exit status 1 if a run of the preset tripped.
"""

import contextlib
import os
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from haptic_wall.controller.system.signals import interrupting
from scripts.studies.busy_neighbours import busy_cores
from scripts.study import Found, Given, Option, Part, Study, table
from scripts.whole_program import emulated_bus, middle_and_most, missed_share, run_report

PRESET = ("emulated-port",)
REAL = ("xm430-w350", "--set", "realtime.profile=best-effort")


@dataclass(frozen=True, slots=True)
class Run:
    """Figures of one run's report."""

    stop_reason: str
    lost: float
    """Fraction of the cycles whose reply was lost or late [1]"""
    missed: float
    """Fraction of the periods that had no tick [1]"""
    scheduler: bool
    """The loop had real-time scheduling"""
    load: float = 0.0
    """Load of the machine, mean of a minute"""


def of_report(report: dict[str, Any]) -> Run:
    """Take the figures of a run from its report."""
    bus = report["bus"] or {"cycles": 0, "lost": 0}
    return Run(
        stop_reason=report["stop_reason"],
        lost=bus["lost"] / bus["cycles"] if bus["cycles"] else 0.0,
        missed=missed_share(report),
        scheduler=any(s["name"] == "scheduler" and s["ok"] for s in report["realtime"]),
        load=os.getloadavg()[0],
    )


def run(case: tuple[tuple[str, ...], float, int]) -> Run:
    """Start a bus, run the wall on it once, and return the figures.

    Raises:
        RuntimeError: The run did not start.
    """
    words, seconds, _ = case
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        bus = ["--set", f"servo.port={folder / 'bus'}", "--duration", str(seconds)]
        with emulated_bus("--link", folder / "bus", "--set", "servo.hand=push"):
            return of_report(run_report(folder, *words, *bus))


@contextlib.contextmanager
def neighbours(given: Given) -> Iterator[None]:
    """Busy processes beside the runs, unless none are wanted."""
    with interrupting(), contextlib.nullcontext() if given.quiet_cores else busy_cores():
        yield


def cells(words: Sequence[str], runs: Sequence[Run]) -> list[str]:
    """One line of the table."""
    ends = Counter(each.stop_reason for each in runs)
    planned = ends.pop("duration", 0)
    trips = ", ".join(f"{name} {count}" for name, count in sorted(ends.items()))
    return [
        *(f"`{' '.join(words)}`", f"{planned} of {len(runs)}", trips or "–"),
        middle_and_most([each.lost for each in runs], ".1%"),
        middle_and_most([each.missed for each in runs], ".1%"),
        "yes" if all(each.scheduler for each in runs) else "no",
    ]


def lines(found: Found[tuple[tuple[str, ...], float, int], Run]) -> list[str]:
    """A line for the preset of the emulated bus, and one for that of a real servo."""
    load = [row.load for _, row in found]
    runs = {words: [row for case, row in found if case[0] == words] for words in (PRESET, REAL)}
    head = ["configuration", "ended as planned", "else by", "replies late or lost: median, most"]
    return [
        f"The load of the whole machine (1 min) was {min(load):.1f} to {max(load):.1f} meanwhile.",
        "",
        *table(
            [*head, "periods missed: median, most", "loop's real-time scheduling"],
            *(cells(*each) for each in runs.items()),
        ),
    ]


STUDY = Study(
    "evidence/second-terminal.md",
    (
        Part(
            "runs",
            lambda given: [
                (w, given.seconds, n) for w in (PRESET, REAL) for n in range(given.runs)
            ],
            run,
            lines,
            case_s=13.0,
            in_turn=True,
            around=neighbours,
            wanted=lambda found: all(
                row.stop_reason == "duration" for case, row in found if case[0] == PRESET
            ),
        ),
    ),
    (
        Option("runs", 20, "runs of each configuration"),
        Option("seconds", 5.0, "duration of each run [s]"),
        Option("quiet_cores", False, "start no busy processes"),
    ),
)
