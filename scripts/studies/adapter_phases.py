"""Runs both schedules at every phase of an adapter's latency timer.

    scripts/study adapter_phases [--phases N] [--seconds S]

In memory, on the simulated clock: the same on every machine. The timer's expiries lie on a grid of
their own: where the loop's grid lies in it decides how long a reply waits. Judged by the bus's
record: how old a sample really was, and whether it was the sample it was taken for.
"""

import bisect
import itertools
from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from haptic_wall.controller.runtime.telemetry import FLAG_WARM_UP
from haptic_wall.hw.dynamixel.codec import Instruction
from haptic_wall.hw.dynamixel.tables import POSITION_UNIT
from haptic_wall.hw.emulated.adapter import BLOCKS
from haptic_wall.hw.errors import ServoError
from haptic_wall.hw.servo import Outcome
from scripts.memory_session import LIMITS_OF_HARDWARE, MemorySession, run_in_memory
from scripts.study import Found as Rows
from scripts.study import Option, Part, Study, table

WALL = ("servo.hand=tap", "wall.stiffness=30", "wall.damping=0.02")
"""A knock every second: at 5 rad/s a sample of the period before is three counts off"""
SETTINGS = tuple(
    itertools.product(
        ((1, BLOCKS[1]), (1, BLOCKS[0]), (16, BLOCKS[1])), (1000, 500), ("immediate", "pipelined")
    )
)
"""Timer [ms] and block, rate, schedule of each row"""
MS_NS = 1_000_000
REPLY_CHECK = "adapter reply"


@dataclass(slots=True)
class Found:
    """Findings over all phases."""

    ends: dict[str, int] = field(default_factory=dict)
    """How often each end was found"""
    age_p50: list[float] = field(default_factory=list)
    age_p99: list[float] = field(default_factory=list)
    """One for each phase [ms]"""
    failed: list[float] = field(default_factory=list)
    """Share of the ticks without a sample"""
    mistaken: int = 0
    """Positions that were not true when they were asked for"""
    stiffness: list[float] = field(default_factory=list)
    reasons: str = ""
    start: str = ""
    """Adapter as the start found it"""
    refused: str = ""


Adapter = tuple[tuple[int, int], int, str]
"""Timer [ms] and block, rate, schedule"""


def over_phases(case: tuple[Adapter, int, float]) -> Found:
    """One schedule at one rate, at so many phases of the timer, for so many seconds each."""
    ((timer_ms, block), rate, schedule), phases, seconds = case
    found, ends = Found(), Counter[str]()
    for number in range(phases):
        sets = (*LIMITS_OF_HARDWARE, *WALL, f"loop.rate_hz={rate}", f"servo.schedule={schedule}")
        shift_ns = number * timer_ms * MS_NS // phases
        adapter = (timer_ms * MS_NS, block)
        try:
            run = run_in_memory(sets, seconds, adapter=adapter, shift_ns=shift_ns)
        except ServoError as error:
            ends["refused"] += 1
            found.refused = str(error)
            continue
        ends[run.result.stop_reason] += 1
        _add(found, run)
    found.ends = dict(ends.most_common())
    return found


def _add(found: Found, run: MemorySession) -> None:
    ticks = run.ticks[(run.ticks["flags"] & FLAG_WARM_UP) == 0]
    found.mistaken += mistaken(run)
    guard = run.result.guard
    check = next((check for check in run.result.checks if check.name == REPLY_CHECK), None)
    found.start = f"start: {check.name} {check.found}" if check else "start: all checks passed"
    if ticks.size == 0:
        return
    assert guard is not None
    found.stiffness.append(guard["commanded"]["stiffness"])
    if guard["reasons"] and not found.reasons:
        found.reasons = "; ".join(guard["reasons"])
    found.age_p50.append(float(np.percentile(ticks["age_ns"], 50)) * 1e-6)
    found.age_p99.append(float(np.percentile(ticks["age_ns"], 99)) * 1e-6)
    found.failed.append(float(np.mean(ticks["outcome"] != Outcome.OK)))


def mistaken(run: MemorySession) -> int:
    """Positions in use that are not those of the request they are said to answer.

    The witness has the true position at the instant each request had arrived.
    """
    reads = [row for row in run.truth if row.event == "rx" and row.instruction == Instruction.READ]
    times = [row.time_ns for row in reads]
    wrong = 0
    for tick in run.ticks:
        if tick["sampled_ns"]:
            asked = reads[bisect.bisect_left(times, int(tick["sampled_ns"]))]
            wrong += abs(tick["position"] - asked.state.position) > 1.01 * POSITION_UNIT
    return wrong


def cells(case: tuple[Adapter, int, float], found: Found) -> list[str]:
    """A row of the table."""
    ((timer_ms, block), rate, schedule), *_ = case
    ends = ", ".join(f"{end} {count}" for end, count in found.ends.items())
    cells = [f"{timer_ms} ms, {block} bytes", f"{rate} Hz", schedule, ends]
    if found.age_p99:
        cells += [
            f"{min(found.age_p50):.2f} to {max(found.age_p50):.2f}",
            f"{max(found.age_p99):.2f}",
            f"{max(found.failed):.1%}",
            f"{min(found.stiffness):.3g} to {max(found.stiffness):.3g}",
        ]
    else:
        cells += ["–"] * 4
    return [*cells, str(found.mistaken)]


def lines(rows: Rows[tuple[Adapter, int, float], Found]) -> list[str]:
    """The table, and what the program says of the rows that are pipelined."""
    reasons = [
        f"- {timer_ms} ms, {rate} Hz: {found.refused or f'{found.start}. {found.reasons}'}"
        for (((timer_ms, block), rate, schedule), *_), found in rows
        if schedule == "pipelined" and block == BLOCKS[1]
    ]
    head = ["timer, block", "rate", "schedule", "ends, phases", "age p50, ms", "age p99, ms"]
    return [
        *table([*head, "without", "K, N·m/rad", "mistaken"], *(cells(*each) for each in rows)),
        "",
        "Pipelined with blocks of 510 bytes, what the start and the guard said:",
        "",
        *reasons,
    ]


STUDY = Study(
    "evidence/adapter.md",
    (
        Part(
            "phases",
            lambda given: [(each, given.phases, given.seconds) for each in SETTINGS],
            over_phases,
            lines,
            case_s=8.0,
        ),
    ),
    (
        Option("phases", 20, "phases of the latency timer for each row"),
        Option("seconds", 1.5, "duration of each run [s]"),
    ),
    everywhere=True,
)
