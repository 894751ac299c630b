"""Injects a fault into every process of a run, and measures the time until the torque is off.

    scripts/study kill_times [--rounds N] [--faults TEXT]

The whole tree of processes on an emulated bus of its own, a hand leaning on the wall, the Bus
Watchdog at 40 ms as for hardware. From the fault to zero torque by the witness: the true torque
that acts, recorded every millisecond. The table has the exit status, the rows missing from the log,
and the processes left behind.
"""

import contextlib
import json
import math
import random
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from haptic_wall.controller.cli.interrupt import INTERRUPTED
from haptic_wall.controller.emulated_bus.record import BusRow, read_rows
from haptic_wall.controller.logs.reader import LogReader
from haptic_wall.controller.runtime.telemetry import Word
from scripts.run_faults import FAULTS, Fault, target
from scripts.study import Found, Given, Option, Part, Study, table
from scripts.whole_program import emulated_bus, with_sets

LIMIT_MS = 60.0
ASKED = "interrupted"
"""Stop reason of a run that went on until it was asked to end"""
SETTINGS = (
    "servo.watchdog_s=0.04",
    "safety.heartbeat_s=0.1",
    "safety.max_loss=1",
    "safety.max_silence_s=0.02",
    "realtime.profile=best-effort",
    "wall.position=3.14159",
    "wall.stiffness=8",
    "wall.damping=0.02",
    "model.delay=0",
)
"""Patient with the machine's stalls, but for what is measured"""
PATIENT = ("servo.watchdog_s=0.5", "safety.max_silence_s=0.25", "safety.heartbeat_s=2")
"""Besides, where the run must go on: a stall of the machine is no reason to end it"""
TRUTH = ("servo.position=2.9", "servo.hand=lean", "servo.hand_origin=3.14159")
TORQUE_OFF = bytes((64, 0, 1, 0, 1, 0))
"""Write that ends the torque: 0 at address 64, Torque Enable, of id 1"""
GOAL = bytes((102, 0))
"""Begin of a write of goal currents"""
ENDED_BY = {GOAL: "goal current 0", TORQUE_OFF[:2]: "Torque Enable 0"}
LEANING_ROWS = 2500
"""When so many rows are recorded the warm-up is over and the hand leans on the wall"""
AFTER_S = 1.5
"""From a fault that ends the run to the look at what is left [s], and to the end of one that goes
on"""
GONE_S = 6.0
"""How long processes of a run may outlive it [s]"""
ATTEMPTS = 12
"""A run that a stall of the machine has ended before the fault came is begun again"""


@dataclass(frozen=True, slots=True)
class Hit:
    """Result of one fault."""

    time_ms: float | None
    """To zero torque [ms]; None: the run went on"""
    by: str
    """Process or watchdog that ended the torque"""
    status: int | None
    """Of the program's exit; None: it did not end by itself"""
    lost: int
    """Rows that the loop wrote and the log does not hold"""
    left: int
    """Processes that stayed behind"""
    stall_ms: float
    """Longest stall of the machine in the meantime, as this process saw it [ms]"""


def one_fault(fault: Fault, folder: Path) -> Hit | None:
    """One run with a fault; None: it ended by itself before."""
    record = folder / "witness.csv"
    with emulated_bus("--record", record, *with_sets(TRUTH)) as bus:
        arguments = ["xm430-w350", "--plot", str(folder / "run.png")]
        arguments += with_sets((*SETTINGS, f"servo.port={bus.port}"))
        arguments += with_sets(PATIENT if fault.goes_on else ())
        with target(bus, folder, arguments) as struck:
            while struck.run.poll() is None and not struck.ready(LEANING_ROWS):
                time.sleep(0.02)
            time.sleep(random.random() * 0.05)
            if not struck.find():
                return None
            began_s = time.monotonic()
            fault.inject(struck)
            struck_s = struck.loop_struck_s or began_s
            stall_ms = sleep(fault.later_s)
            fault.then(struck)
            time.sleep(AFTER_S)
            lived = struck.run.poll() is None
            if not fault.goes_on:  # its report and picture may take a while
                with contextlib.suppress(subprocess.TimeoutExpired):
                    struck.run.wait(20.0)
        left = struck.end_survivors(GONE_S)
    ending = until_no_torque(record, struck_s)
    if ending is None:
        return None
    report = json.loads((folder / "output").read_text() or "null")
    time_ms, by = torque_of(fault, report, ending, lived=lived)
    assert struck.words is not None  # found, or the fault would not have been injected
    lost = struck.words[Word.HEAD] - len(LogReader.open(struck.log).rows())
    return Hit(time_ms, by, struck.run.returncode, lost, left, stall_ms)


def torque_of(
    fault: Fault, report: dict[str, Any] | None, ending: tuple[float, str], *, lived: bool
) -> tuple[float | None, str]:
    """Return how long the torque lasted [ms], and the cause of its end.

    A run that goes on has no such cause. Only its report shows that it went on, because a run that
    a trip has ended still exists while its report and its picture are made.

    Args:
        fault: The injected kill or fault.
        report: Report of the run; None: it was killed.
        ending: By the witness.
        lived: Its supervisor was there when it was asked to end.
    """
    if fault.goes_on and lived and report is not None and report["stop_reason"] == ASKED:
        return None, "nothing, the run goes on"
    return ending


def sleep(seconds: float) -> float:
    """Sleep by milliseconds; the longest that one of them was too long [ms]."""
    now = time.monotonic()
    end, longest = now + seconds, 0.0
    while now < end:
        time.sleep(0.001)
        before, now = now, time.monotonic()
        longest = max(longest, now - before - 0.001)
    return longest * 1e3


def until_no_torque(record: Path, struck_s: float) -> tuple[float, str] | None:
    """From an instant [s] to the last torque [ms], and what ended it; None: there was none."""
    rows = read_rows(record)
    before = [row.torque_nm for row in rows if row.time_s <= struck_s]
    if abs(before[-1]) < 0.1:
        return None
    last = max(i for i, row in enumerate(rows) if row.time_s <= struck_s or row.torque_nm != 0.0)
    if spoke_after_the_cut(rows, struck_s):
        sys.exit("a goal was sent after the supervisor had switched the torque off")
    if last + 1 == len(rows):
        return float("inf"), "nothing"
    end = rows[last + 1]
    by = ENDED_BY.get(end.params[:2]) if end.event == "rx" else None
    return (end.time_s - struck_s) * 1e3, by or "Bus Watchdog"


def spoke_after_the_cut(rows: list[BusRow], struck_s: float) -> bool:
    """Whether a goal came after Torque Enable 0."""
    asked = [row for row in rows if row.time_s > struck_s and row.event == "rx"]
    cuts = [i for i, row in enumerate(asked) if row.params == TORQUE_OFF]
    return bool(cuts) and any(row.params[:2] == GOAL for row in asked[cuts[0] :])


def as_wanted(fault: Fault, hit: Hit) -> bool:
    """Whether a run went on, or its torque ended in time, and nothing was left behind."""
    if hit.left:
        return False
    if fault.goes_on:
        return hit.time_ms is None and hit.status == INTERRUPTED and not hit.lost
    lasted_ms = math.inf if hit.time_ms is None else hit.time_ms
    return lasted_ms <= LIMIT_MS if fault.strikes_the_torque else math.isfinite(lasted_ms)


NAMED = {fault.name: fault for fault in FAULTS}


def cases(given: Given) -> list[tuple[str, int]]:
    """Each fault by its name, so many times."""
    names = [name for name in NAMED if given.faults in name]
    return [(name, number) for name in names for number in range(given.rounds)]


def hit(case: tuple[str, int]) -> Hit:
    """Inject a fault into a run; one that ends before it is begun again."""
    name, _ = case
    signal.signal(signal.SIGHUP, signal.SIG_DFL)  # not ignored by the run, if it is by a nohup
    for _ in range(ATTEMPTS):  # each in a folder of its own: a run overwrites nothing
        with tempfile.TemporaryDirectory() as folder:
            found = one_fault(NAMED[name], Path(folder))
        if found is not None:
            return found
    sys.exit(f"{name}: {ATTEMPTS} runs ended before the fault")


def held(found: Found[tuple[str, int], Hit]) -> bool:
    """Whether all is as it should be."""
    return all(as_wanted(NAMED[name], hit) for (name, _), hit in found)


def lines(found: Found[tuple[str, int], Hit]) -> list[str]:
    """A line for each fault."""
    names = list(dict.fromkeys(name for (name, _), _ in found))
    hits = {name: [hit for case, hit in found if case[0] == name] for name in names}
    head = ["fault", "median, ms", "longest, ms", "stall, ms", "ended the torque"]
    return [
        *table([*head, "exit", "rows lost", "left"], *(cells(n, hits[n]) for n in names)),
        "",
        "Wanted: where the loop is struck or the bus is gone the torque ends within"
        f" {LIMIT_MS:g} ms; a run that must go on does, loses no row, and exits with {INTERRUPTED}"
        " on request; no process is left. "
        + ("It holds." if held(found) else "It does not hold on this machine."),
    ]


def cells(name: str, hits: list[Hit]) -> list[str]:
    """A line of the table."""
    times = [hit.time_ms for hit in hits if hit.time_ms is not None]
    return [
        name,
        f"{statistics.median(times):.1f}" if times else "–",
        f"{max(times):.1f}" if times else "–",
        f"{max(hit.stall_ms for hit in hits):.1f}",
        ", ".join(sorted({hit.by for hit in hits})),
        ", ".join(sorted({str(hit.status) for hit in hits})),
        f"{max(hit.lost for hit in hits)}",
        f"{max(hit.left for hit in hits)}",
    ]


STUDY = Study(
    "evidence/kill-times.md",
    (Part("faults", cases, hit, lines, case_s=8.0, in_turn=True, wanted=held),),
    (
        Option("rounds", 5, "runs for each kind of fault"),
        Option("faults", "", "only kinds of faults with this text in their name"),
    ),
)
