"""Checks that ordinary busy processes beside a run trip nothing; writes docs/busy-neighbours.md.

    scripts/busy_neighbours [--runs N] [--seconds S] [--out FILE]

One process that never rests on each core, at normal priority, beside runs in ``strict``: on the
servo simulated in the loop's own process, and on the emulated bus, whose process is an ordinary one
too. Needs the rights that ``realtime.profile=strict`` needs. Exit status 1 if a run tripped.
"""

import contextlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from controller.benchmarks.machine import machine, versions
from scripts.whole_program import ROOT, page_options, say_time

PROGRAM = [sys.executable, "-m", "controller.cli.main"]
CONFIGS = ("simulated", "emulated-xm430")
AROUND_S = 3.5
"""What a run takes beside its duration, with busy cores"""
_BUSY = "import os, sys\nos.sched_setaffinity(0, {int(sys.argv[1])})\nwhile True:\n    pass\n"


@dataclass(frozen=True, slots=True)
class Run:
    """What one run's report says."""

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


def run(config: str, seconds: float, folder: str) -> Run:
    """One run in ``strict``.

    Raises:
        RuntimeError: It did not start.
    """
    words = [*PROGRAM, "run", config, "--set", "realtime.profile=strict"]
    words += ["--duration", str(seconds), "--json"]
    done = subprocess.run(
        words,
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    try:
        return of_report(json.loads(done.stdout))
    except (ValueError, KeyError) as error:
        raise RuntimeError(f"{config} did not run: {done.stdout}{done.stderr}") from error


def of_report(report: dict[str, Any]) -> Run:
    """What counts of a report."""
    ticks, missed = report["ticks"], report["missed_ticks"]
    interval = (report["guard"] or {}).get("interval_s")
    return Run(
        stop_reason=report["stop_reason"],
        missed=missed / (ticks + missed) if ticks else 0.0,
        interval_ms=None if interval is None else 1e3 * interval,
        warned=any("safety.max_missed" in warning for warning in report["warnings"]),
    )


def row(config: str, runs: Sequence[Run]) -> str:
    """One line of the table."""
    trips = [each.stop_reason for each in runs if each.stop_reason != "duration"]
    missed = sorted(each.missed for each in runs)
    intervals = sorted(each.interval_ms for each in runs if each.interval_ms is not None)
    counted = f"{intervals[len(intervals) // 2]:g}, {intervals[-1]:g}" if intervals else "–"
    return (
        f"| `{config}` | {len(runs)} | {len(trips)} | {', '.join(sorted(set(trips))) or '–'} "
        f"| {missed[len(missed) // 2]:.2%}, {missed[-1]:.2%} | {counted} |"
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
                runs.append(run(config, wanted.seconds, folder))
                print(config, runs[-1], file=sys.stderr, flush=True)
            failed |= any(each.stop_reason != "duration" for each in runs)
            rows.append(row(config, runs))
    here, made = machine(), versions()
    lines = [
        "# Ordinary busy processes beside a run",
        "",
        "Written by `scripts/busy_neighbours`; run it to see the figures of your machine. On each"
        f" of {len(cores)} cores one process at normal priority never rests. Beside them runs of"
        f" {wanted.seconds:g} s with `realtime.profile=strict` follow each other, which"
        " [trips](trips.md#missed_periods) when more than `safety.max_missed` of the periods are"
        " missed in half a second.",
        "",
        f"Measured on {here['processor']}, {here['cores']} cores, {here['system']}, Python"
        f" {made['python']}.",
        "",
        "| configuration | runs | tripped | by | periods missed: median, most "
        "| interval counted [ms]: median, most |",
        "| --- | --- | --- | --- | --- | --- |",
        *rows,
        "",
    ]
    wanted.out.write_text("\n".join(lines))
    print("\n".join(lines))
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
