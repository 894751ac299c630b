"""Compares the report of a run with its witness, its log and the observers."""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from haptic_wall.controller.emulated_bus.record import rows_of
from haptic_wall.controller.errors import LogFormatError
from haptic_wall.controller.logs.file import read_log
from haptic_wall.controller.runtime.safety import End
from haptic_wall.controller.theory.checks import IntArray
from scripts.chaos.faults import HELD_UP, MAY_END
from scripts.chaos.judge import (
    MACHINE,
    REFUSED,
    STOP_FRAMES,
    STRANGERS,
    Ending,
    Stall,
    ending,
    explanation,
    gaps,
    growth_mb,
    missing_at_end,
    stalled,
)
from scripts.chaos.run import ASKED, Course, Run


def judge(
    run: Run,
    course: Course,
    folder: Path,
    room: Path | None,
    stalls: Sequence[Stall],
    strangers: Sequence[Stall],
) -> None:
    """Set what the run says of itself against the witness, the log and the observers."""
    run.strangers = len(strangers)
    if run.refused:
        run.cause = REFUSED
        return
    found = ending(rows_of(folder / "witness.csv"), course.watchdog_s)
    # When the loop last spoke: a supervisor that is stopped itself comes to the cut much later.
    run.stopped_s = stopped_s = found.last_goal_s or run.ended_s
    may_end = {**MAY_END, ASKED: frozenset({End.INTERRUPTED})}
    run.cause = explanation(run.reason, stopped_s, run.injected, may_end)
    least_s = 0.5 * course.watchdog_s
    for cause, seen in ((MACHINE, stalls), (STRANGERS, strangers)):
        if run.cause is None and stalled(run.reason, stopped_s, seen, least_s):
            run.cause = cause
    if run.witnessed:
        run.torque_problems += found.offences
        _judge_torque(run, found)
    _judge_log(run, found, (room or folder) / "run.hwlog")


def _judge_torque(run: Run, found: Ending) -> None:
    """How long the torque outlived what ended the run."""
    ender = next((fault for fault in reversed(run.injected) if fault.name == run.cause), None)
    if ender is None or found.torque_until_s is None:
        return
    run.off_s = max(0.0, found.torque_until_s - ender.from_s)
    if found.ended_s < found.torque_until_s + 0.1:
        run.torque_problems.append("the torque acted to the end of the record")


def _judge_log(run: Run, found: Ending, log: Path) -> None:
    """Whether every tick that the witness saw has its row."""
    said = next(filter(None, map(SAID_LOST.search, run.warnings)), None)
    run.lost = int(said[1]) if said else 0
    try:
        _, rows = read_log(log)
    except (OSError, LogFormatError) as error:
        run.log_problems.append(str(error))
        return
    run.rows = rows.size
    if not rows.size:
        run.log_problems.append("the log has no rows")
        return
    problems = [
        f"{missing} rows are missing at {at}" if missing > 0 else f"rows go back at {at}"
        for at, missing in gaps(rows["seq"])
    ]
    deadline_ns: IntArray = rows["deadline_ns"]
    lateness_ns: IntArray = rows["lateness_ns"]
    woke_s = (deadline_ns + lateness_ns) * 1e-9
    last_s = float(woke_s[-1])
    # What a stopped emulator has not read arrives when it goes on, long after the tick.
    held_up = any(fault.name in HELD_UP and fault.until_s >= last_s for fault in run.injected)
    behind = 0 if held_up else missing_at_end(found.goal_times, last_s)
    if behind:
        problems.append(f"{behind} ticks came after the last row")
    first = int(np.searchsorted(found.goal_times, float(woke_s[0])))
    run.goals = len(found.goal_times) - first - found.duplicates
    surplus = run.goals - STOP_FRAMES - rows.size
    if surplus > 0 and not problems:
        problems.append(f"{surplus} goals have no row")
    if said is None:
        run.log_problems += problems
    elif rows.size != int(said[2]) - run.lost:
        run.log_problems.append(f"{rows.size} rows, where the report says: {said.string}")


SAID_LOST = re.compile(r"it lacks (\d+) of (\d+) rows")
"""How the report says that rows are lost"""


def growth(run: Run) -> dict[str, float]:
    """By how much each kind of process has grown at most [MB].

    A restarted recorder is another process and begins anew: each is set against itself alone, and
    only one that was watched for long enough counts.
    """
    most: dict[str, float] = {}
    for (name, _), samples in run.memory.items():
        mb = growth_mb(samples)
        if mb is not None:
            most[name] = max(most.get(name, mb), mb)
    return most
