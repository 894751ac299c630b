"""Runs the wall for a day on the simulated clock.

    scripts/study day [--hours H] [--bus-hours H] [--turning-minutes M]

Three things at once, each in a process of its own: a day of the simulated preset under its hand,
with recorder and statistics as in any run; an hour of the emulated bus in memory; and a shaft that
turns one way all the time. Every row is looked at as it passes; the log itself goes nowhere. The
status is 1 where something that is promised did not hold.
"""

import math
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.detector.oscillation import State as Oscillation
from haptic_wall.controller.processes.inline import run_inline
from haptic_wall.controller.processes.plan import Plan
from haptic_wall.controller.runtime.session import run_session
from haptic_wall.controller.runtime.telemetry import CAPACITY, FLAG_WARM_UP, Telemetry
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.settings.load import load_config
from haptic_wall.controller.theory.checks import FloatArray, IntArray
from haptic_wall.hw.clock import SimulatedClock
from haptic_wall.hw.dynamixel.servo import DynamixelServo
from haptic_wall.hw.dynamixel.tables import MODELS, POSITION_UNIT, TICK_MODULUS
from haptic_wall.hw.emulated.bus import EmulatedBus
from haptic_wall.hw.emulated.memory_line import MemoryLine
from haptic_wall.hw.emulated.servo import EmulatedServo
from haptic_wall.hw.plant.operator_model import SCRIPTS
from haptic_wall.hw.servo import Outcome
from scripts.soak import COLLECT_NS, PERIOD_NS, SETTINGS, TRUE
from scripts.study import Found, Option, Part, Study, table

HOUR_TICKS = 3_600_000
FLAT_MB = 5.0
SAME_COUNTS = 2.0
"""How far one round of the hand may lie from another [encoder counts]: what friction leaves decides
where within a count a round begins"""
TURNING_TORQUE = 0.2
"""[N·m]: friction leaves some 9 rad/s of it"""
UPTIME_DAYS = 1000
Lines = list[tuple[str, str, bool | None]]
"""Subject, finding, and whether the promise holds; None: nothing was promised"""


@dataclass(slots=True)
class Passed:
    """Findings in the rows that passed."""

    rows: int = 0
    first_ns: int = 0
    off_grid: int = 0
    """Rows whose deadline is not a whole number of periods after the first"""
    off_seq: int = 0
    failed: int = 0
    """Readings"""
    not_finite: int = 0
    alarmed: int = 0
    """Rows in which the motion was taken for an oscillation"""
    furthest_counts: float = 0.0
    """Between one round of the hand and the third [encoder counts]"""
    hours: list[tuple[float, float]] = field(default_factory=list)
    """At the end of each simulated hour: real time since the start [s], resident memory [MB]"""


class WatchedTelemetry(Telemetry):
    """Telemetry that looks at each row when it is first read."""

    def __init__(self, descriptor: int, *, mapped: bool = False) -> None:
        super().__init__(descriptor, mapped=mapped)
        self.passed = Passed()
        self._round = np.empty(0)
        self._seen = 0
        self._began = time.monotonic()
        self.title = ""

    def read(self, tail: int, most: int = CAPACITY) -> tuple[NDArray[np.void], int]:
        """See ``Telemetry``."""
        rows, following = super().read(tail, most)
        if tail == self._seen and rows.size:
            self._look(rows)
            self._seen = following
        return rows, following

    def _look(self, rows: NDArray[np.void]) -> None:
        passed = self.passed
        if not passed.rows:
            passed.first_ns = int(rows["deadline_ns"][0])
        seq = np.arange(passed.rows, passed.rows + rows.size)
        passed.off_seq += int(np.count_nonzero(rows["seq"] != seq))
        on_grid = passed.first_ns + seq * PERIOD_NS
        deadline_ns: IntArray = rows["deadline_ns"]
        passed.off_grid += int(np.count_nonzero(deadline_ns != on_grid))
        passed.failed += int(np.count_nonzero(rows["outcome"] != Outcome.OK))
        position: FloatArray = rows["position"]
        torque: FloatArray = rows["torque"]
        finite = np.isfinite(position) & np.isfinite(torque)
        passed.not_finite += int(np.count_nonzero(~finite))
        passed.alarmed += int(np.count_nonzero(rows["oscillation"] >= Oscillation.SUSTAINED))
        self._compare(rows[(rows["flags"] & FLAG_WARM_UP) == 0])
        before, passed.rows = passed.rows, passed.rows + rows.size
        if before // HOUR_TICKS != passed.rows // HOUR_TICKS:
            passed.hours.append((time.monotonic() - self._began, resident_mb()))
            print(
                f"{self.title}: {passed.rows // HOUR_TICKS} h after {passed.hours[-1][0]:.0f} s",
                file=sys.stderr,
                flush=True,
            )

    def _compare(self, rows: NDArray[np.void]) -> None:
        """Each round of the hand with its third one."""
        length = round(SCRIPTS["push"].times_s[-1] * 1e9) // PERIOD_NS
        seq: IntArray = rows["seq"]
        position: FloatArray = rows["position"]
        number, place = np.divmod(seq, length)
        third = number == 2
        if third.any():
            if self._round.size == 0:
                self._round = np.full(length, np.nan)
            self._round[place[third]] = position[third]
        later = number > 2
        if later.any():
            away = np.abs(position[later] - self._round[place[later]])
            counts = float(np.nanmax(away)) / POSITION_UNIT
            self.passed.furthest_counts = max(self.passed.furthest_counts, counts)


def resident_mb() -> float:
    """Of this process [MB]."""
    lines = Path("/proc/self/status").read_text().splitlines()
    (size,) = (int(line.split()[1]) for line in lines if line.startswith("VmRSS"))
    return size / 1024


def long_run(case: tuple[str, float]) -> Lines:
    """A preset as ``haptic-wall run`` runs it on the simulated clock, with every row looked at."""
    preset, hours = case
    config: Config = load_config(preset, ("loop.clock=simulated",)).config
    telemetry = WatchedTelemetry.create()
    telemetry.title = preset
    began = time.monotonic()
    seconds = 3600.0 * hours
    ended = run_inline(Plan(config, seconds, Path("/dev/null"), {}, None), telemetry)
    took = time.monotonic() - began
    passed, statistics = telemetry.passed, ended.statistics
    wanted = round(seconds * 1e9) // PERIOD_NS
    warm_up = passed.rows - ended.ticks
    rows: Lines = [
        ("stop reason", ended.stop_reason, ended.stop_reason == "duration"),
        ("ticks", f"{ended.ticks} of {wanted}", ended.ticks == wanted and not ended.missed),
        ("rows out of order", f"{passed.off_seq}", not passed.off_seq),
        ("deadlines off the grid, to the nanosecond", f"{passed.off_grid}", not passed.off_grid),
        ("readings that failed", f"{passed.failed}", not passed.failed),
        ("positions or torques that are not finite", f"{passed.not_finite}", not passed.not_finite),
        (
            "rows in the statistics, rows they missed",
            f"{statistics.rows}, {statistics.unread}",
            statistics.rows == ended.ticks and not statistics.unread,
        ),
        (
            "ticks in which the hand was taken for an oscillation",
            f"{passed.alarmed}",
            not passed.alarmed,
        ),
        (
            "largest difference of a round of the hand from its third, encoder counts",
            f"{passed.furthest_counts:.1f}",
            passed.furthest_counts <= SAME_COUNTS,
        ),
    ]
    if warm_up:
        rows.append(("ticks of the warm-up", f"{warm_up}", None))
    rows += _over_time(passed, took, seconds)
    return rows


def _over_time(passed: Passed, took: float, seconds: float) -> Lines:
    rows: Lines = [("times as fast as real time", f"{seconds / took:.0f}", None)]
    if len(passed.hours) > 1:
        grown = passed.hours[-1][1] - passed.hours[0][1]
        rows.append(("memory, last hour against first, MB", f"{grown:+.1f}", grown <= FLAT_MB))
    return rows


def turning(minutes: float) -> Lines:
    """A driver in memory whose shaft turns one way all the time."""
    clock = SimulatedClock()
    truth = EmulatedServo(MODELS[SETTINGS.model], 1, 48, TRUE, start_ns=0, baud=SETTINGS.baud)
    bus = EmulatedBus([truth], baud=SETTINGS.baud, start_ns=0)
    servo = DynamixelServo(SETTINGS, MemoryLine(bus, clock))
    servo.start()
    began, deadline = time.monotonic(), clock.now_ns()
    cycles = round(60e9 * minutes) // PERIOD_NS
    failed = 0
    furthest = 0.0
    for _ in range(cycles):
        servo.request()
        reading = servo.collect(deadline + COLLECT_NS)
        if reading.outcome is Outcome.OK:
            now_ns = clock.now_ns()
            state = truth.state(now_ns)
            then = state.position - state.velocity * (now_ns - reading.sampled_ns) * 1e-9
            furthest = max(furthest, abs(then - reading.position) / POSITION_UNIT)
        else:
            failed += 1
        servo.write(TURNING_TORQUE)
        deadline += PERIOD_NS
        clock.wait_until(deadline)
    turns = truth.state(clock.now_ns()).position / math.tau
    off = servo.stop()
    wraps = clock.now_ns() // (TICK_MODULUS * 1_000_000)
    rows: Lines = [
        ("cycles", f"{cycles}", None),
        ("turns of the shaft", f"{turns:.0f}", None),
        ("wraps of the servo's 15-bit clock", f"{wraps}", None),
        ("cycles that failed", f"{failed}", not failed),
        ("largest error of the position, encoder counts", f"{furthest:.2f}", furthest < 1),
        ("torque off at the end, read back", "yes" if off else "no", off),
    ]
    rows += _over_time(Passed(), time.monotonic() - began, 60.0 * minutes)
    return rows


def long_uptime(days: int) -> Lines:
    """Ten seconds on a machine that has just been started, and on one long after."""
    differing: list[str] = []
    for preset in ("simulated", "emulated-ideal"):
        shift = days * 86_400 * 10**9
        fresh, late = (_ten_seconds(preset, start_ns) for start_ns in (0, shift))
        for name in fresh.dtype.names or ():
            moved = shift if name in ("deadline_ns", "sampled_ns") else 0
            same = np.array_equal(
                fresh[name], late[name] - moved, equal_nan=fresh[name].dtype.kind == "f"
            )
            if not same:
                differing.append(f"{preset}: {name}")
    return [("columns that differ", ", ".join(differing) or "none", not differing)]


def _ten_seconds(preset: str, start_ns: int) -> NDArray[np.void]:
    telemetry = Telemetry.create()
    config = load_config(preset, ("loop.clock=simulated",)).config
    run_session(config, SimulatedClock(start_ns), telemetry, 10.0)
    return telemetry.read(0)[0].copy()


def lines(found: Found[Any, Lines]) -> list[str]:
    """The table."""
    ((_, rows),) = found
    words = {None: "", True: "yes", False: "**no**"}
    return table(
        ["", "found", "holds"], *([name, value, words[holds]] for name, value, holds in rows)
    )


def hold(found: Found[Any, Lines]) -> bool:
    """Whether every promise holds."""
    return all(holds is not False for _, rows in found for _, _, holds in rows)


STUDY = Study(
    "evidence/day.md",
    (
        Part(
            "simulated",
            lambda given: [("simulated", given.hours)],
            long_run,
            lines,
            case_s=1700.0,
            wanted=hold,
        ),
        Part(
            "bus",
            lambda given: [("emulated-ideal", given.bus_hours)],
            long_run,
            lines,
            case_s=600.0,
            wanted=hold,
        ),
        Part(
            "turning",
            lambda given: [given.turning_minutes],
            turning,
            lines,
            case_s=200.0,
            wanted=hold,
        ),
        Part("uptime", lambda _: [UPTIME_DAYS], long_uptime, lines, case_s=5.0, wanted=hold),
    ),
    (
        Option("hours", 24.0, "duration with the simulated preset [h]"),
        Option("bus_hours", 1.0, "duration on the emulated bus [h]"),
        Option("turning_minutes", 20.0, "duration of turning in one direction [min]"),
    ),
)
