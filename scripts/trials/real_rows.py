"""Tries walls and operators on servos with every effect of a real one."""

from __future__ import annotations

import numpy as np

from haptic_wall.controller.laws.wall import Side
from scripts.study import Given
from scripts.trials.cases import LAGS, PRESETS, Case, draw_damping, draw_kick, hand_case
from scripts.trials.draws import bench_of, critical_of, damping_ceiling_of, draw_real
from scripts.trials.hand_hours import OF_THE_LIMIT, HandTrial, hand_lines, judged, needless
from scripts.trials.hands import HANDS
from scripts.trials.own_walls import ANY_STIFFNESS, WALL_HEAD, Cell, late_or_unseen, wall_line
from scripts.trials.run import WallAsked
from scripts.trials.sections import Job, Made, draws, in_parts, section, walls_of
from scripts.trials.verdicts import answered, goes_on_by_itself

_A_JOB = 5
_HAND_S = 60.0
"""Longest trial with an operator [s]"""
_LESS = 0.2
"""Hours of an operator, relative to those of the other servos, because these cost more"""
_ONE_SIDED = 0.4
"""Probability of a wall that never pulls"""
Result = Cell | list[HandTrial]


def draw_real_wall(preset: str, lags: int, random: np.random.Generator) -> Case:
    """Draw a servo with lags in a range of ``LAGS``, and the wall that the guard commands."""
    lag = LAGS[lags]
    return Case(
        preset,
        draw_real(bench_of(preset), random, (lag.low, lag.high)),
        WallAsked(ANY_STIFFNESS, draw_damping(preset, random), forced=False),
        position=draw_kick(random),
    )


def draw_real_hand(preset: str, operator: str, trial_s: float, random: np.random.Generator) -> Case:
    """Draw a servo within the belief, a wall at nine tenths of its limit, and an operator."""
    while True:
        truth = draw_real(bench_of(preset), random)
        damping = draw_damping(preset, random)
        side: Side = "above" if random.random() < _ONE_SIDED else "both"
        seed = int(random.integers(1 << 31))
        if damping > 0.9 * damping_ceiling_of(truth):
            continue
        stiffness = OF_THE_LIMIT * critical_of(truth, damping)
        return hand_case(
            preset, truth, WallAsked(stiffness, damping, side), operator, seed, trial_s
        )


def tried(job: Job) -> Result:
    """Try some walls by themselves (operator ``none``), or with an operator.

    Args:
        job: Preset, operator, index in ``LAGS``, number of trials, length of each [s], seed.
    """
    preset, operator, lags, trials, trial_s, seed = job
    random = draws(seed)
    if operator != "none":
        return [judged(draw_real_hand(preset, operator, trial_s, random)) for _ in range(trials)]
    cases = [draw_real_wall(preset, lags, random) for _ in range(trials)]
    found = [answered(case) for case in cases if goes_on_by_itself(case)]
    return Cell(preset, "every effect", LAGS[lags].name, trials, found)


def jobs(given: Given) -> list[Job]:
    """Return the jobs: walls with lags in each range, and all operators but the harder ones."""
    made: list[Job] = []
    trial_s = min(_HAND_S, 3600.0 * given.hours)
    for i, preset in enumerate(PRESETS):
        for lags in range(len(LAGS)):
            for part, walls in in_parts(walls_of(given, lags + 1), _A_JOB):
                seed = (given.seed, 7, i, lags, part)
                made.append((preset, "none", lags, walls, 8.0, seed))
        for j, operator in enumerate(HANDS):
            for part in range(max(1, round(_LESS * given.hours * 3600.0 / trial_s))):
                made.append((preset, operator, 0, 1, trial_s, (given.seed, 8, i, j, part)))
    return made


def told(results: list[Result]) -> Made:
    """Return the section's text."""
    cells = [one for one in results if isinstance(one, Cell)]
    trials = [one for some in results if not isinstance(some, Cell) for one in some]
    lines = [
        "The program's own plant moves these servos. It has every effect, with sizes drawn from"
        " those of real servos: Stribeck friction, different viscous friction each way, load"
        " friction in motion and at rest, a weight, cogging, ripple, backlash, an eccentric and"
        " noisy encoder, a current loop with a period, back-EMF with droop, a dead band. The rest"
        " is as above; walls first, then operators.",
        "",
        *WALL_HEAD,
    ]
    for preset in PRESETS:
        here = [one for one in cells if one.preset == preset]
        lines += [
            wall_line(preset, lags.name, [c for c in here if c.lags == lags.name]) for lags in LAGS
        ]
    lines.append(wall_line("both", "all", cells))
    wrong = late_or_unseen(cells)
    lines += hand_lines(trials)
    return Made(lines, wrong + needless(trials))


REAL = section("real", jobs, tried, told, case_s=12.0)
