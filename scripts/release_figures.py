"""Measures what releases are compared by: ratios to something measured in the same round.

Another machine, or other load, falls on both parts of a ratio, so that entries of different days
compare better than times do.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from haptic_wall.controller.bench.loops import AT_REST, FORGIVING, LOOPS, Ran, emulated_bus
from haptic_wall.controller.bench.rows import ratio
from haptic_wall.controller.bench.torque_frames import torque_frames
from haptic_wall.controller.emulated_bus.record import read_rows
from haptic_wall.controller.experiments.maps.maps import MapQuestion, MapSettings
from haptic_wall.controller.settings.load import load_config
from scripts.whole_program import PROGRAM, ROOT, with_sets

MODULE = "haptic_wall.controller.cli.main"
SECONDS, RATE_HZ = 2.0, 1000.0
RUN_S = 0.3
DAMPINGS, DELAYS, KICKS = (0.0, 0.1, 0.3, 1.0), (0, 2), (0.01, 0.1)


@dataclass(frozen=True, slots=True)
class Figure:
    """One figure of a release."""

    title: str
    unit: str
    """``1``: a ratio"""
    less_is_better: bool | None
    """None: neither is"""
    value: float
    low: float | None = None
    """Quartiles of the rounds"""
    high: float | None = None


BENCH = {
    "highest_rate": {
        "highest_rate": ("haptic-wall, highest rate: over that of the bare loop", False),
    },
    "torque_frames": {
        "frames_p50": ("interval of torque frames, deviation, p50, over the bare loop's", True),
        "frames_p99": ("interval of torque frames, deviation, p99, over the bare loop's", True),
    },
    "array_simulation": {
        "array_compiled": ("compiled array simulation over the machine's arithmetic", False),
        "array_over_numpy": ("compiled array simulation over the arrays", False),
    },
}
"""Sections of ``haptic-wall bench``, and which of their ratios are kept under which title"""
ROWS = {
    "highest_rate": "haptic-wall, highest rate: over that of the bare loop",
    "frames_p50": "haptic-wall, deviation of torque frames' intervals from the period, p50: over",
    "frames_p99": "haptic-wall, deviation of torque frames' intervals from the period, p99: over",
    "array_compiled": "compiled over the arithmetic alone, servos with friction and encoder",
    "array_over_numpy": "compiled over the array, servos with friction and encoder",
}
"""How the rows of those ratios begin"""


def own_figures(rounds: int, say: Callable[[str], None]) -> dict[str, Figure]:
    """Measure what no section of the benchmark does.

    Args:
        rounds: Rounds in which all takes turns.
        say: Told what is measured.
    """
    say("work, lateness and start-up beside the bare loop")
    found = _loops(rounds)
    say("imports and points of a map beside plain Python")
    return found | _plain(rounds)


def suite_figures(*, run: bool, say: Callable[[str], None]) -> dict[str, Figure]:
    """Count all tests, and where it is wanted take the processor time of ``scripts/test``."""
    say("counting tests")
    listed = subprocess.run(
        [sys.executable, "-m", "pytest", "--collect-only", "-q", "-n", "0", "--whole"],
        check=False,
        capture_output=True,
        text=True,
        cwd=ROOT,
    )
    count = sum("::" in line for line in listed.stdout.splitlines())
    if not count:
        sys.exit(f"pytest found no tests: {listed.stdout[-500:]}{listed.stderr[-500:]}")
    figures = {"tests": Figure("tests", "tests", None, float(count))}
    if run:
        say("running scripts/test")
        spent = _processor_s(["sh", str(ROOT / "scripts" / "test")])
        title = "processor time of scripts/test over plain Python's piece of work"
        figures["tests_time"] = Figure(title, "1", True, spent / _plain_s())
    return figures


def kept(rows: Sequence[dict[str, object]], section: str) -> dict[str, Figure]:
    """Return the figures that are kept of a section of ``haptic-wall bench --json``."""
    found = {}
    for key, (title, less) in BENCH[section].items():
        for row in rows:
            if str(row["name"]).startswith(ROWS[key]):
                value, low, high = (row[name] for name in ("value", "low", "high"))
                assert isinstance(value, float)
                assert low is None or isinstance(low, float)
                assert high is None or isinstance(high, float)
                found[key] = Figure(title, "1", less, value, low, high)
    return found


def _loops(rounds: int) -> dict[str, Figure]:
    """Compare work, lateness and start-up with those of the bare loop, on one bus."""
    ran: dict[str, list[Ran]] = {name: [] for name in LOOPS}
    began: dict[str, list[float]] = {name: [] for name in LOOPS}
    with tempfile.TemporaryDirectory() as folder:
        record = Path(folder) / "bus.csv"
        with emulated_bus("--record", str(record)) as path:
            commands = {
                "bare loop": [
                    *(sys.executable, "-m", "haptic_wall.controller.bench.bare_loop"),
                    *(path, str(RUN_S), "--rate", str(RATE_HZ)),
                ],
                "haptic-wall": [
                    *PROGRAM,
                    *("run", "xm430-w350", "--duration", str(RUN_S), "--no-plot", "--json"),
                    *("--log", str(Path(folder) / "run.hwlog")),
                    *with_sets((f"servo.port={path}", *FORGIVING, *AT_REST)),
                ],
            }
            for _ in range(rounds):
                for name, loop in LOOPS.items():
                    ran[name].append(loop(path, SECONDS, RATE_HZ))
                    time.sleep(0.1)  # what the loop still sent is in the record
                    began[name].append(time.monotonic())
                    done = subprocess.run(commands[name], check=False, capture_output=True)
                    if done.returncode:
                        sys.exit(f"{name} did not run: {done.stdout!r} {done.stderr!r}")
                    (Path(folder) / "run.hwlog").unlink(missing_ok=True)
        sent_s = torque_frames(read_rows(record))
    started = {
        name: [float(sent_s[sent_s > start][0]) - start for start in starts]
        for name, starts in began.items()
    }
    found = {}
    for what in ("work", "lateness"):
        for percentile in ("p50", "p99"):
            both = {
                name: [each.times_us[what][percentile] or 0.0 for each in turns]
                for name, turns in ran.items()
            }
            title = f"{what} of a tick, {percentile}, over the bare loop's"
            found[f"{what}_{percentile}"] = _ratio(title, both["haptic-wall"], both["bare loop"])
    title = "start-up until the first torque frame, over the bare loop's"
    found["start_up"] = _ratio(title, started["haptic-wall"], started["bare loop"])
    return found


def _plain(rounds: int) -> dict[str, Figure]:
    """Compare processor times with those of plain Python."""
    question = MapQuestion(
        MapSettings.of(load_config("simulated", ("wall.side=both",)).config),
        DAMPINGS,
        DELAYS,
        KICKS,
    )
    times: dict[str, list[float]] = {}
    for counted in range(rounds + 1):  # the first one compiles and imports
        now = {
            "start": _processor_s([sys.executable, "-c", "pass"]),
            "import": _processor_s([sys.executable, "-c", "import haptic_wall"]),
            "command": _processor_s([sys.executable, "-c", f"import {MODULE}"]),
            "plain": _plain_s(),
            "map": _map_s(question),
        }
        for name, value in now.items():
            times.setdefault(name, []).extend([value] if counted else [])
    return {
        "import": _ratio("import haptic_wall over Python's own start", *_two(times, "import")),
        "command": _ratio("import of the command over Python's own start", *_two(times, "command")),
        "map_point": _ratio(
            "a point of a map over plain Python's piece of work",
            [value / question.points for value in times["map"]],
            times["plain"],
        ),
    }


def _two(times: dict[str, list[float]], name: str) -> tuple[list[float], list[float]]:
    return times[name], times["start"]


def _plain_s() -> float:
    """Return the processor time of a fixed piece of work in plain Python [s]."""
    began, value = time.process_time(), 0.5
    for k in range(300_000):
        value = 0.999 * value + (0.001 if value < k else 0.002)
    return time.process_time() - began


def _map_s(question: MapQuestion) -> float:
    began = time.process_time()
    for task in question.tasks():
        question.call(task)()
    return time.process_time() - began


def _processor_s(command: Sequence[str]) -> float:
    """Run a command; return the processor time of it and its children [s]."""
    process = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, cwd=ROOT
    )
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        sys.exit(
            f"{' '.join(command)} ended with {process.returncode}; run it, and mend that first"
        )
    return usage.ru_utime + usage.ru_stime


def _ratio(title: str, ours: Sequence[float], theirs: Sequence[float]) -> Figure:
    found = ratio(title, ours, theirs, "")
    return Figure(title, "1", True, found.value, found.low, found.high)
