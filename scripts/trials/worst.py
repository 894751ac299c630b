"""Searches true servos, walls and kicks for the case that the reaction handles worst."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Literal

from scripts.study import Given
from scripts.trials.cases import DAMPINGS, KICKS, PRESETS, Case
from scripts.trials.draws import (
    LAG_FACTOR,
    MODE_DAMPING,
    MODE_HZ,
    MODE_LOAD,
    MOST_BACKLASH,
    bench_of,
)
from scripts.trials.judges import LONGEST_S, large, own_oscillation
from scripts.trials.own_walls import ANY_STIFFNESS
from scripts.trials.run import WallAsked
from scripts.trials.search import Axis, Found, worst_cases
from scripts.trials.sections import Job, Made, section
from scripts.trials.truth import BackEmf, Truth
from scripts.trials.verdicts import at_alarm_and_after, longest_unseen_s, sustains

Body = Literal["rigid", "flexible"]
BODIES: tuple[Body, ...] = ("rigid", "flexible")
_KINDS: tuple[BackEmf, ...] = ("none", "current", "voltage")
_LONG_S = 14.0
_NEVER = 4.0
"""Least lateness of an oscillation that persists to the end: more than any that ends"""
_TOLD = 3
"""Number of cases of each search on the page"""


def box(preset: str, body: Body) -> list[Axis]:
    """Return the box of the search: ``kind`` is the back-EMF; a rigid servo has no mode.

    The two bodies have separate searches: the worst flexible one would hide the worst rigid one.
    """
    belief = bench_of(preset).belief
    dampings = DAMPINGS[preset]
    axes = [
        Axis("inertia", belief.inertia.low, belief.inertia.high, log=True),
        Axis("damping", belief.damping.low, belief.damping.high, log=True),
        Axis("coulomb", belief.coulomb.low, belief.coulomb.high, log=True),
        Axis("gain", belief.torque_gain.low, belief.torque_gain.high, log=True),
        Axis("lag", belief.delay.low, LAG_FACTOR * belief.delay.high),
        Axis("wall_damping", dampings[0], dampings[-1], log=True),
        Axis("kick", *KICKS, log=True),
        Axis("kind", 0.0, 2.999),
        Axis("backlash", 0.0, MOST_BACKLASH),
    ]
    if body == "flexible":
        axes += [
            Axis("mode_hz", *MODE_HZ, log=True),
            Axis("mode_damping", *MODE_DAMPING, log=True),
            Axis("load", *MODE_LOAD),
        ]
    return axes


def case_of(preset: str, point: Mapping[str, float]) -> Case:
    """Return the case of a point of the box."""
    bench = bench_of(preset)
    truth = Truth(
        inertia=point["inertia"],
        damping=point["damping"],
        coulomb=point["coulomb"],
        torque_gain=point["gain"],
        delay=point["lag"],
        torque_limit=bench.torque_limit,
        torque_step=bench.torque_step,
        backlash=point["backlash"],
        back_emf=_KINDS[int(point["kind"])],
        stall_torque=point["gain"] * bench.stall_torque,
        no_load_speed=bench.no_load_speed,
    )
    if "load" in point:
        truth = truth.with_mode(point["mode_hz"], point["mode_damping"], point["load"])
    wall = WallAsked(ANY_STIFFNESS, point["wall_damping"], forced=False)
    return Case(preset, truth, wall, _LONG_S, position=point["kick"])


def lateness(preset: str, point: Mapping[str, float]) -> float:
    """Return the time until an oscillation decays or the run ends, over the permitted one [1].

    Above 1 it is late. An oscillation that never ends counts at least 4 more, and increases with
    its size.
    """
    case = case_of(preset, point)
    trial = case.run(speed_limits=True)
    own = own_oscillation(trial, bench_of(preset).belief)
    if math.isnan(own.onset_s):
        return 0.01 * min(own.largest / large(case.truth.counts_per_rev), 1.0)
    over = own.ended_s if own.tripped else own.decays_s
    late = (over - own.onset_s) / (own.deadline_s - own.onset_s)
    if not own.tripped and sustains(trial, large(case.truth.counts_per_rev)):
        return late + _NEVER + own.final
    return late


def growth(preset: str, point: Mapping[str, float]) -> float:
    """Return the largest distance from the surface after the alarm, relative to that before [1].

    Without an alarm: the largest of all relative to the kick.
    """
    trial = case_of(preset, point).run()
    before, after = at_alarm_and_after(trial)
    if math.isnan(before):
        return float(abs(trial.output).max()) / point["kick"]
    return after / before


def hidden(preset: str, point: Mapping[str, float]) -> float:
    """Return the longest time in which a motion above four counts is missed, over 5 s [1]."""
    return longest_unseen_s(case_of(preset, point).run()) / LONGEST_S


GOALS = {"lateness": lateness, "growth": growth, "unseen": hidden}
_WRONG = {"lateness": 1.0, "growth": 1.5, "unseen": 1.0}
"""Values above which a case is a counter-example"""


@dataclass(frozen=True, slots=True)
class Searched:
    """Tried cases of a search, the worst first."""

    preset: str
    body: Body
    goal: str
    found: list[Found]


def searched(job: tuple[str, Body, str, int, int]) -> Searched:
    """Search in this process; return all tried points, the worst first.

    Args:
        job: Preset of the servo, body, goal, number of generations, and the seed.
    """
    preset, body, goal, generations, seed = job
    few = 12 if generations > 1 else 1
    found = worst_cases(
        partial(GOALS[goal], preset),
        box(preset, body),
        parents=few,
        children=2 * few,
        generations=generations,
        seed=seed,
        workers=0,
    )
    return Searched(preset, body, goal, found)


def jobs(given: Given) -> list[Job]:
    """Return the jobs: every goal on every servo."""
    return [
        (preset, body, goal, given.generations, given.seed)
        for preset in PRESETS
        for body in BODIES
        for goal in GOALS
    ]


def told(results: list[Searched]) -> Made:
    """Return the section's text."""
    lines = [
        "An evolution strategy over inertia, damping, Coulomb friction, torque gain (their believed"
        f" bounds), lag (to {LAG_FACTOR:g} times its upper bound), B, kick, kind of back-EMF,"
        " backlash, and a transmission's frequency, damping and load, with the guard's own K,"
        " two-sided, and `reduce`. `lateness`: the time until the motion decays or the run ends, by"
        " the time it may take, with the trip by speed on as by default; what goes on to the end"
        f" of {_LONG_S:g} s counts {_NEVER:g} more. `growth`: the largest distance from the surface"
        " after the alarm by the largest until then. `unseen`: the longest time for which a"
        " motion above four counts did not die, and was called quiet or decaying, by"
        f" {LONGEST_S:g} s.",
        "",
        "| servo | body | goal | evaluations | worst | counter-examples, above | worst case |",
        "|---|---|---|---|---|---|---|",
    ]
    wrong: list[tuple[str, object]] = []
    for one_search in results:
        preset, goal, found = one_search.preset, one_search.goal, one_search.found
        above = [one for one in found if one.value > _WRONG[goal]]
        worst = found[0]
        point = ", ".join(f"{name} {value:.3g}" for name, value in worst.point.items())
        lines.append(
            f"| {preset} | {one_search.body} | {goal} | {len(found)} | {worst.value:.2f} |"
            f" {len(above)}, above {_WRONG[goal]:g} | {point} |"
        )
        wrong += [(f"{goal} {one.value:.2f}", case_of(preset, one.point)) for one in above[:_TOLD]]
    return Made(lines, wrong)


WORST = section("search", jobs, searched, told, case_s=20.0)
