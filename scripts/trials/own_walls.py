"""Tries walls that the guard allows on servos within the belief: oscillations and reactions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scripts.study import Given
from scripts.trials.cases import LAGS, PRESETS, ROWS, Case, draw_damping, draw_kick, draw_row
from scripts.trials.draws import bench_of
from scripts.trials.rates import few, most
from scripts.trials.run import WallAsked
from scripts.trials.sections import Job, Made, draws, in_parts, section, walls_of
from scripts.trials.verdicts import Answered, answered, goes_on_by_itself

ANY_STIFFNESS = 1e6
"""A request above every limit, so that the guard commands its own limit [N·m/rad]"""
_A_JOB = 15
WORSE = 1.5
"""Growth after the alarm that the reaction's table counts [1]"""


@dataclass(frozen=True, slots=True)
class Cell:
    """Results of some walls of a row with lags in a range."""

    preset: str
    row: str
    lags: str
    walls: int
    found: list[Answered]
    """The walls that oscillate by themselves"""


def draw_wall(preset: str, row: int, lags: int, random: np.random.Generator) -> Case:
    """Draw a wall of a cell, see ``cell``."""
    return Case(
        preset,
        draw_row(bench_of(preset), ROWS[row], LAGS[lags], random),
        WallAsked(ANY_STIFFNESS, draw_damping(preset, random), forced=False),
        position=draw_kick(random),
    )


def cell(job: tuple[str, int, int, int, tuple[int, ...]]) -> Cell:
    """Try some walls.

    Args:
        job: Preset of the servo, indices in ``ROWS`` and ``LAGS``, number of walls, and the seed.
    """
    preset, row, lags, walls, seed = job
    random = draws(seed)
    found = []
    for _ in range(walls):
        case = draw_wall(preset, row, lags, random)
        if goes_on_by_itself(case):
            found.append(answered(case))
    return Cell(preset, ROWS[row].name, LAGS[lags].name, walls, found)


def jobs(given: Given, number: int) -> list[Job]:
    """Return the jobs: all cells, in parts.

    Args:
        given: The options.
        number: Number of the section, for its seeds.
    """
    made = []
    for i, preset in enumerate(PRESETS):
        for row in range(len(ROWS)):
            for lags in range(len(LAGS)) if given.walls else (len(LAGS) - 1,):
                for part, walls in in_parts(walls_of(given, lags + 1), _A_JOB):
                    seed = (given.seed, number, i, row, lags, part)
                    made.append((preset, row, lags, walls, seed))
    return made


def told(cells: list[Cell]) -> Made:
    """Return the section of the detector's page."""
    lines = [
        "Two-sided walls with the guard's own K, released at 0.02 to 0.5 rad. *Lag*: within the"
        " believed bounds, or a multiple of the upper one; other believed values hold the truth. A"
        " wall oscillates by itself if, with `report`, its half-cycles stay above 1 degree or 10"
        " counts to the end of 8 s. The deadline is six cycles of the slowest frequency that K"
        " allows, at most 5 s, from where the motion no longer decays. `unseen`: at the end, with"
        " `reduce`, the motion sustains itself above four counts and is called quiet or decaying."
        " The trip by speed is off; walls that are late are tried again with it.",
    ]
    for preset in PRESETS:
        here = [one for one in cells if one.preset == preset]
        lines += ["", f"**{preset}**", "", *WALL_HEAD]
        for name in [row.name for row in ROWS]:
            lines += [
                wall_line(
                    name, lags.name, [c for c in here if c.row == name and c.lags == lags.name]
                )
                for lags in LAGS
            ]
        lines += [
            wall_line("all rows", lags.name, [c for c in here if c.lags == lags.name])
            for lags in LAGS
        ]
        lines.append(wall_line("all rows", "all", here))
    return Made(lines, late_or_unseen(cells))


WALL_HEAD = [
    "| servo | lag | walls | oscillate | with `reduce` decays or ends in time | late, by at"
    " most | of these, with the trip by speed | never | of all, a trip | unseen |",
    "|---|---|---|---|---|---|---|---|---|---|",
]


def late_or_unseen(cells: list[Cell]) -> list[tuple[str, object]]:
    """Return the failures, each with its case."""
    return late_or_unseen_of([one for some in cells for one in some.found])


def late_or_unseen_of(found: list[Answered]) -> list[tuple[str, object]]:
    """Return the failures among some walls, each with its case."""
    return [(_what(one), one.case) for one in found if not one.in_time or one.unseen]


def wall_line(name: str, lags: str, cells: list[Cell]) -> str:
    """Return the row of a table with ``WALL_HEAD``."""
    found = [one for some in cells for one in some.found]
    n = len(found)
    late = [one.late_s for one in found if not one.in_time and not one.never]
    late_text = f"{len(late)}: {max(late):.2f} s" if late else "0"
    return (
        f"| {name} | {lags} | {sum(one.walls for one in cells)} | {n} |"
        f" {most(sum(one.in_time for one in found), n)} | {late_text} |"
        f" {sum(one.late_at_any_speed for one in found)} |"
        f" {sum(one.never for one in found)} |"
        f" {sum(one.trip is not None for one in found)} |"
        f" {few(sum(one.unseen for one in found), n)} |"
    )


def _what(one: Answered) -> str:
    if one.never:
        return "never decays" + (", unseen" if one.unseen else "")
    if not one.in_time:
        return f"late by {one.late_s:.2f} s" + (", unseen" if one.unseen else "")
    return "unseen"


def reaction_told(cells: list[Cell]) -> Made:
    """Return the section of the reaction's page."""
    lines = [
        "The same kinds of servos as in the [detector's table](detector-table.md), other draws."
        " Amplitude: the largest distance from the wall's surface. Growth: the largest after the"
        " alarm by the largest until then.",
    ]
    for preset in PRESETS:
        here = [one for one in cells if one.preset == preset]
        lines += [
            "",
            f"**{preset}**",
            "",
            "| servo | lag | oscillate | alarms | amplitude at the alarm, median and largest |"
            f" growth, median and largest | at most {WORSE} times | ended by a trip |",
            "|---|---|---|---|---|---|---|---|",
        ]
        for name in [row.name for row in ROWS]:
            lines += [
                _growth_line(
                    name, lags.name, [c for c in here if c.row == name and c.lags == lags.name]
                )
                for lags in LAGS
            ]
        lines.append(_growth_line("all rows", "all", here))
    return Made(lines, grown([one for some in cells for one in some.found]))


def grown(found: list[Answered]) -> list[tuple[str, object]]:
    """Return the motions that grew too much after their alarm, each with its case."""
    return [
        (f"grows {one.after / one.at_alarm:.2f} times after the alarm", one.case)
        for one in found
        if one.after > WORSE * one.at_alarm
    ]


def growth_cells(found: list[Answered]) -> str:
    """Return cells of a table: oscillations, alarms, amplitude at the alarm, growth after it."""
    alarms = [one for one in found if one.alarm_s == one.alarm_s]
    spread = growth = "none"
    if alarms:
        size = [one.at_alarm for one in alarms]
        ratio = [one.after / one.at_alarm for one in alarms]
        spread = f"{np.median(size):.2f}, {max(size):.2f} rad"
        growth = f"{np.median(ratio):.2f}, {max(ratio):.2f}"
    held = sum(one.after <= WORSE * one.at_alarm for one in alarms)
    return (
        f"{len(found)} | {most(len(alarms), len(found))} | {spread} | {growth}"
        f" | {most(held, len(alarms))}"
    )


def _growth_line(name: str, lags: str, cells: list[Cell]) -> str:
    found = [one for some in cells for one in some.found]
    trips = sum(one.trip is not None for one in found)
    return f"| {name} | {lags} | {growth_cells(found)} | {trips} |"


WALLS = section("walls", lambda given: jobs(given, 1), cell, told, case_s=4.0)
GROWTH = section("growth", lambda given: jobs(given, 11), cell, reaction_told, case_s=4.0)
