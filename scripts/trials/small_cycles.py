"""Tries limit cycles of backlash, a few counts large: are they found, named, and made smaller?"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from haptic_wall.controller.detector.tuning import TUNING, Tuning
from scripts.study import Given
from scripts.trials.cases import LAGS, PRESETS, Case, Row, draw_damping, draw_row
from scripts.trials.draws import bench_of
from scripts.trials.own_walls import ANY_STIFFNESS
from scripts.trials.rates import few, most
from scripts.trials.run import WallAsked
from scripts.trials.sections import Job, Made, draws, in_parts, section, walls_of
from scripts.trials.verdicts import longest_unseen_s, small, sustains, time_above_s, unseen

BACKLASH = (math.radians(0.1), math.radians(0.5))
KICK = (0.02, 0.05)
_WATCHED_S, _ANSWERED_S = 8.0, 25.0
_SETTLED_S = 4.0
"""Time at the end in which a cycle must have stayed small [s]"""
_ROW = Row("backlash", backlash=True)
_A_JOB = 10


@dataclass(frozen=True, slots=True)
class SmallCycle:
    """A wall whose backlash sustains a motion above four counts while the detector reports."""

    case: Case
    below_s: float
    """End of its last half-cycle above four counts, with ``reduce`` [s]"""
    ended_s: float
    """End of that trial [s]"""
    unseen_s: float
    """Longest time for which it did not decay, and was called quiet or decaying [s]"""
    unseen: bool
    """It is unseen at the end of that trial"""
    named: bool
    """The report names backlash"""
    scale: float
    """Stiffness at the end over that at the start [1]"""
    trip: str | None

    @property
    def settled(self) -> bool:
        """Whether the cycle has become smaller than four counts, without a trip."""
        return self.trip is None and self.below_s < self.ended_s - _SETTLED_S


@dataclass(frozen=True, slots=True)
class SmallCycles:
    """Results of some walls of a servo."""

    preset: str
    walls: int
    found: list[SmallCycle]


def small_cycles(job: tuple[str, int, tuple[int, ...]]) -> SmallCycles:
    """Try some walls.

    Args:
        job: Preset of the servo, number of walls, and the seed.
    """
    preset, walls, seed = job
    random = draws(seed)
    found = []
    for _ in range(walls):
        case = draw_small_cycle(preset, random)
        if keeps_up(case):
            found.append(settled(case))
    return SmallCycles(preset, walls, found)


def draw_small_cycle(preset: str, random: np.random.Generator) -> Case:
    """Draw a servo with backlash and its wall."""
    row = draw_row(bench_of(preset), _ROW, LAGS[0], random)
    return Case(
        preset,
        replace(row, backlash=float(random.uniform(*BACKLASH))),
        WallAsked(ANY_STIFFNESS, draw_damping(preset, random), forced=False),
        duration_s=_WATCHED_S,
        position=float(random.uniform(*KICK)),
    )


def keeps_up(case: Case) -> bool:
    """Whether a motion above four counts sustains itself while the detector reports."""
    return sustains(case.run("report"), small())


def settled(case: Case, tuning: Tuning = TUNING) -> SmallCycle:
    """Run a case for longer with ``reduce`` and judge it."""
    case = replace(case, duration_s=_ANSWERED_S)
    trial = case.run(tuning=tuning)
    return SmallCycle(
        case=case,
        below_s=time_above_s(trial, small()),
        ended_s=trial.output.size * trial.period,
        unseen_s=longest_unseen_s(trial),
        unseen=unseen(trial),
        named=bool(trial.oscillation["backlash"]),
        scale=float(trial.stiffness[-1] / trial.stiffness[0]) if trial.stiffness[0] else math.nan,
        trip=trial.trip,
    )


def jobs(given: Given) -> list[Job]:
    """Return the jobs: both servos, in parts."""
    made = []
    for i, preset in enumerate(PRESETS):
        for part, walls in in_parts(walls_of(given, 4), _A_JOB):
            made.append((preset, walls, (given.seed, 5, i, part)))
    return made


def told(results: list[SmallCycles]) -> Made:
    """Return the section's text."""
    low, high = (math.degrees(width) for width in BACKLASH)
    lines = [
        f"The guard's own K, two-sided, backlash of {low:.1f} to {high:.1f} degrees between shaft"
        f" and encoder, lags within the bounds, let go at {KICK[0]} to {KICK[1]} rad. A wall counts"
        f" whose motion, with `report`, stays above four counts to the end of {_WATCHED_S:g} s."
        f" With `reduce`, {_ANSWERED_S:g} s. `not seen for`: the longest time for which the motion"
        " was above four counts, did not die, and was called quiet or decaying.",
        "",
        "| servo | walls | keep up above four counts | brought below four counts | time until then,"
        " median and largest | K left, median and least | backlash named | not seen for, median and"
        " largest | unseen at the end | trips |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    lines += [_line(p, [one for one in results if one.preset == p]) for p in PRESETS]
    wrong: list[tuple[str, object]] = [
        (
            f"settled {one.settled}, unseen at the end {one.unseen}, not seen for"
            f" {one.unseen_s:.1f} s, named {one.named}, trip {one.trip}",
            one.case,
        )
        for some in results
        for one in some.found
        if not one.settled or one.unseen or one.trip or not one.named
    ]
    return Made(lines, wrong)


def _line(preset: str, results: list[SmallCycles]) -> str:
    found = [one for some in results for one in some.found]
    n, tried = len(found), sum(one.walls for one in results)
    if not found:
        return f"| {preset} | {tried} | 0 | | | | | | | |"
    settled = [one for one in found if one.settled]
    until = scale = "none"
    if settled:
        until = _spread([one.below_s for one in settled])
        kept = [one.scale for one in settled]
        scale = f"{np.median(kept):.3f}, {min(kept):.3f}"
    return (
        f"| {preset} | {tried} | {n} | {most(len(settled), n)} | {until} | {scale} |"
        f" {most(sum(one.named for one in found), n)} |"
        f" {_spread([one.unseen_s for one in found])} |"
        f" {few(sum(one.unseen for one in found), n)} |"
        f" {sum(one.trip is not None for one in found)} |"
    )


def _spread(values: list[float]) -> str:
    return f"{np.median(values):.1f}, {max(values):.1f} s"


BACKLASH_CYCLES = section("backlash", jobs, small_cycles, told, case_s=3.0)
