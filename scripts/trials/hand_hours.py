"""Tries hours of operators on walls at nine tenths of their limit: the detector's false alarms."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from scripts.study import Given
from scripts.trials.cases import PRESETS, Case, draw_damping, hand_case
from scripts.trials.draws import bench_of, critical_of, damping_ceiling_of, draw_truth
from scripts.trials.hands import HANDS
from scripts.trials.operators import HARDER, Operator, operator_of
from scripts.trials.rates import hourly
from scripts.trials.run import Trial, WallAsked
from scripts.trials.sections import Job, Made, draws, in_parts, section
from scripts.trials.verdicts import small, sustains

OF_THE_LIMIT = 0.9
_ONE_SIDED = 0.4
"""Probability of a wall that never pulls"""
_HARDER_PART = 0.1
"""Hours of a harder operator, relative to the others"""
_A_JOB_S = 300.0
_TRIAL_S = 60.0
"""Longest trial [s]"""
_GOES_ON_S = 8.0
"""Time for which a motion is watched without the operator [s]"""
_BEFORE_S = 1.0
"""Time before an alarm over which the operator's mean push is taken [s]"""


@dataclass(frozen=True, slots=True)
class HandTrial:
    """The result of an operator on a wall."""

    case: Case
    seconds: float
    probes: int
    hands: int
    """Probes that found an operator"""
    softened: int
    """Alarms of the backstop"""
    returned: int
    """Of these, taken back"""
    believed: bool
    """The detector that uses the believed servo raised an alarm that a probe took back"""
    trip: str | None
    goes_on: bool
    """After the first alarm the motion persists without the operator: the wall makes it"""


def hand_trials(job: tuple[str, str, int, float, tuple[int, ...]]) -> list[HandTrial]:
    """Try some walls.

    Args:
        job: Preset of the servo, one of ``OPERATORS``, number of trials, length of each [s], and
            the seed.
    """
    preset, operator, trials, trial_s, seed = job
    random = draws(seed)
    return [judged(draw_held(preset, operator, trial_s, random)) for _ in range(trials)]


def draw_held(preset: str, operator: str, trial_s: float, random: np.random.Generator) -> Case:
    """Draw a wall and the operator that holds its shaft, see ``hand_trials``."""
    bench = bench_of(preset)
    while True:
        truth = draw_truth(bench, random, lag_factor=1.0, back_emf=None)
        damping = draw_damping(preset, random)
        one_sided = random.random() < _ONE_SIDED
        hand_seed = int(random.integers(1 << 31))
        if damping > 0.9 * damping_ceiling_of(truth):
            continue
        stiffness = OF_THE_LIMIT * critical_of(truth, damping)
        wall = WallAsked(stiffness, damping, "above" if one_sided else "both")
        return hand_case(preset, truth, wall, operator, hand_seed, trial_s)


def judged(case: Case) -> HandTrial:
    """Run a case with ``reduce`` and judge it."""
    trial = case.run()
    probes, moved, softened, returned = trial.counts
    return HandTrial(
        case=case,
        seconds=trial.output.size * trial.period,
        probes=probes,
        hands=moved - returned,
        softened=softened,
        returned=returned,
        believed=trial.taken_back > 0,
        trip=trial.trip,
        goes_on=not math.isnan(trial.first_alarm_s) and _goes_on(case, trial),
    )


def _goes_on(case: Case, trial: Trial) -> bool:
    """Whether the motion at the first alarm sustains itself without the operator's work.

    From then on the operator lets go, holds still, or pushes with its mean torque.
    """
    at = round(trial.first_alarm_s * 1e3)
    before = case.moved_by()
    since = max(0, round(trial.first_alarm_s / trial.period) - round(_BEFORE_S / trial.period))
    push = -case.truth.torque_gain * float(np.mean(trial.torque[since : since + 1000]))
    spring, damper, wanted, _, _ = before.rows[min(at, len(before.rows) - 1)]
    rest = np.zeros(round(_GOES_ON_S * 1e3))
    watched = replace(case, duration_s=trial.first_alarm_s + _GOES_ON_S)
    for after in (
        operator_of(0.0, 0.0, rest),
        operator_of(spring, damper, rest + wanted),
        operator_of(0.0, 0.0, rest, push=push),
    ):
        rows = [*before.rows[:at], *after.rows]
        if sustains(watched.run("report", Operator(rows, before.mass)), small()):
            return True
    return False


def jobs(given: Given) -> list[Job]:
    """Return the jobs: all operators, in parts."""
    made: list[Job] = []
    trial_s = min(_TRIAL_S, 3600.0 * given.hours)
    for i, preset in enumerate(PRESETS):
        for j, operator in enumerate((*HANDS, *HARDER)):
            hours = given.hours * (_HARDER_PART if operator in HARDER else 1.0)
            trials = max(1, round(hours * 3600.0 / trial_s))
            a_job = max(1, round(_A_JOB_S / trial_s))
            for part, count in in_parts(trials, a_job):
                seed = (given.seed, 2, i, j, part)
                made.append((preset, operator, count, trial_s, seed))
    return made


def told(results: list[list[HandTrial]]) -> Made:
    """Return the section's text."""
    trials = [one for some in results for one in some]
    lines = [
        f"K at {OF_THE_LIMIT} of the true servo's own limit, 40 % of the walls one-sided; truths"
        " and lags within the believed bounds, back-EMF drawn. `softened`: alarms of the backstop,"
        " which make the wall softer. `suspected`: trials in which the believed values"
        " raised an alarm that a probe found to be a hand's motion: the wall was probed, no"
        " more. `goes on`: trials in which the motion at the first"
        " alarm goes on when the hand lets go, holds still, or pushes on steadily: such an alarm is"
        " true, and the rates of needless ones leave these trials out. Rates have one-sided bounds"
        " of 95 %.",
    ]
    return Made([*lines, *hand_lines(trials, HARDER)], needless(trials))


def hand_lines(trials: list[HandTrial], harder: Sequence[str] = ()) -> list[str]:
    """Return the tables of both servos, and what is said of them together."""
    lines = []
    for preset in PRESETS:
        here = [one for one in trials if one.case.preset == preset]
        lines += [
            "",
            f"**{preset}**",
            "",
            "| operator | hours | probes | found a hand | needlessly softened | taken back |"
            " needlessly suspected | goes on | trips |",
            "|---|---|---|---|---|---|---|---|---|",
            *(_line(name, [t for t in here if t.case.operator == name]) for name in HANDS),
            _line("**these together**", [t for t in here if t.case.operator in HANDS]),
            *(
                _line(f"{name} (harder)", [t for t in here if t.case.operator == name])
                for name in harder
            ),
        ]
    others = ", the operators that are not the harder ones" if harder else ""
    return [
        *lines,
        "",
        f"Both servos{others}: {_sentence([t for t in trials if t.case.operator in HANDS])}",
    ]


def needless(trials: list[HandTrial]) -> list[tuple[str, object]]:
    """Return the interventions on walls that were not at fault, each with its case."""
    return [
        (
            f"softened {one.softened}, taken back {one.returned}, suspected {one.believed},"
            f" trip {one.trip}, goes on {one.goes_on}",
            one.case,
        )
        for one in trials
        if one.trip or (one.softened and not one.goes_on)
    ]


def intervention_cells(trials: list[HandTrial]) -> str:
    """Return cells of a table: softened, taken back, suspected, going on, trips."""
    hours = sum(one.seconds for one in trials) / 3600.0
    innocent = [one for one in trials if not one.goes_on]
    return (
        f"{hourly(sum(one.softened for one in innocent), hours)} |"
        f" {sum(one.returned for one in innocent)} |"
        f" {hourly(sum(one.believed for one in innocent), hours)} |"
        f" {sum(one.goes_on for one in trials)} |"
        f" {hourly(sum(one.trip is not None for one in trials), hours)}"
    )


def _line(name: str, trials: list[HandTrial]) -> str:
    hours = sum(one.seconds for one in trials) / 3600.0
    probes = sum(one.probes for one in trials)
    return (
        f"| {name} | {hours:.2f} | {probes / hours if hours else 0.0:.1f}/h |"
        f" {sum(one.hands for one in trials)} | {intervention_cells(trials)} |"
    )


def _sentence(trials: list[HandTrial]) -> str:
    hours = sum(one.seconds for one in trials) / 3600.0
    innocent = [one for one in trials if not one.goes_on]
    return (
        f"{hours:.1f} hours; trips {hourly(sum(t.trip is not None for t in trials), hours)};"
        f" needlessly softened {hourly(sum(t.softened for t in innocent), hours)}, of these taken"
        f" back {sum(t.returned for t in innocent)}; needlessly suspected"
        f" {hourly(sum(t.believed for t in innocent), hours)}."
    )


HOURS = section("hands", jobs, hand_trials, told, case_s=6.0)
