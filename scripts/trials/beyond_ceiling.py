"""Tries walls around the ceiling of a link's vibration: is it noticed, and does it die?

The encoder on the output sees the damper take energy from a vibration that the motor feeds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from haptic_wall.controller.theory.flexible import flexible_boundary, flexible_ceiling
from scripts.study import Given
from scripts.trials.cases import PRESETS, Case, log_uniform
from scripts.trials.draws import bench_of, draw_truth
from scripts.trials.judges import large
from scripts.trials.rates import few, most
from scripts.trials.run import Trial, WallAsked
from scripts.trials.sections import Job, Made, draws, in_parts, section, walls_of
from scripts.trials.truth import Truth
from scripts.trials.verdicts import Answered, answered, small, sustains, until_judged
from tests.support.real_servos import BANDWIDTH

SHARES = (0.9, 1.0, 1.05, 1.2, 1.5, 2.0, 4.0)
"""B over the exact ceiling"""
PERIOD = 1e-3
STIFFNESS = {"xm430-w350": (50.0, 400.0), "xl330-m288": (5.0, 80.0)}
"""Of gear and horn [N·m/rad]: the presets' belief"""
LOAD, RATIO = (0.025, 1.5), (0.01, 0.05)
"""Inertia of the link over the motor's; damping ratio"""
KICK, STRUCK = (0.02, 0.3), (0.5, 5.0)
"""Displacement where there is a spring [rad], and speed of the struck link [rad/s]"""
AT_REST, TOUCHED = 0.25, 0.02
"""Probability of neither, so that only the encoder's rounding starts a motion; speed of the shaft
then, where no spring moves it [rad/s]"""
_FED = 0.45 * math.pi
"""Largest angle ``ω_r (t_d + T)``: the damper feeds the vibration up to a right angle"""
_SOFTER = 0.9
"""B over the ceiling where K is half of the limit"""
_COUNT = math.tau / 4096
_A_JOB = 6


@dataclass(frozen=True, slots=True)
class Vibration:
    """One wall, its motion without a reaction, and what becomes of it."""

    case: Case
    lasts: bool
    """It sustains itself above four counts while the detector reports"""
    hums: bool
    """It sustains itself above one count, but not above four"""
    large: bool
    """It sustains itself above ten counts or 1 degree"""
    alarm_s: float
    """With the guard off; NaN: there was no alarm"""
    at_alarm: float
    """Amplitude in the last quarter second before it [counts]; NaN: there was no alarm"""
    in_time: bool
    """With the guard off: it decays, or the run ends, before the deadline"""
    reduced: Answered | None
    """With ``reduce``; None: it is not large"""


@dataclass(frozen=True, slots=True)
class Cell:
    """Results of some walls."""

    preset: str
    share: float
    found: list[Vibration]


def draw_linked(preset: str, random: np.random.Generator, *, friction: bool) -> Truth:
    """Draw a servo within the belief with a link whose vibration a late damper feeds.

    Args:
        preset: Of the servo.
        random: Draws.
        friction: It has Coulomb friction.
    """
    while True:
        truth = draw_truth(bench_of(preset), random, lag_factor=1.0, back_emf="none")
        load = log_uniform(LOAD, random)
        share = load / (1.0 + load)
        rate = math.sqrt(
            log_uniform(STIFFNESS[preset], random) / ((1.0 - share) * share * truth.inertia)
        )
        truth = truth.with_mode(rate / math.tau, log_uniform(RATIO, random), share)
        bandwidth = log_uniform(BANDWIDTH, random)
        lag = max(truth.delay, 1.0 / (math.tau * bandwidth))
        if rate * (lag + PERIOD) < _FED:
            return replace(
                truth,
                delay=lag - 1.0 / (math.tau * bandwidth),
                current_bandwidth=bandwidth,
                coulomb=truth.coulomb if friction else 0.0,
            )


def ceiling_of(truth: Truth) -> float:
    """Return the commanded B above which no soft wall is stable on two masses [N·m·s/rad]."""
    ceiling = flexible_ceiling(*_masses(truth), PERIOD, truth.delay, bandwidth=_bandwidth(truth))
    return float(ceiling) / truth.torque_gain


def limit_of(truth: Truth, damping: float) -> float:
    """Return the commanded K below which a wall is stable on two masses [N·m/rad].

    Args:
        truth: The servo.
        damping: Commanded B [N·m·s/rad].
    """
    gain = truth.torque_gain
    found = flexible_boundary(
        *_masses(truth), gain * damping, PERIOD, truth.delay, bandwidth=_bandwidth(truth)
    )
    return float(found.stiffness) / gain


def _masses(truth: Truth) -> tuple[float, float, float, float, float]:
    motor, load = truth.inertia - truth.load_inertia, truth.load_inertia
    return motor, truth.damping, load, truth.transmission_stiffness, truth.transmission_damping


def _bandwidth(truth: Truth) -> float | None:
    return truth.current_bandwidth or None


def draw_walls(preset: str, share: float, walls: int, random: np.random.Generator) -> list[Case]:
    """Draw servos and kicks: the same for every share.

    Of four walls in a row two have friction, and two a spring of half the limit's stiffness.

    Args:
        preset: Of the servo.
        share: B over the ceiling.
        walls: Number of walls.
        random: Draws.
    """
    cases = []
    for number in range(walls):
        truth = draw_linked(preset, random, friction=number % 2 == 0)
        kick, struck = log_uniform(KICK, random), log_uniform(STRUCK, random)
        kicked = random.random() >= AT_REST
        between = float(random.random()) * _COUNT
        ceiling = ceiling_of(truth)
        stiffness = 0.5 * limit_of(truth, _SOFTER * ceiling) if number % 4 >= 2 else 0.0
        wall = WallAsked(stiffness, share * ceiling)
        case = Case(preset, truth, wall, position=between)
        if kicked:
            case = replace(case, position=kick if stiffness > 0.0 else between, struck=struck)
        elif stiffness == 0.0:
            case = replace(case, velocity=TOUCHED)
        cases.append(case)
    return cases


def tried(job: tuple[str, float, int, tuple[int, ...]]) -> Cell:
    """Try some walls.

    Args:
        job: Preset of the servo, B over the ceiling, number of walls, and the seed.
    """
    preset, share, walls, seed = job
    cases = draw_walls(preset, share, walls, draws(seed))
    return Cell(preset, share, [vibration(case) for case in cases])


def unguarded(case: Case) -> Case:
    """Return the case with the guard off: an alarm ends the run."""
    return replace(case, law=(*case.law, "guard.mode=off"))


def vibration(case: Case) -> Vibration:
    """Run a case without a reaction, with the guard off, and, if its motion is large, reduced."""
    reported = case.run("report")
    counts = case.truth.counts_per_rev
    is_large = sustains(reported, large(counts))
    lasts = is_large or sustains(reported, small(counts))
    trial, own = until_judged(unguarded(case), "trip")
    alarm = trial.first_alarm_s
    return Vibration(
        case=case,
        lasts=lasts,
        hums=not lasts and sustains(reported, case.truth.position_step),
        large=is_large,
        alarm_s=alarm,
        at_alarm=math.nan if math.isnan(alarm) else _amplitude(trial, alarm),
        in_time=own.in_time,
        reduced=answered(case) if is_large else None,
    )


def _amplitude(trial: Trial, at_s: float) -> float:
    """Return half of the distance that the output covers in the quarter second before [counts]."""
    end = min(max(1, round(at_s / trial.period)), trial.output.size)
    return 0.5 * float(np.ptp(trial.output[max(0, end - 250) : end])) / _COUNT


def jobs(given: Given) -> list[Job]:
    """Return the jobs: both servos and all shares, in parts."""
    made = []
    for i, preset in enumerate(PRESETS):
        for share in SHARES if given.walls else SHARES[3:4]:
            for part, walls in in_parts(walls_of(given, 1), _A_JOB):
                made.append((preset, share, walls, (given.seed, 13, i, part)))
    return made


def told(cells: list[Cell]) -> Made:
    """Return the section's text."""
    lines = [
        "Links on servos within the belief: gear and horn of"
        f" {STIFFNESS[PRESETS[0]][0]:g} to {STIFFNESS[PRESETS[0]][1]:g} N·m/rad (XM430) or"
        f" {STIFFNESS[PRESETS[1]][0]:g} to {STIFFNESS[PRESETS[1]][1]:g} (XL330), a link of"
        f" {LOAD[0]:g} to {LOAD[1]:g} times the motor's inertia, damping ratio"
        f" {100 * RATIO[0]:g} to {100 * RATIO[1]:g} %, current loop of {BANDWIDTH[0]:g} to"
        f" {BANDWIDTH[1]:g} Hz, lag within the bounds. Half of the servos have no Coulomb friction."
        " The believed servo is rigid. Two-sided walls with B at a multiple of the exact ceiling,"
        f" half of them with K = 0, half with K at half of its limit at {_SOFTER:g} of the ceiling,"
        f" let go at {KICK[0]:g} to {KICK[1]:g} rad; the link is struck, and has"
        f" {STRUCK[0]:g} to {STRUCK[1]:g} rad/s. A quarter starts with the encoder's rounding"
        " alone. A motion *lasts* if, with `report`, it sustains"
        " itself above four counts to the end of 8 s; it is *large* above ten, and *hums* between"
        " one and four; else it *dies*. *In time*,"
        " `unseen`: as [above](#walls-that-oscillate-by-themselves).",
        "",
        "| servo | B / ceiling | walls | lasts | guard off: of these, alarm | time to it, median"
        " and largest | amplitude at it, median [counts] | alarm, hums | alarm, dies | large |"
        " guard off: in time | with `reduce` in time | late, by at most | never | unseen |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for preset in (*PRESETS, "both"):
        here = [one for one in cells if preset in (one.preset, "both")]
        lines += [_line(preset, share, _of(here, share)) for share in SHARES]
    lines += ["", *_by_kind(cells)]
    return Made(lines, _wrong(cells))


def _of(cells: list[Cell], share: float) -> list[Vibration]:
    return [one for some in cells if some.share == share for one in some.found]


def _line(preset: str, share: float, found: list[Vibration]) -> str:
    lasting = [one for one in found if one.lasts]
    alarmed = [one for one in lasting if not math.isnan(one.alarm_s)]
    is_large = [one for one in found if one.large]
    reduced = [one.reduced for one in is_large if one.reduced is not None]
    late = [one.late_s for one in reduced if not one.in_time and not one.never]
    times = [one.alarm_s for one in alarmed]
    spread = f"{np.median(times):.1f}, {max(times):.1f} s" if times else ""
    size = f"{np.median([one.at_alarm for one in alarmed]):.0f}" if times else ""
    return (
        f"| {preset} | {share:g} | {len(found)} | {len(lasting)} |"
        f" {most(len(alarmed), len(lasting))} | {spread} | {size} |"
        f" {_humming(found)} | {_needless(found)} | {len(is_large)} |"
        f" {most(sum(one.in_time for one in is_large), len(is_large))} |"
        f" {most(sum(one.in_time for one in reduced), len(reduced))} |"
        f" {f'{len(late)}: {max(late):.2f} s' if late else '0'} |"
        f" {sum(one.never for one in reduced)} |"
        f" {few(sum(one.unseen for one in reduced), len(reduced))} |"
    )


def _by_kind(cells: list[Cell]) -> list[str]:
    """Return a table of the walls beyond the ceiling by friction, spring and start."""
    found = [one for share in (1.05, 1.2, 1.5) for one in _of(cells, share)]
    kinds = {
        "without Coulomb friction": [one for one in found if one.case.truth.coulomb == 0.0],
        "with Coulomb friction": [one for one in found if one.case.truth.coulomb > 0.0],
        "K = 0": [one for one in found if one.case.wall.stiffness == 0.0],
        "K > 0": [one for one in found if one.case.wall.stiffness > 0.0],
        "started by rounding alone": [one for one in found if not one.case.struck],
    }
    return [
        "At 1.05 to 1.5 times the ceiling, both servos:",
        "",
        "| | walls | lasts | guard off: of these, alarm | alarm, hums | alarm, dies |",
        "|---|---|---|---|---|---|",
        *(f"| {name} | {_kind_cells(some)} |" for name, some in kinds.items()),
    ]


def _kind_cells(found: list[Vibration]) -> str:
    lasting = [one for one in found if one.lasts]
    alarmed = sum(not math.isnan(one.alarm_s) for one in lasting)
    return (
        f"{len(found)} | {len(lasting)} | {most(alarmed, len(lasting))} |"
        f" {_humming(found)} | {_needless(found)}"
    )


def _humming(found: list[Vibration]) -> str:
    hums = [one for one in found if one.hums]
    return f"{sum(not math.isnan(one.alarm_s) for one in hums)} of {len(hums)}"


def _needless(found: list[Vibration]) -> str:
    dies = [one for one in found if not (one.lasts or one.hums)]
    return few(sum(not math.isnan(one.alarm_s) for one in dies), len(dies))


def _wrong(cells: list[Cell]) -> list[tuple[str, object]]:
    """Return the failures, each with its case."""
    wrong: list[tuple[str, object]] = []
    for some in cells:
        for one in some.found:
            silent, told_by = math.isnan(one.alarm_s), []
            if one.lasts and silent:
                told_by.append("lasts without an alarm")
            if not (one.lasts or one.hums or silent):
                told_by.append(f"dies, alarm after {one.alarm_s:.2f} s")
            if one.large and not one.in_time:
                told_by.append("late with the guard off")
            if one.reduced is not None and (not one.reduced.in_time or one.reduced.unseen):
                told_by.append(f"reduced: late by {one.reduced.late_s:.2f} s")
            if told_by:
                wrong.append((f"B {some.share:g}: {', '.join(told_by)}", one.case))
    return wrong


CEILING = section("ceiling", jobs, tried, told, case_s=20.0)
