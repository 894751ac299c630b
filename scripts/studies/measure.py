"""Measures this program on the present machine.

    scripts/study measure [--seconds S] [--rounds N]

Everything over the emulated bus is judged by the witness (the emulator's own record) or side by
side with the bare loop (controller/bench/bare_loop.py) on the same emulator, in alternating
rounds.
"""

from __future__ import annotations

import math
import signal
import statistics
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from haptic_wall.controller.bench import loops
from haptic_wall.controller.bench.loops import FORGIVING
from haptic_wall.controller.emulated_bus.record import read_rows
from haptic_wall.controller.theory import critical_stiffness
from haptic_wall.hw.dynamixel.codec import Instruction
from scripts.study import Found, Option, Part, Study, table
from scripts.whole_program import PROGRAM, wall_run, with_sets

INERTIA, DAMPING, VIRTUAL_DAMPING, PERIOD = 0.011951, 0.011692, 0.02, 1e-3


def witnessed(folder: Path, seconds: float, factor: float | None, delay: float) -> dict[str, float]:
    """One run judged by the witness: grid, true delay, growth of the true motion."""
    stiffness = 0.0
    if factor is not None:
        stiffness = factor * limit(delay)
    record = folder / "witness.csv"
    report = wall_run(
        folder,
        "emulated-ideal",
        f"--duration={seconds}",
        f"--witness={record}",
        *with_sets(
            (
                *FORGIVING,
                "guard.mode=off",
                "wall.side=both",
                f"wall.stiffness={stiffness}",
                f"wall.damping={VIRTUAL_DAMPING if factor else 0.0}",
                "servo.kick=0.04",
                "servo.hand=none",
                "servo.coulomb=0",
                f"servo.inertia={INERTIA}",
                f"servo.damping={DAMPING}",
                "servo.torque_limit=6",
            )
        ),
        may_oscillate=True,
    )
    samples, torques, motion = read_witness(record)
    following = np.searchsorted(torques, samples)
    paired = following < torques.size
    true_delay = torques[following[paired]] - samples[paired]
    true_delay = true_delay[true_delay < 2 * PERIOD]
    half = true_delay[true_delay.size // 5 :]
    index = np.round((samples - samples[0]) / PERIOD)
    steady = slice(samples.size // 10, None)
    period = earliest_slope(index[steady], samples[steady])
    return {
        "reported_ms": report["delay_s"]["total"] * 1e3,
        "true_p50_ms": float(np.median(half)) * 1e3,
        "true_p90_ms": float(np.percentile(half, 90)) * 1e3,
        "ppm": (period / PERIOD - 1) * 1e6,
        "factor": stiffness / limit(report["delay_s"]["total"]),
        "growth": growth(*motion) if factor else 0.0,
    }


def earliest_slope(x: np.ndarray, y: np.ndarray) -> float:
    """Slope of a line under points that come late at times, and by half a period seem early."""
    for _ in range(3):
        rest = y - np.polyval(np.polyfit(x, y, 1), x)
        keep = np.abs(rest - np.median(rest)) < 0.05 * PERIOD
        x, y, rest = x[keep], y[keep], rest[keep]
    first = [part[np.argmin(rest[part])] for part in np.array_split(np.arange(x.size), 40)]
    return float(np.polyfit(x[first], y[first], 1)[0])


def limit(delay: float) -> float:
    """Exact critical stiffness of the emulated servo at a total delay [N·m/rad]."""
    return float(critical_stiffness(INERTIA, DAMPING, VIRTUAL_DAMPING, PERIOD, delay))


def read_witness(path: Path) -> tuple[np.ndarray, np.ndarray, tuple[np.ndarray, np.ndarray]]:
    """Instants of the cyclic reads and of the torques [s], and the true motion."""
    rows = read_rows(path)
    states = [row for row in rows if row.event == "state"]
    samples, torques = (
        np.array([row.time_s for row in rows if row.event == "rx" and row.instruction == wanted])
        for wanted in (Instruction.READ, Instruction.SYNC_WRITE)
    )
    # The cycles begin with the first torque that is followed by others every period.
    first = torques[np.argmax(np.diff(torques, append=np.inf) < 3 * PERIOD)]
    samples = samples[(samples > first) & (samples < torques[-1])]
    under_wall = [row for row in states if row.time_s < samples[-1]]
    motion = (
        np.array([row.time_s for row in under_wall]),
        np.array([row.position_rad for row in under_wall]),
    )
    return samples, torques, motion


def growth(times: np.ndarray, positions: np.ndarray) -> float:
    """Growth rate of the oscillation [1/s]: the slope of the logarithm of its turning points.

    NaN where a stall of the machine ended the run before there were any.
    """
    moving = np.flatnonzero(np.abs(positions - positions[0]) > 0.02)
    times, positions = times[moving[0] : -50], positions[moving[0] : -50]
    offset = positions - math.pi if abs(np.mean(positions)) > 1 else positions
    turns = np.flatnonzero(np.diff(np.sign(np.diff(offset))) != 0) + 1
    heights = np.abs(offset[turns])
    keep = heights > 0.25 * np.median(heights)
    if np.count_nonzero(keep) < 3:
        return math.nan
    return float(np.polyfit(times[turns[keep]], np.log(heights[keep]), 1)[0])


LINEAR = ["--set", "servo.coulomb=0", "--set", "servo.hand=none", "--set", "servo.kick=-0.05"]
WALLS = {"linear servo": LINEAR, "friction and hand": []}


def simulated(case: tuple[str, int]) -> float:
    """How many times as fast as real time the simulated clock runs."""
    name, _ = case
    clock = ("--set", "loop.clock=simulated")
    with tempfile.TemporaryDirectory() as folder:
        report = wall_run(Path(folder), "simulated", "--duration=60", *clock, *WALLS[name])
    return float(report["real_time_factor"])


def speed(found: Found[tuple[str, int], float]) -> list[str]:
    """A line for each servo."""
    factors = {name: [row for case, row in found if case[0] == name] for name in WALLS}
    return table(
        ["run on the simulated clock, 60 s", "times real time"],
        *(
            [f"{name}, full controller and log", f"{statistics.median(some):.0f}"]
            for name, some in factors.items()
        ),
    )


class Side(NamedTuple):
    """Figures of one run."""

    ticks: int
    missed: int
    lost: int
    late: int
    times_us: dict[str, dict[str, float | None]]
    """``lateness``, ``bus`` and ``work``, each with its ``p50`` and ``p99`` [µs]"""

    @classmethod
    def of(cls, ran: loops.Ran) -> Side:
        """From the benchmark's."""
        times = {name: dict(each) for name, each in ran.times_us.items()}
        return cls(ran.ticks, ran.missed, ran.lost, ran.late, times)


def beside_bare_loop(case: tuple[float, int]) -> list[Side]:
    """The bare loop, the whole controller on the same emulator, and the servo in its process.

    The servo simulated in the loop's process has no bus: nothing is lost, nothing waited for.
    """
    seconds, _ = case
    with loops.emulated_bus("--set", "servo.coulomb=0") as path:
        ran = (
            loops.bare(path, seconds, 1000.0),
            loops.ours(path, seconds, 1000.0),
            loops.of_run(loops.wall_run("simulated", seconds)),
        )
    return [Side.of(each) for each in ran]


def side_by_side(found: Found[tuple[float, int], list[Side]]) -> list[str]:
    """Medians of the rounds."""
    sides = list(zip(*(row for _, row in found), strict=True))
    figures: dict[str, Callable[[Side], float]] = {
        "ticks": lambda ran: ran.ticks,
        "missed_ticks": lambda ran: ran.missed,
        "lost": lambda ran: ran.lost,
        "late": lambda ran: ran.late,
    }
    rows = [
        [name, *(f"{statistics.median(map(figure, runs)):g}" for runs in sides)]
        for name, figure in figures.items()
    ]
    rows += [
        [
            f"{name}_us {percentile}",
            *(
                f"{statistics.median(ran.times_us[name][percentile] or 0.0 for ran in runs):.1f}"
                for runs in sides
            ),
        ]
        for name in ("lateness", "bus", "work")
        for percentile in ("p50", "p99")
    ]
    head = ["medians of rounds", "bare loop on the bus", "haptic-wall on the bus"]
    return table([*head, "haptic-wall, servo in its process"], *rows)


def by_the_witness(case: tuple[float, int]) -> list[list[str]]:
    """Delay, grid and stability boundary, judged by the emulator's record: a row for each run."""
    seconds, rounds = case
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        delay = witnessed(Path(folder), seconds, None, 0.0)["reported_ms"] * 1e-3
        for factor in (0.9, 1.1):
            for _ in range(rounds):
                # K is chosen by the delay the run before reported; what it was of this run's limit
                # is in the row.
                found = witnessed(Path(folder), seconds, factor, delay)
                delay = found["reported_ms"] * 1e-3
                forms = {"factor": ".3f", "ppm": "+.2f", "reported_ms": ".3f"}
                forms |= {"true_p50_ms": ".3f", "true_p90_ms": ".3f", "growth": "+.3f"}
                rows.append([f"{found[name]:{form}}" for name, form in forms.items()])
    return rows


def witness(found: Found[tuple[float, int], list[list[str]]]) -> list[str]:
    """The table."""
    head = ["K / limit", "grid error, ppm", "delay reported, ms", "true p50, ms", "true p90, ms"]
    return table([*head, "growth, 1/s"], *(cells for _, rows in found for cells in rows))


def stopping(number: int) -> tuple[float, float]:
    """From Ctrl-C to goal current 0 and to Torque Enable 0, as the witness saw it [ms]."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        record = folder / "stop.csv"
        process = subprocess.Popen(
            [
                *(*PROGRAM, "run", "emulated-ideal", "--duration=60", f"--witness={record}"),
                *("--set", "servo.hand=lean", "--log", str(folder / "stop.hwlog")),
                *("--plot", str(folder / "stop.png")),
            ],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        time.sleep(5.0 + 0.0137 * number)  # the hand leans by now; at any phase of the period
        asked = time.monotonic()
        process.send_signal(signal.SIGINT)
        process.wait()
        after = [row for row in read_rows(record) if row.event == "rx" and row.time_s > asked]
    goals = [row for row in after if row.instruction == Instruction.SYNC_WRITE]
    none = next(row for row in goals if row.params.endswith(bytes(2)))
    last = next(row for row in after if row.instruction == Instruction.WRITE)
    return (none.time_s - asked) * 1e3, (last.time_s - asked) * 1e3


def stops(found: Found[int, tuple[float, float]]) -> list[str]:
    """Medians and longest."""
    times = zip(*(row for _, row in found), strict=True)
    rows = zip(("goal current 0", "Torque Enable 0"), times, strict=True)
    return table(
        ["from Ctrl-C to", "median, ms", "longest, ms"],
        *([name, f"{statistics.median(ms):.2f}", f"{max(ms):.2f}"] for name, ms in rows),
    )


STUDY = Study(
    "evidence/measured.md",
    (
        Part(
            "simulated-clock",
            lambda given: [(name, n) for name in WALLS for n in range(given.rounds)],
            simulated,
            speed,
            case_s=3.0,
            in_turn=True,
        ),
        Part(
            "bare-loop",
            lambda given: [(given.seconds, n) for n in range(given.rounds)],
            beside_bare_loop,
            side_by_side,
            case_s=42.0,
            in_turn=True,
        ),
        Part(
            "witness",
            lambda given: [(given.seconds, given.rounds)],
            by_the_witness,
            witness,
            case_s=100.0,
            in_turn=True,
        ),
        Part(
            "stopping",
            lambda given: list(range(2 * given.rounds)),
            stopping,
            stops,
            case_s=8.0,
            in_turn=True,
        ),
    ),
    (
        Option("seconds", 10.0, "duration of each run [s]"),
        Option("rounds", 3, "alternating rounds"),
    ),
)
