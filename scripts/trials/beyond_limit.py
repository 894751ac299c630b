"""Tries walls at 1.2 to 2 times their true limit: does a true alarm end by reduction or a trip?"""

from __future__ import annotations

import math
from dataclasses import dataclass

from scripts.study import Given
from scripts.trials.cases import (
    LAGS,
    PRESETS,
    Case,
    Row,
    draw_damping,
    draw_kick,
    draw_row,
    log_uniform,
)
from scripts.trials.draws import bench_of, critical_of, damping_ceiling_of
from scripts.trials.rates import most
from scripts.trials.run import WallAsked
from scripts.trials.sections import Job, Made, draws, in_parts, section, walls_of
from scripts.trials.verdicts import Answered, answered, goes_on_by_itself

RATIOS = (1.2, 2.0)
_ANY = Row("any back-EMF", back_emf=None)
_A_JOB = 15


@dataclass(frozen=True, slots=True)
class Beyond:
    """Results of some walls with lags in a range."""

    preset: str
    lags: str
    walls: int
    found: list[Answered]
    """The walls that oscillate by themselves"""


def beyond(job: tuple[str, int, int, tuple[int, ...]]) -> Beyond:
    """Try some walls.

    Args:
        job: Preset of the servo, index in ``LAGS``, number of walls, and the seed.
    """
    preset, lags, walls, seed = job
    random, bench = draws(seed), bench_of(preset)
    found: list[Answered] = []
    tried = 0
    while tried < walls:
        truth = draw_row(bench, _ANY, LAGS[lags], random)
        damping = draw_damping(preset, random)
        ratio = log_uniform(RATIOS, random)
        kick = draw_kick(random)
        if damping > 0.9 * damping_ceiling_of(truth):
            continue
        tried += 1
        stiffness = ratio * critical_of(truth, damping)
        case = Case(preset, truth, WallAsked(stiffness, damping), position=kick)
        if goes_on_by_itself(case):
            found.append(answered(case))
    return Beyond(preset, LAGS[lags].name, walls, found)


def jobs(given: Given) -> list[Job]:
    """Return the jobs: both servos and all lags, in parts."""
    made = []
    for i, preset in enumerate(PRESETS):
        for lags in range(len(LAGS)):
            for part, walls in in_parts(walls_of(given, 2), _A_JOB):
                made.append((preset, lags, walls, (given.seed, 3, i, lags, part)))
    return made


def told(results: list[Beyond]) -> Made:
    """Return the section's text."""
    lines = [
        f"K forced at {RATIOS[0]} to {RATIOS[1]:g} times the true servo's own limit, two-sided,"
        " kicks of 0.02 to 0.5 rad, back-EMF drawn. Only walls that oscillate by themselves count:"
        " Coulomb friction holds many of the others.",
        "",
        "| servo | lag | walls | oscillate | alarms | of these end by reduction | by a trip | in"
        " time |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for preset in PRESETS:
        here = [one for one in results if one.preset == preset]
        lines += [
            _line(preset, lags.name, [one for one in here if one.lags == lags.name])
            for lags in LAGS
        ]
    lines.append(_line("both", "all", results))
    found = [one for some in results for one in some.found]
    wrong: list[tuple[str, object]] = [
        (f"trip {one.trip}, never {one.never}, late by {one.late_s:.2f} s", one.case)
        for one in found
        if one.trip or not one.in_time
    ]
    return Made(lines, wrong)


def _line(name: str, lags: str, results: list[Beyond]) -> str:
    found = [one for some in results for one in some.found]
    alarms = [one for one in found if not math.isnan(one.alarm_s)]
    reduced = sum(one.trip is None and not one.never for one in alarms)
    return (
        f"| {name} | {lags} | {sum(one.walls for one in results)} | {len(found)} |"
        f" {most(len(alarms), len(found))} | {most(reduced, len(alarms))} |"
        f" {sum(one.trip is not None for one in alarms)} |"
        f" {most(sum(one.in_time for one in found), len(found))} |"
    )


LIMIT = section("limit", jobs, beyond, told, case_s=4.0)
