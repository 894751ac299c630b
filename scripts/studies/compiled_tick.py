"""Measures the parts of a tick's work, and the gain of compiled modules and of other interpreters.

    scripts/study compiled_tick [--quick] [--only PART]

Each round runs every loop once on one emulated bus, on a machine that does nothing else. The
compiled modules need mypyc, setuptools and a C compiler. The interpreters are those on PATH that
can import the program.
"""

from __future__ import annotations

import os
import statistics
import sys
import sysconfig
import tempfile
from contextlib import suppress
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import NamedTuple
from unittest.mock import patch

from haptic_wall.controller.bench.loops import emulated_bus, told_by
from haptic_wall.controller.runtime.realtime import pick_cores
from haptic_wall.hw.errors import ServoError
from scripts.compiled_package import DRIVER, MODULES, SIMULATED, compiled
from scripts.loop_rounds import (
    Arm,
    Round,
    Turn,
    highest_rates,
    in_turn,
    rate_lines,
    ratios,
    turn_lines,
)
from scripts.loop_turn import Side
from scripts.same_rows_cases import CASES
from scripts.study import Found, Given, Option, Part, Study, table
from scripts.tick_steps import Level

BARE, PLAIN = "bare loop", "haptic-wall"
NAMES = {
    Level.BYTES: "the bare loop; reading the reply counts as work, too",
    Level.MATCHED: "+ replies matched to their requests",
    Level.DRIVER: "+ watchdog, health, jump filter, units",
    Level.VELOCITY: "+ velocity, age and interval of the samples",
    Level.WALL: "+ safety limits, wall, delay",
    Level.GUARD: "+ guard",
    Level.DETECTOR: "+ oscillation watch, driven speed",
    Level.ROW: "+ row",
    Level.TICK: "the program's tick: + start of the wall, dead man, changes, trips, counters",
}


@cache
def _folder() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory()


@cache
def compiled_side(modules: tuple[str, ...] = MODULES) -> Side:
    """Compile modules, once; they are removed when this process ends."""
    place = Path(_folder().name, str(len(modules)))
    place.mkdir()
    return Side(place=compiled(place, modules))


def arms() -> list[Arm]:
    """Return the bare loop, the program, and the program with all its modules compiled."""
    return [
        Arm(BARE, BARE, BARE, Side()),
        Arm(PLAIN, BARE, PLAIN, Side()),
        Arm(f"{PLAIN}, compiled", BARE, PLAIN, compiled_side()),
    ]


def more_arms() -> list[Arm]:
    """Return these, the program once more, and the program with only its driver compiled."""
    return [
        *arms(),
        Arm(f"{PLAIN}, driver compiled", BARE, PLAIN, compiled_side(DRIVER)),
        Arm(f"{PLAIN} again", BARE, PLAIN, Side()),
    ]


def rounds(given: Given) -> list[Round]:
    """Return the rounds of a part."""
    return [Round(number, given.seconds) for number in range(given.rounds)]


def compared(case: Round) -> list[Turn]:
    """Run each loop once."""
    return in_turn(case, more_arms())


def searched(_number: int) -> dict[str, float]:
    """Search the highest rates once."""
    return highest_rates(arms())


# The same rows, whether compiled or not.


class Wall(NamedTuple):
    """A simulated wall, with compiled modules and without."""

    same: bool
    """Rows and report are the same to the last bit"""
    compiled: int
    """Number of compiled modules"""


def both_walls(name: str) -> Wall:
    """Run a wall of ``scripts/study same_rows`` on both sides."""
    fast = compiled_side(SIMULATED)
    same = Side().tell("rows", name) == fast.tell("rows", name)
    return Wall(same, len(fast.tell("about", *SIMULATED)["compiled"]))


def wall_lines(found: Found[str, Wall]) -> list[str]:
    """A sentence."""
    other = [name for name, row in found if not row.same]
    count = min(row.compiled for _, row in found)
    return [
        f"{count} of {len(SIMULATED)} modules compiled. {len(found) - len(other)} of"
        f" {len(found)} simulated walls of `scripts/study same_rows` give the same rows and report"
        f" to the last bit{': others are ' + ', '.join(other) if other else ''}.",
    ]


# The parts of a tick.


class LevelTimes(NamedTuple):
    """One level of the loop."""

    level: Level
    compiled: bool
    p50: float
    """Work [µs]"""
    p99: float
    calls: dict[str, list[float]]
    """Calls a tick, and their median time [µs]; empty: not timed"""


def levels(case: Round) -> list[LevelTimes]:
    """Run the loop at each level, in an order that goes on by one with each round."""
    every = [(level, fast) for level in Level for fast in (False, True)]
    first = case.number % len(every)
    with emulated_bus() as path:
        return [
            at_level(path, level, case.seconds, fast=fast, calls=False)
            for level, fast in (*every[first:], *every[:first])
        ]


def system_calls(case: Round) -> list[LevelTimes]:
    """Time the system calls of the bare loop and of the tick."""
    with emulated_bus() as path:
        return [
            at_level(path, level, case.seconds, fast=False, calls=True)
            for level in (Level.BYTES, Level.TICK)
        ]


def at_level(path: str, level: Level, seconds: float, *, fast: bool, calls: bool) -> LevelTimes:
    """Run the loop at one level, with compiled modules or without."""
    core, _ = pick_cores()
    side = compiled_side() if fast else Side()
    orders = {"path": path, "level": int(level), "seconds": seconds, "calls": calls}
    with patch.dict(os.environ, {"PYTHONPATH": side.path}):
        told = told_by("the loop", ["scripts.tick_steps"], orders, seconds, {core})
    return LevelTimes(level, fast, told["p50"], told["p99"], told["calls"])


def level_lines(found: Found[Round, list[LevelTimes]]) -> list[str]:
    """A line for each level."""

    def of(level: Level, figure: str, *, fast: bool = False) -> list[float]:
        each = [times for _, row in found for times in row if times.level is level]
        return [getattr(times, figure) for times in each if times.compiled is fast]

    rows = []
    before: float | None = None
    for level in Level:
        p50 = of(level, "p50")
        middle = statistics.median(p50)
        cells = [NAMES[level], f"{middle:.1f}", "" if before is None else f"{middle - before:+.1f}"]
        before = middle
        first, fast = of(Level.BYTES, "p50"), of(level, "p50", fast=True)
        cells += [ratios(p50, first), f"{statistics.median(of(level, 'p99')):.1f}"]
        cells += [f"{statistics.median(fast):.1f}", ratios(fast, first)]
        rows.append([*cells, f"{statistics.median(of(level, 'p99', fast=True)):.1f}"])
    head = ["the loop", "work p50, µs", "more", "over the first", "work p99, µs"]
    head += ["compiled: work p50, µs", "over the first", "compiled: work p99, µs"]
    return [*table(head, *rows), "", f"{len(found)} rounds of {found[0][0].seconds:g} s."]


def call_lines(found: Found[Round, list[LevelTimes]]) -> list[str]:
    """A line for each kind of call, in the bare loop and in the tick."""
    kinds = list(dict.fromkeys(kind for _, row in found for each in row for kind in each.calls))
    rows, sums = [], {Level.BYTES: 0.0, Level.TICK: 0.0}
    for kind in kinds:
        cells = [kind]
        for level in sums:
            each = [
                times.calls.get(kind, [0.0, 0.0])
                for _, row in found
                for times in row
                if times.level is level
            ]
            count, time = (statistics.median(values) for values in zip(*each, strict=True))
            sums[level] += count * time
            cells += [f"{count:.2f}", f"{time:.1f}"]
        rows.append(cells)
    rows.append(["all, a tick", "", f"{sums[Level.BYTES]:.1f}", "", f"{sums[Level.TICK]:.1f}"])
    head = ["call", "bare loop: calls a tick", "µs each", "tick: calls a tick", "µs each"]
    return table(head, *rows)


# Other interpreters.


@cache
def interpreters() -> dict[str, Side]:
    """Return the interpreters on PATH that can import the program, by version."""
    here = Side()
    found = {str(here.tell("about")["version"]): here}
    own = f"python{sys.version_info[0]}.{sys.version_info[1]}"
    for folder in os.environ["PATH"].split(os.pathsep):
        for path in sorted(Path(folder).glob("python3.[0-9][0-9]")):
            packages = sysconfig.get_path("purelib") if path.name == own else ""
            side = Side(str(path), packages=packages)
            with suppress(ServoError, OSError):
                found.setdefault(str(side.tell("about")["version"]), side)
    return found


def other_pythons(case: Round) -> list[Turn]:
    """Run the bare loop and the program once with each interpreter.

    Another one of this version runs the compiled program, too.
    """
    every = []
    for version, side in interpreters().items():
        base = f"{BARE}, Python {version}"
        every += [
            Arm(base, base, BARE, side),
            Arm(f"{PLAIN}, Python {version}", base, PLAIN, side),
        ]
        if side.packages:
            fast = replace(side, place=compiled_side().place)
            every.append(Arm(f"{PLAIN}, compiled, Python {version}", base, PLAIN, fast))
    return in_turn(case, every)


def plain(version: str) -> float:
    """Return the processor time of a piece of plain Python with an interpreter [ms]."""
    return float(interpreters()[version].tell("about")["plain_ms"])


def plain_lines(found: Found[str, float]) -> list[str]:
    """A line for each interpreter."""
    return table(["Python", "a piece of plain Python, ms"], *([v, f"{ms:.1f}"] for v, ms in found))


STUDY = Study(
    "evidence/compiled-tick.md",
    (
        Part(
            "rows",
            lambda given: list(CASES)[:: max(1, len(CASES) // given.walls)][: given.walls],
            both_walls,
            wall_lines,
            case_s=12.0,
            in_turn=True,
            wanted=lambda found: all(row.same for _, row in found),
        ),
        Part("work", rounds, compared, turn_lines, case_s=40.0, in_turn=True),
        Part(
            "rates",
            lambda given: list(range(given.searches)),
            searched,
            lambda found: rate_lines(found, BARE),
            case_s=120.0,
            in_turn=True,
        ),
        Part("levels", rounds, levels, level_lines, case_s=100.0, in_turn=True),
        Part("calls", rounds, system_calls, call_lines, case_s=15.0, in_turn=True),
        Part(
            "pythons",
            lambda _given: list(interpreters()),
            plain,
            plain_lines,
            case_s=2.0,
            in_turn=True,
        ),
        Part("interpreters", rounds, other_pythons, turn_lines, case_s=60.0, in_turn=True),
    ),
    (
        Option("rounds", 5, "rounds of each part", quick=2),
        Option("seconds", 3.0, "duration of each loop [s]", quick=1.5),
        Option("searches", 4, "searches of the highest rate", quick=1),
        Option("walls", 20, "simulated walls whose rows are compared", quick=3),
    ),
)
