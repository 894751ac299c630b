"""Rehearses both schedules at every phase of an adapter's latency timer; writes docs/adapter.md.

    scripts/adapter_phases [--phases N] [--seconds S] [--out FILE]

In memory, on the simulated clock. The timer's expiries lie on a grid of their own: where the loop's
grid lies in it decides how long a reply waits. Judged by the bus's record: how old a sample really
was, and whether it was the sample it was taken for.
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
from scripts.rehearsal import LIMITS_OF_HARDWARE, Rehearsed, rehearse
from scripts.whole_program import measured_on, page_options, say_time

WALL = ("servo.hand=tap", "wall.stiffness=30", "wall.damping=0.02")
"""A knock every second: at 5 rad/s a sample of the period before is three counts off"""
SETTINGS = tuple(
    itertools.product(
        ((1, BLOCKS[1]), (1, BLOCKS[0]), (16, BLOCKS[1])), (1000, 500), ("immediate", "pipelined")
    )
)
"""Timer [ms] and block, rate, schedule of each row"""
START_S, SIMULATED = 0.2, 0.1
"""Time to compute a run, and to compute a second of it [s]"""
MS_NS = 1_000_000
REPLY_CHECK = "adapter reply"


@dataclass(slots=True)
class Found:
    """Findings over all phases."""

    ends: Counter[str] = field(default_factory=Counter)
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


def over_phases(
    rate: int, schedule: str, timer_ms: int, block: int, phases: int, seconds: float
) -> Found:
    """One schedule at one rate, at so many phases of the timer."""
    found = Found()
    for number in range(phases):
        sets = (*LIMITS_OF_HARDWARE, *WALL, f"loop.rate_hz={rate}", f"servo.schedule={schedule}")
        shift_ns = number * timer_ms * MS_NS // phases
        adapter = (timer_ms * MS_NS, block)
        try:
            run = rehearse(sets, seconds, adapter=adapter, shift_ns=shift_ns)
        except ServoError as error:
            found.ends["refused"] += 1
            found.refused = str(error)
            continue
        found.ends[run.result.stop_reason] += 1
        _add(found, run)
    return found


def _add(found: Found, run: Rehearsed) -> None:
    ticks = run.ticks[(run.ticks["flags"] & FLAG_WARM_UP) == 0]
    found.mistaken += mistaken(run)
    guard = run.result.guard
    check = next((check for check in run.result.checks if check.name == REPLY_CHECK), None)
    found.start = f"start: {check.name} {check.found}" if check else "start: all checks passed"
    if ticks.size == 0:
        return
    found.stiffness.append(guard["commanded"]["stiffness"])
    if guard["reasons"] and not found.reasons:
        found.reasons = "; ".join(guard["reasons"])
    found.age_p50.append(float(np.percentile(ticks["age_ns"], 50)) * 1e-6)
    found.age_p99.append(float(np.percentile(ticks["age_ns"], 99)) * 1e-6)
    found.failed.append(float(np.mean(ticks["outcome"] != Outcome.OK)))


def mistaken(run: Rehearsed) -> int:
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


def row(rate: int, schedule: str, timer_ms: int, block: int, found: Found) -> str:
    """A row of the table."""
    ends = ", ".join(f"{end} {count}" for end, count in found.ends.most_common())
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
    return "| " + " | ".join([*cells, str(found.mistaken)]) + " |"


def page(phases: int, seconds: float) -> str:
    """The whole page."""
    rows, reasons = [], []
    for (timer_ms, block), rate, schedule in SETTINGS:
        found = over_phases(rate, schedule, timer_ms, block, phases, seconds)
        rows.append(row(rate, schedule, timer_ms, block, found))
        print(rows[-1], flush=True)
        if schedule == "pipelined" and block == BLOCKS[1]:
            about = found.refused or f"{found.start}. {found.reasons}"
            reasons.append(f"- {timer_ms} ms, {rate} Hz: {about}")
    return "\n".join(
        [
            "# An adapter's latency timer",
            "",
            "Written by `scripts/adapter_phases`. The whole program on the emulated bus in memory,"
            f" on the simulated clock, {seconds:g} s at each of {phases} phases between the loop's"
            " grid and the grid of the timer, at 4 Mbit/s, with the [limits of hardware](trips.md)"
            " and a hand that knocks on a wall of 30 N·m/rad. A run that did not end by `duration`"
            " was ended by that trip.",
            "",
            "*Age*: of the sample when its torque was sent; the medians from the best phase to the"
            " worst, and the worst phase's 99th percentile. *Without*: ticks that had to use an"
            " older sample, at the worst phase. *K*: what the guard commanded at the end."
            " *Mistaken*: positions that the servo, by the bus's record, did not have when they"
            " were asked for.",
            "",
            f"{measured_on()} On the simulated clock others find the same.",
            "",
            "| timer, block | rate | schedule | ends, phases | age p50, ms | age p99, ms | without"
            " | K, N·m/rad | mistaken |",
            "|---|---|---|---|---|---|---|---|---|",
            *rows,
            "",
            "Pipelined with blocks of 510 bytes, what the start and the guard said:",
            "",
            *reasons,
            "",
        ]
    )


def main() -> None:
    """Rehearse, write the page."""
    parser = page_options("adapter_phases", __doc__, "adapter.md")
    parser.add_argument("--phases", type=int, default=20, help="of the timer, for each row")
    parser.add_argument("--seconds", type=float, default=1.5, help="length of each run")
    wanted = parser.parse_args()
    say_time(len(SETTINGS) * wanted.phases * (START_S + wanted.seconds * SIMULATED))
    wanted.out.write_text(page(wanted.phases, wanted.seconds))


if __name__ == "__main__":
    main()
