"""Injects every fault into the whole program for an hour.

    scripts/study chaos [--minutes M] [--seed N] [--step-clock] [--keep FOLDER]

One run after the other on an emulated bus, a hand leaning on the wall, and a seeded schedule of
faults, loads, kills and stops. The bus's own record says what the torque did, an observer on each
core when the machine itself stood still. As root everything can be injected; otherwise what is not
permitted is left out, and the page says so. The system's clock is only touched with --step-clock.
The status is 1 where a promise did not hold.
"""

import contextlib
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from random import Random
from types import FrameType
from typing import NamedTuple

from haptic_wall.controller.runtime.realtime import pick_cores
from scripts.chaos.faults import GENTLE, HARD, RECORDER_KILLED, end, load
from scripts.chaos.judge import Stall
from scripts.chaos.loads import own_mounts
from scripts.chaos.page import Hour, lines
from scripts.chaos.run import Course, Run, perform
from scripts.chaos.stage import Fault
from scripts.chaos.verdict import judge
from scripts.study import Option, Part, Study

HARD_SHARE = 0.35
"""Of the faults at a short run"""
LONG_SHARE, LONG_RUNS = 0.4, 2
"""Of the time, for long runs under gentle fire, in which memory is watched"""
SHORTEST_S, LONGEST_S = 10.0, 40.0
"""Of the other runs, unless something ends them"""
STARTING_S = 8.0
"""Time for a run to begin and to be judged [s]"""
ROOM = "256m"
"""Size of the file system that the log lies on: 25 minutes"""


def decks(random: Random, *faults: Sequence[Fault]) -> tuple[Iterator[Fault], ...]:
    """Each kind of fault in turn, in ever another order."""

    def deck(kinds: Sequence[Fault]) -> Iterator[Fault]:
        while True:
            yield from random.sample(kinds, len(kinds))

    return tuple(deck(kinds) for kinds in faults)


def mixed(random: Random, gentle: Iterator[Fault], hard: Iterator[Fault]) -> Iterator[Fault]:
    """Gentle faults with hard ones among them."""
    while True:
        yield next(hard if random.random() < HARD_SHARE else gentle)


def sparing_recorder(gentle: Iterator[Fault]) -> Iterator[Fault]:
    """Gentle faults of which no recorder dies, so that one is watched for as long as the run."""
    return (fault for fault in gentle if fault.name != RECORDER_KILLED)


@contextlib.contextmanager
def small_room(folder: Path) -> Iterator[Path | None]:
    """A small file system of our own, where that is permitted; it ends with this process."""
    if not own_mounts():
        yield None
        return
    folder.mkdir()
    done = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", f"size={ROOM}", "chaos", folder],
        check=False,
        capture_output=True,
    )
    try:
        yield None if done.returncode else folder
    finally:
        if not done.returncode:
            subprocess.run(["umount", "--lazy", folder], check=False)


@contextlib.contextmanager
def observers(folder: Path, cores: Sequence[int]) -> Iterator[tuple[list[Path], Path]]:
    """Where it is written when each core stood still, and when others ran at real-time priority."""
    with contextlib.ExitStack() as stack:

        def observer(*arguments: str) -> Path:
            path = folder / f"{'-'.join(arguments)}.txt"
            file = stack.enter_context(path.open("wb"))
            stack.callback(end, load(*arguments, output=file))
            return path

        yield [observer("watch", str(core)) for core in cores], observer("strangers")


def stalls_in(files: Sequence[Path], from_s: float) -> list[Stall]:
    """Read the observers' findings since an instant [s]."""
    lines = [line.split() for file in files for line in file.read_text().splitlines()]
    stalls = [Stall(float(line[0]), float(line[1])) for line in lines if len(line) == 2]
    return [stall for stall in stalls if stall.until_s >= from_s]


def hour(minutes: float, seed: int, step_clock: bool, keep: Path | None, found: Hour) -> None:
    """One run after the other, until the time is over; ``found`` is filled as they end."""
    random = Random(seed)
    permitted = [fault for fault in (*GENTLE, *HARD) if fault.allowed()]
    permitted = [fault for fault in permitted if step_clock or not fault.name.startswith("clock")]
    found.left_out = [s.name for s in (*GENTLE, *HARD) if s not in permitted]
    gentle, hard = decks(
        random, [s for s in permitted if s in GENTLE], [s for s in permitted if s in HARD]
    )
    core, others = pick_cores()
    until = time.monotonic() + 60.0 * minutes
    long_s = 60.0 * minutes * LONG_SHARE / LONG_RUNS
    long_at = [until - long_s - STARTING_S, time.monotonic() + 0.25 * 60.0 * minutes]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with (
            small_room(folder / "room") as place,
            observers(folder, sorted({core} | others)) as (watches, lookout),
        ):
            found.room = place is not None
            while (now := time.monotonic()) < until - STARTING_S:
                patient = bool(long_at) and now >= long_at[-1]
                seconds = long_s if patient else random.uniform(SHORTEST_S, LONGEST_S)
                seconds = min(seconds, until - now - STARTING_S)
                faults = mixed(random, gentle, hard)
                if patient:
                    faults = sparing_recorder(gentle) if len(long_at) == LONG_RUNS else gentle
                    long_at.pop()
                course = Course(seconds, faults, patient)
                here = folder / "run"
                here.mkdir(exist_ok=True)
                run = perform(course, here, place, core, random)
                stalls = stalls_in(watches, run.began_s)
                judge(run, course, here, place, stalls, stalls_in([lookout], run.began_s))
                found.add(run, stalls)
                _tell(found, run, until)
                if keep is not None and (run.problems or run.cause is None):
                    (here / "injected.txt").write_text(
                        "\n".join(map(str, [*run.injected, *stalls]))
                    )
                    _keep(keep / f"run-{len(found.runs)}", here, place)
                for file in [*here.iterdir(), *(place or here).iterdir()]:
                    file.unlink(missing_ok=True)


def _tell(found: Hour, run: Run, until: float) -> None:
    left = max(0.0, until - time.monotonic())
    print(
        f"run {len(found.runs)}: {max(0.0, run.stopped_s - run.began_s):.0f} s,"
        f" {len(run.injected)} faults, {run.reason} ({run.cause or 'UNEXPLAINED'})"
        + "".join(f"; {problem}" for problem in run.problems)
        + f"; {left / 60:.1f} min left",
        file=sys.stderr,
        flush=True,
    )


def _keep(place: Path, *folders: Path | None) -> None:
    place.mkdir(parents=True, exist_ok=True)
    for folder in folders:
        for file in folder.iterdir() if folder else ():
            if file.is_file():  # a killed run may leave its socket
                (place / file.name).write_bytes(file.read_bytes())


class Planned(NamedTuple):
    """An hour of chaos, or less."""

    minutes: float
    seed: int
    step_clock: bool
    keep: str


def injected(case: Planned) -> Hour:
    """Inject, judge, and return the findings, also when it is broken off."""
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

    def stop(_signal: int, _frame: FrameType | None) -> None:
        for number in numbers:
            signal.signal(number, signal.SIG_IGN)  # once is enough: what is undone must be whole
        raise KeyboardInterrupt

    for number in numbers:
        signal.signal(number, stop)
    found = Hour(case.minutes, case.seed)
    try:
        hour(
            case.minutes, case.seed, case.step_clock, Path(case.keep) if case.keep else None, found
        )
        found.whole = True
    except KeyboardInterrupt:
        print("broken off; the page holds what there was", file=sys.stderr)
    return found


STUDY = Study(
    "evidence/chaos.md",
    (
        Part(
            "chaos",
            lambda given: [Planned(given.minutes, given.seed, given.step_clock, given.keep)],
            injected,
            lambda found: lines(found[0][1]),
            case_s=3600.0,
            in_turn=True,
            wanted=lambda found: found[0][1].whole and not found[0][1].broken,
        ),
    ),
    (
        Option("minutes", 60.0, "duration [min]"),
        Option("seed", 1, "seed of the schedule"),
        Option("step_clock", False, "also set the system's clock wrong, for a second at a time"),
        Option("keep", "", "folder for the files of failed runs (default: none are kept)"),
    ),
)
