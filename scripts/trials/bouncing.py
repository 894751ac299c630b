"""Tries one-sided walls under a steady push that return the shaft faster than it came."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

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
from scripts.trials.draws import Bench, bench_of, critical_of
from scripts.trials.own_walls import ANY_STIFFNESS
from scripts.trials.rates import few, most
from scripts.trials.run import WallAsked
from scripts.trials.sections import Job, Made, draws, in_parts, section, walls_of
from scripts.trials.truth import Truth
from scripts.trials.verdicts import Answered, answered, goes_on_by_itself

WALLS_TRIED = ("the guard's K", "1.2 to 3 times the limit")
_FORCED = (1.2, 3.0)
"""Stiffness range, as a multiple of the two-sided limit"""
_ANY = Row("any back-EMF", back_emf=None)
_PUSH = (1.3, 6.0)
"""Push range, as a multiple of Coulomb friction: less would not return the shaft to the wall"""
_MOST_PUSH = 0.3
"""Largest push, as a fraction of the torque limit"""
_A_JOB = 15


@dataclass(frozen=True, slots=True)
class Bounces:
    """Results of some walls of a kind with lags in a range."""

    preset: str
    wall: str
    lags: str
    walls: int
    found: list[Answered]
    """The walls on which the shaft keeps bouncing while the detector only reports"""


def draw_bounces(preset: str, kind: int, lags: int, random: np.random.Generator) -> Case:
    """Draw a wall and the push against it, see ``bounces``."""
    bench = bench_of(preset)
    truth = draw_row(bench, _ANY, LAGS[lags], random)
    damping = draw_damping(preset, random)
    wall = WallAsked(ANY_STIFFNESS, damping, "above", forced=False)
    if kind:
        ratio = log_uniform(_FORCED, random)
        limit = max(critical_of(truth, damping), 0.1 * bench.torque_limit)
        wall = WallAsked(ratio * limit, damping, "above")
    push = _push(bench, truth, random)
    return Case(preset, truth, wall, position=-draw_kick(random), push=push)


def bounces(job: tuple[str, int, int, int, tuple[int, ...]]) -> Bounces:
    """Try some walls.

    Args:
        job: Preset of the servo, indices in ``WALLS_TRIED`` and ``LAGS``, number of walls, and
            the seed.
    """
    preset, kind, lags, walls, seed = job
    random = draws(seed)
    found = []
    for _ in range(walls):
        case = draw_bounces(preset, kind, lags, random)
        if goes_on_by_itself(case):
            found.append(answered(case))
    return Bounces(preset, WALLS_TRIED[kind], LAGS[lags].name, walls, found)


def _push(bench: Bench, truth: Truth, random: np.random.Generator) -> float:
    """Draw the steady push [N·m]."""
    least = _PUSH[0] * truth.coulomb
    highest = max(min(_PUSH[1] * truth.coulomb, _MOST_PUSH * bench.torque_limit), 1.01 * least)
    return float(random.uniform(least, highest))


def jobs(given: Given) -> list[Job]:
    """Return the jobs: both servos, both kinds of walls, all lags, in parts."""
    made = []
    for i, preset in enumerate(PRESETS):
        for kind in range(len(WALLS_TRIED)):
            for lags in range(len(LAGS)):
                for part, walls in in_parts(walls_of(given, 1), _A_JOB):
                    seed = (given.seed, 4, i, kind, lags, part)
                    made.append((preset, kind, lags, walls, seed))
    return made


def told(results: list[Bounces]) -> Made:
    """Return the section's text."""
    lines = [
        "The shaft starts 0.02 to 0.5 rad outside and is pushed against the wall steadily, by 1.3"
        f" to 6 times its Coulomb friction, at most {_MOST_PUSH} of the torque limit. It goes on"
        " bouncing if, with `report`, its half-cycles stay above 1 degree or 10 counts to the end"
        " of 8 s. Lag by its believed upper bound.",
        "",
        "| servo | wall | lag | walls | goes on bouncing | with `reduce` decays or ends in time |"
        " never | trips | of these by the backstop | the others: energy | unseen |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for preset in PRESETS:
        for wall in WALLS_TRIED:
            here = [one for one in results if one.preset == preset and one.wall == wall]
            lines += [
                _line(preset, wall, lags.name, [one for one in here if one.lags == lags.name])
                for lags in LAGS
            ]
    lines.append(_line("both", "both", "all", results))
    found = [one for some in results for one in some.found]
    wrong: list[tuple[str, object]] = [
        (f"never {one.never}, late by {one.late_s:.2f} s, unseen {one.unseen}", one.case)
        for one in found
        if not one.in_time or one.unseen
    ]
    return Made(lines, wrong)


def _line(preset: str, wall: str, lags: str, results: list[Bounces]) -> str:
    found = [one for some in results for one in some.found]
    n = len(found)
    trips = [one for one in found if one.trip]
    backstop = sum(one.gave_up for one in trips)
    return (
        f"| {preset} | {wall} | {lags} | {sum(one.walls for one in results)} | {n} |"
        f" {most(sum(one.in_time for one in found), n)} | {sum(one.never for one in found)} |"
        f" {len(trips)} | {backstop} | {len(trips) - backstop} |"
        f" {few(sum(one.unseen for one in found), n)} |"
    )


BOUNCES = section("bounces", jobs, bounces, told, case_s=4.0)
