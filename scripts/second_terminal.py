"""Tries the emulated bus in a second terminal on a loaded machine; writes docs/second-terminal.md.

    scripts/second_terminal [--runs N] [--seconds S] [--quiet-cores] [--out FILE]

For each run a bus is started as the README's first terminal does, and the wall as its second does,
beside one process on each core that never rests. Beside that preset, ``xm430-w350`` on the same
port shows what the patience of the preset is for. Exit status 1 if a run of the preset tripped.
"""

import contextlib
import os
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from haptic_wall.controller.system.signals import interrupting
from scripts.busy_neighbours import busy_cores
from scripts.whole_program import (
    emulated_bus,
    measured_on,
    middle_and_most,
    missed_share,
    page_options,
    run_report,
    say_time,
)

PRESET = ("emulated-port",)
REAL = ("xm430-w350", "--set", "realtime.profile=best-effort")
AROUND_S = 8.0
"""Duration of a bus and a run beside the run's own, with busy cores [s]"""


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


def of_report(report: dict[str, Any]) -> Run:
    """Take the figures of a run from its report."""
    bus = report["bus"] or {"cycles": 0, "lost": 0}
    return Run(
        stop_reason=report["stop_reason"],
        lost=bus["lost"] / bus["cycles"] if bus["cycles"] else 0.0,
        missed=missed_share(report),
        scheduler=any(s["name"] == "scheduler" and s["ok"] for s in report["realtime"]),
    )


def run(words: Sequence[str], seconds: float, folder: Path) -> Run:
    """Start a bus, run the wall on it once, and return the figures.

    Raises:
        RuntimeError: The run did not start.
    """
    bus = ["--set", f"servo.port={folder / 'bus'}", "--duration", str(seconds)]
    with emulated_bus("--link", folder / "bus", "--set", "servo.hand=push"):
        return of_report(run_report(folder, *words, *bus))


def row(words: Sequence[str], runs: Sequence[Run]) -> str:
    """One line of the table."""
    ends = Counter(each.stop_reason for each in runs)
    planned = ends.pop("duration", 0)
    trips = ", ".join(f"{name} {count}" for name, count in sorted(ends.items()))
    lost = middle_and_most([each.lost for each in runs], ".1%")
    missed = middle_and_most([each.missed for each in runs], ".1%")
    return (
        f"| `{' '.join(words)}` | {planned} of {len(runs)} | {trips or '–'} "
        f"| {lost} | {missed} | {'yes' if all(each.scheduler for each in runs) else 'no'} |"
    )


def main() -> int:
    """Run, write the page; 1 if a run of the preset tripped."""
    parser = page_options("second_terminal", __doc__, "second-terminal.md")
    parser.add_argument("--runs", type=int, default=20, help="of each configuration")
    parser.add_argument("--seconds", type=float, default=5.0, help="how long each lasts")
    parser.add_argument("--quiet-cores", action="store_true", help="start no busy processes")
    wanted = parser.parse_args()
    say_time(2 * wanted.runs * (wanted.seconds + AROUND_S))
    rows, failed, load = [], False, []
    beside = contextlib.nullcontext() if wanted.quiet_cores else busy_cores()
    with interrupting(), tempfile.TemporaryDirectory() as folder, beside:
        for words in (PRESET, REAL):
            runs = []
            for _ in range(wanted.runs):
                runs.append(run(words, wanted.seconds, Path(folder)))
                load.append(os.getloadavg()[0])
                print(words[0], runs[-1], file=sys.stderr, flush=True)
            failed |= words == PRESET and any(each.stop_reason != "duration" for each in runs)
            rows.append(row(words, runs))
    busy = "no busy process" if wanted.quiet_cores else "on each core a process that never rests"
    lines = [
        "# The bus in a second terminal, on a loaded machine",
        "",
        "Written by `scripts/second_terminal`; run it to see the figures of your machine. For each"
        " run a bus is started with `haptic-wall emulate --link /tmp/bus --set servo.hand=push`,"
        f" and beside it a run of {wanted.seconds:g} s; {busy}. The load of the whole machine (1"
        f" min) was {min(load):.1f} to {max(load):.1f} meanwhile. The second line is the preset of"
        " a real servo on the same port: a real servo always answers in time, so that preset takes"
        " lost replies for a fault.",
        "",
        measured_on(),
        "",
        "| configuration | ended as planned | else by | replies late or lost: median, most "
        "| periods missed: median, most | loop's real-time scheduling |",
        "| --- | --- | --- | --- | --- | --- |",
        *rows,
        "",
    ]
    wanted.out.write_text("\n".join(lines), encoding="utf-8")
    print("\n".join(lines))
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
