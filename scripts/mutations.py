"""Hands thousands of damaged, crafted and edited files to the commands that read them.

    scripts/mutations [--seed N] [--only KIND ...] [--share S] [--out FILE]

Logs that were damaged, logs that no run has written though their checksums are right,
configurations, CSVs, and folders of commissionings. No command may end in a traceback, take more
than 5 s of processor time or more than 300 MB, send what a terminal obeys, or give rows that were
not written without a word. The summary is a part of docs/logs.md; which files are made depends on
the seed alone.
"""

from __future__ import annotations

import argparse
import json
import os
import queue
import resource
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from scripts.mutation_trial import COMMISSION, KINDS, Tried, tried
from scripts.uncertainty import renewed
from scripts.whole_program import PROGRAM, ROOT, measured_on, page_options, say_time

PAGE = ROOT / "docs" / "logs.md"
PART = "mutations"
COUNTS = {"logs": 2000, "crafted": 1000, "configurations": 500, "csvs": 500, "folders": 200}
NAMES = {
    "logs": "logs of the current format, damaged",
    "crafted": "logs with right checksums that no run has written",
    "configurations": "configurations",
    "csvs": "CSVs",
    "folders": "folders of a commissioning, edited",
}
FAULTS = {
    "traceback": "tracebacks",
    "hang": "above 5 s",
    "memory": "above 300 MB",
    "terminal": "control characters",
    "wrong": "wrong without a word",
}
MOST_MB = 300
"""That a command may take beyond what the program itself takes"""
_KILL_S = 1000.0
"""Waited for, when even what ends a command that takes too long does not"""
_CASE_S = 0.25
"""Time for a file, about [s]"""


@dataclass(slots=True)
class Result:
    """Result of one file, and its cost."""

    tried: Tried
    seconds: float
    megabytes: float
    """Beyond what the process had taken before"""


def work(base: Path, kinds: Sequence[str]) -> None:
    """Try the files that are named on standard input, within bounds; results on standard output.

    Args:
        base: A commissioning that is finished.
        kinds: Of the files that may come.
    """
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for kind in kinds:  # what loads with the first of each counts as the program's own
            tried(kind, 0, 1, folder, base, limited=False)
        for line in sys.stdin:
            kind, number, seed = line.split()
            most = _status("VmSize") + MOST_MB * 2**20
            resource.setrlimit(resource.RLIMIT_AS, (most, resource.RLIM_INFINITY))
            Path("/proc/self/clear_refs").write_text("5")  # the largest memory counts anew
            before, began = _status("VmRSS"), time.process_time()
            found = tried(kind, int(number), int(seed), folder, base, limited=True)
            took = time.process_time() - began
            more = max(0, _status("VmHWM") - before) / 1e6
            told = {name: getattr(found, name) for name in ("how", "outcome", "faults")}
            answers.write(json.dumps({**told, "seconds": took, "megabytes": more}) + "\n")
            answers.flush()


def _status(name: str) -> int:
    """A line of this process's status that is in kB [bytes]."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(f"{name}:"):
            return 1024 * int(line.split()[1])
    raise LookupError(name)


class _Worker:
    """A process that tries files; another one takes its place when it dies."""

    def __init__(self, base: Path, kinds: Sequence[str]) -> None:
        self._base = base
        self._kinds = kinds
        self._process: subprocess.Popen[str] | None = None

    def trial(self, kind: str, number: int, seed: int) -> Result:
        if self._process is None:
            self._process = subprocess.Popen(
                [
                    *(sys.executable, "-m", "scripts.mutations"),
                    *("--work", str(self._base), "--only", *self._kinds),
                ],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
                cwd=ROOT,
                env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
            )
        process = self._process
        assert process.stdin is not None and process.stdout is not None
        process.stdin.write(f"{kind} {number} {seed}\n")
        process.stdin.flush()
        late = threading.Timer(_KILL_S, process.kill)
        late.start()
        line = process.stdout.readline()
        late.cancel()
        if line:
            found = json.loads(line)
            seconds, megabytes = found.pop("seconds"), found.pop("megabytes")
            return Result(Tried(kind, number, **found), seconds, megabytes)
        self.close()
        died = Tried(kind, number, "", faults={"hang": "the process that read it died"})
        return Result(died, _KILL_S, 0.0)

    def close(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.communicate()
            self._process = None


def results(
    cases: Iterable[tuple[str, int, int]], base: Path, kinds: Sequence[str], workers: int
) -> Iterator[Result]:
    """Try all of them in several processes; results as they come.

    Args:
        cases: Kind, number and seed of each.
        base: A commissioning that is finished.
        kinds: Of all of them.
        workers: How many processes.
    """
    waiting: queue.SimpleQueue[tuple[str, int, int] | None] = queue.SimpleQueue()
    done: queue.SimpleQueue[Result | None] = queue.SimpleQueue()
    for case in cases:
        waiting.put(case)

    def run() -> None:
        worker = _Worker(base, kinds)
        for case in iter(waiting.get, None):
            done.put(worker.trial(*case))
        worker.close()
        done.put(None)

    for _ in range(workers):
        waiting.put(None)
        threading.Thread(target=run, daemon=True).start()
    for _ in range(workers):
        yield from iter(done.get, None)


def table(found: Sequence[Result], seed: int) -> Iterator[str]:
    """The summary, line by line."""
    yield f"| files | tried | read | read, and told | refused | {' | '.join(FAULTS.values())} |"
    yield "|---|---|---|---|---|" + "---|" * len(FAULTS)
    for kind, name in NAMES.items():
        own = [one for one in found if one.tried.kind == kind]
        outcomes = [
            sum(one.tried.outcome == outcome for one in own)
            for outcome in ("read", "told", "refused")
        ]
        faults = [sum(fault in one.tried.faults for one in own) for fault in FAULTS]
        yield f"| {name} | {' | '.join(map(str, (len(own), *outcomes, *faults)))} |"
    yield ""
    slowest = max(found, key=lambda one: one.seconds, default=None)
    largest = max(found, key=lambda one: one.megabytes, default=None)
    if slowest is None or largest is None:
        return
    yield (
        f"Seed {seed}. The slowest took {slowest.seconds:.1f} s of processor time for all that was"
        f" asked of it ({slowest.tried.kind} {slowest.tried.number}), the largest"
        f" {largest.megabytes:.0f} MB beyond the program's own"
        f" ({largest.tried.kind} {largest.tried.number}). {measured_on()}"
    )


def finished_commissioning(folder: Path) -> Path:
    """Commission a simulated servo; its folder, without logs."""
    base = folder / "base"
    subprocess.run([*PROGRAM, *COMMISSION, str(base)], check=True, capture_output=True)
    for log in base.rglob("logs/*"):
        log.unlink()
    return base


def _options() -> argparse.Namespace:
    parser = page_options("mutations", __doc__ or "", PAGE.name)
    parser.add_argument("--seed", type=int, default=1, help="says which files are made")
    parser.add_argument("--only", nargs="+", choices=list(KINDS), metavar="KIND", default=[*KINDS])
    parser.add_argument("--share", type=float, default=1.0, help="of all files, for a shorter run")
    parser.add_argument("--workers", type=int, default=len(os.sched_getaffinity(0)))
    parser.add_argument("--work", type=Path, help=argparse.SUPPRESS)
    return parser.parse_args()


def main() -> None:
    """Try all, say what was found, and write the page if all of it was tried."""
    options = _options()
    if options.work is not None:
        work(options.work, options.only)
        return
    cases = [
        (kind, number, options.seed)
        for kind in options.only
        for number in range(round(options.share * COUNTS[kind]))
    ]
    say_time(30 + _CASE_S * len(cases) / options.workers)
    found = []
    with tempfile.TemporaryDirectory() as name:
        base = Path(name)
        if "folders" in options.only:
            base = finished_commissioning(base)
        for result in results(cases, base, options.only, options.workers):
            found.append(result)
            _say(result.tried, sys.stderr)
    lines = [f"{line}\n" for line in table(found, options.seed)]
    sys.stdout.write("".join(lines))
    if len(cases) == sum(COUNTS.values()):
        text = options.out.read_text("utf-8")
        options.out.write_text(renewed(text, {PART: lambda: map(str.rstrip, lines)}), "utf-8")
    if any(one.tried.faults for one in found):
        sys.exit(1)


def _say(trial: Tried, stream: IO[Any]) -> None:
    for fault, told in trial.faults.items():
        stream.write(f"{trial.kind} {trial.number} ({trial.how[:100]}): {fault}: {told}\n")


if __name__ == "__main__":
    main()
