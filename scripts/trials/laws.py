"""Tries laws other than a wall: hands that move them, and oscillations beyond the limit."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from scripts.study import Given
from scripts.trials.cases import PRESETS, Case, draw_damping, draw_kick, hand_case, log_uniform
from scripts.trials.draws import bench_of, critical_of, damping_ceiling_of, draw_truth
from scripts.trials.hand_hours import OF_THE_LIMIT, HandTrial, intervention_cells, judged, needless
from scripts.trials.operators import TURN
from scripts.trials.own_walls import WORSE, grown, growth_cells, late_or_unseen_of
from scripts.trials.rates import few, most
from scripts.trials.run import WallAsked
from scripts.trials.sections import Job, Made, draws, in_parts, section, walls_of
from scripts.trials.truth import Truth
from scripts.trials.verdicts import Answered, answered, goes_on_by_itself

LAWS = ("stops", "spring", "damper", "detents", "friction", "texture", "profile", "sum", "own")
HANDS = ("voluntary", "lean", TURN)
BEYOND = (1.2, 20.0)
"""Stiffness, or damping of a damper, as a multiple of the true servo's own limit"""
SPEEDS = (0.5, 10.0)
"""Initial speed beyond the limit [rad/s]: friction and a damper do not move a shaft at rest"""
_FEWER = 10.0
"""By what there are fewer hours of a hand on each law than on walls"""
_TRIAL_S = 45.0
_A_JOB = 5
_TRIES = 8
"""Walls drawn for each that oscillates, at most"""


class Dip:
    """A law of a user: a dip that the shaft falls into; it is free beside it."""

    def __init__(self, width: float = 0.2) -> None:
        self.low, self.high = -width, width
        self._width = width

    def torque(self, position: float) -> float:
        """Return its torque [N·m] at a position [rad]."""
        return -0.1 * math.sin(math.pi * position / self._width)


def draw_law(law: str, random: np.random.Generator) -> tuple[str, ...]:
    """Draw the numbers of a law; return it as changes of a configuration."""
    width = float(random.uniform(0.03, 0.3))
    high = float(random.uniform(0.02, 0.5))
    slopes = random.uniform(-1.0, 1.0, 4)
    places = np.sort(random.uniform(-0.6, 0.6, 3)).tolist()
    torques = np.concatenate([[1.0], slopes[:3], [-1.0]]).tolist()
    points = [list(each) for each in zip([-0.8, *places, 0.8], torques, strict=True)]
    count = int(random.integers(6, 48))
    snap = float(random.uniform(0.1, 0.45))
    numbers: dict[str, tuple[str, ...]] = {
        "stops": (f"wall.low={-high!r}", f"wall.high={high!r}"),
        "detents": (f"wall.count={count}", f"wall.snap={snap!r}"),
        "friction": (f"wall.friction={float(random.uniform(0.02, 0.3))!r}",),
        "texture": (f"wall.period={width!r}",),
        "profile": (f"wall.profile={points!r}",),
        "sum": (
            f"wall.parts=[{{law: detents, count: {count}, snap: {snap!r}}},"
            f" {{law: stops, low: {-high!r}, high: {high!r}, share: 3}}]",
        ),
        "own": (f"wall.options={{width: {width!r}}}",),
    }
    name = f"{__name__}:Dip" if law == "own" else law
    return (f"wall.law={name}", *numbers.get(law, ()))


@dataclass(frozen=True, slots=True)
class LawTried:
    """Results of a law on a servo."""

    preset: str
    law: str
    hands: list[HandTrial]
    drawn: int
    """Walls drawn beyond the limit"""
    found: list[Answered]
    """Those that oscillate by themselves"""


def _drawn(preset: str, random: np.random.Generator) -> tuple[Truth, float]:
    """Draw a servo within the belief, and a virtual damping below nine tenths of its ceiling."""
    while True:
        truth = draw_truth(bench_of(preset), random, lag_factor=1.0, back_emf=None)
        damping = draw_damping(preset, random)
        if damping <= OF_THE_LIMIT * damping_ceiling_of(truth):
            return truth, damping


def draw_hand(preset: str, law: str, hand: str, random: np.random.Generator) -> Case:
    """Draw a law at nine tenths of the servo's own limit, and the hand that moves its shaft."""
    truth, damping = _drawn(preset, random)
    wall = WallAsked(OF_THE_LIMIT * critical_of(truth, damping), damping)
    seed = int(random.integers(1 << 31))
    case = hand_case(preset, truth, wall, hand, seed, _TRIAL_S)
    return replace(case, law=draw_law(law, random))


def draw_beyond(preset: str, law: str, random: np.random.Generator) -> Case:
    """Draw a law beyond the servo's own limit, let go away from its rest."""
    truth, damping = _drawn(preset, random)
    ratio = log_uniform(BEYOND, random)
    stiffness = critical_of(truth, damping)
    if law == "damper":
        damping = ratio * damping_ceiling_of(truth)
    else:
        stiffness *= ratio
    wall, kick = WallAsked(stiffness, damping), draw_kick(random)
    speed = log_uniform(SPEEDS, random)
    return Case(preset, truth, wall, position=kick, velocity=speed, law=draw_law(law, random))


def law_hands(job: tuple[str, str, str, int, tuple[int, ...]]) -> LawTried:
    """Try hands on a law.

    Args:
        job: Preset of the servo, law, hand, number of trials, and the seed.
    """
    preset, law, hand, count, seed = job
    random = draws(seed)
    trials = [judged(draw_hand(preset, law, hand, random)) for _ in range(count)]
    return LawTried(preset, law, trials, 0, [])


def law_beyond(job: tuple[str, str, str, int, tuple[int, ...]]) -> LawTried:
    """Try a law beyond its limit.

    Args:
        job: Preset of the servo, law, an empty text, wanted number of walls that oscillate, and
            the seed.
    """
    preset, law, _, count, seed = job
    random = draws(seed)
    found: list[Answered] = []
    drawn = 0
    while len(found) < count and drawn < _TRIES * count:
        drawn += 1
        case = draw_beyond(preset, law, random)
        if goes_on_by_itself(case):
            found.append(answered(case))
    return LawTried(preset, law, [], drawn, found)


def tried(job: tuple[str, str, str, int, tuple[int, ...]]) -> LawTried:
    """Do a job: hands where one is named, else walls beyond the limit."""
    return law_hands(job) if job[2] else law_beyond(job)


def _beyond_jobs(given: Given, number: int) -> list[Job]:
    made: list[Job] = []
    for i, preset in enumerate(PRESETS):
        for j, law in enumerate(LAWS):
            for part, count in in_parts(walls_of(given, 1), _A_JOB):
                made.append((preset, law, "", count, (given.seed, number, i, j, part)))
    return made


def jobs(given: Given) -> list[Job]:
    """Return the jobs of the detector's page."""
    made: list[Job] = []
    trials = max(1, round(given.hours / _FEWER * 3600.0 / _TRIAL_S))
    for i, preset in enumerate(PRESETS):
        for j, law in enumerate(LAWS):
            for k, hand in enumerate(HANDS):
                for part, count in in_parts(trials, _A_JOB):
                    made.append((preset, law, hand, count, (given.seed, 21, i, j, k, part)))
    return [*made, *_beyond_jobs(given, 22)]


def told(results: list[LawTried]) -> Made:
    """Return the section of the detector's page."""
    trials = [one for some in results for one in some.hands]
    lines = [
        f"Both servos, truths and lags within the belief. Hands that push (`voluntary`), lean and"
        f" turn the shaft, on laws at {OF_THE_LIMIT} of the true servo's own two-sided limit; the"
        " words are those of the tables above.",
        "",
        "| law | hours | probes | needlessly softened | taken back | needlessly suspected |"
        " goes on | trips |",
        "|---|---|---|---|---|---|---|---|",
        *(_hand_line(law, [t for s in results if s.law == law for t in s.hands]) for law in LAWS),
        _hand_line("all", trials),
        "",
        f"Laws at {BEYOND[0]} to {BEYOND[1]:g} times that limit (a damper: its damping), let go at"
        f" 0.02 to 0.5 rad with {SPEEDS[0]} to {SPEEDS[1]:g} rad/s. As many were"
        " drawn as gave the wanted number that oscillates by itself,"
        f" or {_TRIES} times as many. The deadline is that of a spring of the same K.",
        "",
        "| law | drawn | oscillate | in time | late, by at most | never | of all, a trip |"
        " unseen |",
        "|---|---|---|---|---|---|---|---|",
        *(_wall_line(law, [s for s in results if s.law == law]) for law in LAWS),
        _wall_line("all", results),
    ]
    found = [one for some in results for one in some.found]
    return Made(lines, [*needless(trials), *late_or_unseen_of(found)])


def _hand_line(name: str, trials: list[HandTrial]) -> str:
    hours = sum(one.seconds for one in trials) / 3600.0
    probes = sum(one.probes for one in trials)
    return (
        f"| {name} | {hours:.2f} | {probes / hours if hours else 0.0:.0f}/h |"
        f" {intervention_cells(trials)} |"
    )


def _wall_line(name: str, results: list[LawTried]) -> str:
    found = [one for some in results for one in some.found]
    n = len(found)
    late = [one.late_s for one in found if not one.in_time and not one.never]
    return (
        f"| {name} | {sum(some.drawn for some in results)} | {n} |"
        f" {most(sum(one.in_time for one in found), n)} |"
        f" {f'{len(late)}: {max(late):.2f} s' if late else '0'} |"
        f" {sum(one.never for one in found)} | {sum(one.trip is not None for one in found)} |"
        f" {few(sum(one.unseen for one in found), n)} |"
    )


def reaction_told(results: list[LawTried]) -> Made:
    """Return the section of the reaction's page."""
    lines = [
        f"Laws as in the [detector's table](detector-table.md#laws), {BEYOND[0]} to {BEYOND[1]:g}"
        " times beyond the true servo's own limit, other draws; both servos. Amplitude: the"
        " largest distance from the law's position.",
        "",
        "| law | oscillate | alarms | amplitude at the alarm, median and largest |"
        f" growth, median and largest | at most {WORSE} times | decays | ended by a trip |",
        "|---|---|---|---|---|---|---|---|",
        *(_growth_line(law, [s for s in results if s.law == law]) for law in LAWS),
        _growth_line("all", results),
    ]
    return Made(lines, grown([one for some in results for one in some.found]))


def _growth_line(name: str, results: list[LawTried]) -> str:
    found = [one for some in results for one in some.found]
    return (
        f"| {name} | {growth_cells(found)} |"
        f" {sum(one.trip is None and not one.never for one in found)} |"
        f" {sum(one.trip is not None for one in found)} |"
    )


LAW_ROWS = section("laws", jobs, tried, told, case_s=25.0)
LAW_GROWTH = section(
    "laws", lambda given: _beyond_jobs(given, 23), tried, reaction_told, case_s=20.0
)
