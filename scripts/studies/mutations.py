"""Gives thousands of damaged, crafted and edited files to the commands that read them.

    scripts/study mutations [--seed N] [--kinds KIND ...] [--share S]

Logs that were damaged, logs that no run has written though their checksums are right,
configurations, CSVs, and folders of commissionings. No command may end in a traceback, take more
than 5 s of processor time or more than 300 MB, send what a terminal obeys, or give rows that were
not written without a word. The summary is docs/evidence/mutations.md; which files are made depends
on the seed alone.
"""

from __future__ import annotations

import atexit
import json
import os
import resource
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from scripts.mutation_trial import COMMISSION, KINDS, Tried, tried
from scripts.study import ROOT, Found, Given, Option, Part, Study, table
from scripts.whole_program import PROGRAM

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


@dataclass(slots=True)
class Result:
    """Result of one file, and its cost."""

    tried: Tried
    seconds: float
    megabytes: float
    """Beyond what the process had taken before"""


def work(base: Path) -> None:
    """Try the files that are named on standard input, within bounds; results on standard output.

    Args:
        base: A commissioning that is finished, where folders are tried.
    """
    free = (resource.RLIM_INFINITY, resource.RLIM_INFINITY)
    loaded = set()
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for line in sys.stdin:
            kind, number, seed = line.split()
            if kind not in loaded:  # what loads with the first of each is the program's own
                resource.setrlimit(resource.RLIMIT_AS, free)
                tried(kind, 0, 1, folder, base, limited=False)
                loaded.add(kind)
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

    def __init__(self) -> None:
        self._folder = tempfile.TemporaryDirectory()
        self._base = Path(self._folder.name) / "base"
        self._process: subprocess.Popen[str] | None = None
        atexit.register(self.close)

    def trial(self, kind: str, number: int, seed: int) -> Result:
        if kind == "folders" and not self._base.exists():
            subprocess.run([*PROGRAM, *COMMISSION, self._base], check=True, capture_output=True)
            for log in self._base.rglob("logs/*"):
                log.unlink()
        if self._process is None:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "scripts.studies.mutations", self._base],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
                cwd=ROOT,
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


@cache
def _worker() -> _Worker:
    return _Worker()


Case = tuple[str, int, int]
"""Kind, number and seed of a file"""


def result(case: Case) -> Result:
    """Try one file."""
    return _worker().trial(*case)


def files(given: Given) -> list[Case]:
    """As many of each kind as a page wants, or a share of them."""
    return [
        (kind, number, given.seed)
        for kind in given.kinds
        for number in range(round(given.share * COUNTS[kind]))
    ]


def lines(found: Found[Case, Result]) -> list[str]:
    """The summary, and what was slowest and largest; every fault is told beside."""
    rows = []
    for kind, name in NAMES.items():
        own = [one for _, one in found if one.tried.kind == kind]
        outcomes = [
            sum(one.tried.outcome == outcome for one in own)
            for outcome in ("read", "told", "refused")
        ]
        faults = [sum(fault in one.tried.faults for one in own) for fault in FAULTS]
        rows.append([name, len(own), *outcomes, *faults])
    slowest = max((one for _, one in found), key=lambda one: one.seconds)
    largest = max((one for _, one in found), key=lambda one: one.megabytes)
    for _, one in found:
        for fault, told in one.tried.faults.items():
            how = one.tried.how[:100]
            print(f"{one.tried.kind} {one.tried.number} ({how}): {fault}: {told}", file=sys.stderr)
    return [
        *table(["files", "tried", "read", "read, and told", "refused", *FAULTS.values()], *rows),
        "",
        f"Seed {found[0][0][2]}. The slowest took {slowest.seconds:.1f} s of processor time for all"
        f" that was asked of it ({slowest.tried.kind} {slowest.tried.number}), the largest"
        f" {largest.megabytes:.0f} MB beyond the program's own"
        f" ({largest.tried.kind} {largest.tried.number}).",
    ]


STUDY = Study(
    "evidence/mutations.md",
    (
        Part(
            "mutations",
            files,
            result,
            lines,
            case_s=0.25,
            wanted=lambda found: not any(one.tried.faults for _, one in found),
        ),
    ),
    (
        Option("seed", 1, "seed of the files"),
        Option("kinds", tuple(KINDS), "kinds of files", choices=tuple(KINDS)),
        Option("share", 1.0, "fraction of all files, for a shorter run"),
    ),
)


if __name__ == "__main__":
    work(Path(sys.argv[1]))
