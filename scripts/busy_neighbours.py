"""Checks that ordinary busy processes beside a run trip nothing; writes docs/busy-neighbours.md.

    scripts/busy_neighbours [--runs N] [--seconds S] [--out FILE]

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

from scripts.whole_program import (
    measured_on,
    middle_and_most,
    missed_share,
    page_options,
    run_report,
    say_time,
)

CONFIGS = ("simulated", "emulated-xm430")
AROUND_S = 3.5
"""Duration of a run beside its own, with busy cores [s]"""
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
def busy_cores() -> Iterator[list[int]]:
    """One process at normal priority on each core, until the end; the cores."""
    cores = sorted(os.sched_getaffinity(0))
    busy = [subprocess.Popen([sys.executable, "-c", _BUSY, str(core)]) for core in cores]
    try:
        yield cores
    finally:
        for each in busy:
            each.kill()
            each.wait()


def run(config: str, seconds: float, folder: Path) -> Run:
    """Run the wall once in ``strict``, and return the figures.

    Raises:
        RuntimeError: The run did not start.
    """
    strict = ("--set", "realtime.profile=strict")
    return of_report(run_report(folder, config, *strict, "--duration", str(seconds)))


def of_report(report: dict[str, Any]) -> Run:
    """Take the figures of a run from its report."""
    interval = (report["guard"] or {}).get("interval_s")
    return Run(
        stop_reason=report["stop_reason"],
        missed=missed_share(report),
        interval_ms=None if interval is None else 1e3 * interval,
        warned=any("safety.max_missed" in warning for warning in report["warnings"]),
    )


def row(config: str, runs: Sequence[Run]) -> str:
    """One line of the table."""
    trips = [each.stop_reason for each in runs if each.stop_reason != "duration"]
    missed = middle_and_most([each.missed for each in runs], ".2%")
    intervals = [each.interval_ms for each in runs if each.interval_ms is not None]
    counted = middle_and_most(intervals, "g") if intervals else "–"
    return (
        f"| `{config}` | {len(runs)} | {len(trips)} | {', '.join(sorted(set(trips))) or '–'} "
        f"| {missed} | {counted} |"
    )


def main() -> int:
    """Run, write the page; 1 if a run tripped."""
    parser = page_options("busy_neighbours", __doc__, "busy-neighbours.md")
    parser.add_argument("--runs", type=int, default=20, help="of each configuration")
    parser.add_argument("--seconds", type=float, default=3.0, help="how long each lasts")
    wanted = parser.parse_args()
    say_time(len(CONFIGS) * wanted.runs * (wanted.seconds + AROUND_S))
    rows, failed = [], False
    with tempfile.TemporaryDirectory() as folder, busy_cores() as cores:
        for config in CONFIGS:
            runs = []
            for _ in range(wanted.runs):
                runs.append(run(config, wanted.seconds, Path(folder)))
                print(config, runs[-1], file=sys.stderr, flush=True)
            failed |= any(each.stop_reason != "duration" for each in runs)
            rows.append(row(config, runs))
    lines = [
        "# Ordinary busy processes beside a run",
        "",
        "Written by `scripts/busy_neighbours`; run it to see the figures of your machine. On each"
        f" of {len(cores)} cores one process at normal priority never rests. Beside them runs of"
        f" {wanted.seconds:g} s with `realtime.profile=strict` follow each other, which"
        " [trips](trips.md#missed_periods) when more than `safety.max_missed` of the periods are"
        " missed in half a second.",
        "",
        measured_on(),
        "",
        "| configuration | runs | tripped | by | periods missed: median, most "
        "| interval counted [ms]: median, most |",
        "| --- | --- | --- | --- | --- | --- |",
        *rows,
        "",
    ]
    wanted.out.write_text("\n".join(lines), encoding="utf-8")
    print("\n".join(lines))
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
