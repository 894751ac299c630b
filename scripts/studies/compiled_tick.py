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
from functools import cache
from pathlib import Path
from typing import NamedTuple

from haptic_wall.controller.bench.loops import emulated_bus, told_by
from haptic_wall.controller.runtime.realtime import pick_cores
from haptic_wall.hw.errors import ServoError
from scripts.compiled_package import MODULES, compiled
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
def compiled_side() -> Side:
    """Compile the modules, once; they are removed when this process ends."""
    return Side(place=compiled(Path(_folder().name)))


def arms() -> list[Arm]:
    """Return the bare loop and the program, twice as it is, and compiled."""
    return [
        Arm(BARE, BARE, BARE, Side()),
        Arm(PLAIN, BARE, PLAIN, Side()),
        Arm(f"{PLAIN} again", BARE, PLAIN, Side()),
        Arm(f"{PLAIN}, compiled", BARE, PLAIN, compiled_side()),
    ]


def rounds(given: Given) -> list[Round]:
    """Return the rounds of a part."""
    return [Round(number, given.seconds) for number in range(given.rounds)]


def compared(case: Round) -> list[Turn]:
    """Run each loop once."""
    return in_turn(case, arms())


def searched(_number: int) -> dict[str, float]:
    """Search the highest rates once."""
    return highest_rates(arms())


# The same rows, whether compiled or not.


def both_rows(name: str) -> bool:
    """Whether a simulated wall gives the same rows and report to the last bit."""
    return Side().tell("rows", name) == compiled_side().tell("rows", name)


def row_lines(found: Found[str, bool]) -> list[str]:
    """A sentence."""
    other = [name for name, same in found if not same]
    compiled_count = len(compiled_side().tell("about", *MODULES)["compiled"])
    return [
        f"{compiled_count} of {len(MODULES)} modules compiled. {len(found) - len(other)} of"
        f" {len(found)} simulated walls of `scripts/study same_rows` give the same rows and report"
        f" to the last bit{': others are ' + ', '.join(other) if other else ''}.",
    ]


# The parts of a tick.


class Rung(NamedTuple):
    """One level of the loop."""

    level: Level
    p50: float
    """Work [µs]"""
    p99: float
    calls: dict[str, list[float]]
    """Calls a tick, and their median time [µs]; empty: not timed"""


def levels(case: Round) -> list[Rung]:
    """Run the loop at each level, in an order that goes on by one with each round."""
    first = case.number % len(Level)
    every = list(Level)
    with emulated_bus() as path:
        found = [
            rung(path, level, case.seconds, calls=False)
            for level in (*every[first:], *every[:first])
        ]
    return sorted(found)


def system_calls(case: Round) -> list[Rung]:
    """Time the system calls of the bare loop and of the tick."""
    with emulated_bus() as path:
        return [rung(path, level, case.seconds, calls=True) for level in (Level.BYTES, Level.TICK)]


def rung(path: str, level: Level, seconds: float, *, calls: bool) -> Rung:
    """Run the loop at one level."""
    core, _ = pick_cores()
    orders = {"path": path, "level": int(level), "seconds": seconds, "calls": calls}
    told = told_by("the loop", ["scripts.tick_steps"], orders, seconds, {core})
    return Rung(level, told["p50"], told["p99"], told["calls"])


def level_lines(found: Found[Round, list[Rung]]) -> list[str]:
    """A line for each level."""
    rows = []
    before: float | None = None
    base = _of(found, Level.BYTES, "p50"), _of(found, Level.BYTES, "p99")
    for level in Level:
        p50, p99 = _of(found, level, "p50"), _of(found, level, "p99")
        middle = statistics.median(p50)
        more = "" if before is None else f"{middle - before:+.1f}"
        rows.append(
            [
                NAMES[level],
                f"{middle:.1f}",
                more,
                ratios(p50, base[0]),
                f"{statistics.median(p99):.1f}",
                ratios(p99, base[1]),
            ]
        )
        before = middle
    head = ["the loop", "work p50, µs", "more", "over the first", "work p99, µs", "over the first"]
    return [*table(head, *rows), "", f"{len(found)} rounds of {found[0][0].seconds:g} s."]


def _of(found: Found[Round, list[Rung]], level: Level, figure: str) -> list[float]:
    return [getattr(each, figure) for _, row in found for each in row if each.level is level]


def call_lines(found: Found[Round, list[Rung]]) -> list[str]:
    """A line for each kind of call, in the bare loop and in the tick."""
    kinds = list(dict.fromkeys(kind for _, row in found for each in row for kind in each.calls))
    rows, sums = [], {Level.BYTES: 0.0, Level.TICK: 0.0}
    for kind in kinds:
        cells = [kind]
        for level in sums:
            each = [
                rung.calls.get(kind, [0.0, 0.0])
                for _, row in found
                for rung in row
                if rung.level is level
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
    """Return the interpreters on PATH that can import the program, by version and build."""
    found = {_described(Side()): Side()}
    own = f"python{sys.version_info[0]}.{sys.version_info[1]}"
    for folder in os.environ["PATH"].split(os.pathsep):
        for path in sorted(Path(folder).glob("python3.[0-9][0-9]")):
            packages = sysconfig.get_path("purelib") if path.name == own else ""
            side = Side(str(path), packages=packages)
            try:
                found.setdefault(_described(side), side)
            except (ServoError, OSError):
                continue
    return found


def _described(side: Side) -> str:
    about = side.tell("about")
    build = "with" if about["optimised"] else "without"
    return f"Python {about['version']}, built {build} optimisations"


def other_pythons(case: Round) -> list[Turn]:
    """Run the bare loop and the program once with each interpreter."""
    every = [
        Arm(f"{loop}, {name}", f"{BARE}, {name}", loop, side)
        for name, side in interpreters().items()
        for loop in (BARE, PLAIN)
    ]
    return in_turn(case, every)


STUDY = Study(
    "evidence/compiled-tick.md",
    (
        Part(
            "rows",
            lambda given: list(CASES)[:: max(1, len(CASES) // given.walls)][: given.walls],
            both_rows,
            row_lines,
            case_s=12.0,
            in_turn=True,
            wanted=lambda found: all(same for _, same in found),
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
        Part("levels", rounds, levels, level_lines, case_s=50.0, in_turn=True),
        Part("calls", rounds, system_calls, call_lines, case_s=15.0, in_turn=True),
        Part("interpreters", rounds, other_pythons, turn_lines, case_s=60.0, in_turn=True),
    ),
    (
        Option("rounds", 7, "rounds of each part", quick=2),
        Option("seconds", 4.0, "duration of each loop [s]", quick=2.0),
        Option("searches", 5, "searches of the highest rate", quick=1),
        Option("walls", 30, "simulated walls whose rows are compared", quick=3),
    ),
)
