"""The detector on planar arms of two links: walls that oscillate, and hands at the tip.

Each joint has the servo's own wall: the detector knows nothing of the links.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import NamedTuple, TypeVar

import numpy as np

from haptic_wall.controller.guard.belief import Bounded
from scripts.rates import hourly, lower_bound
from scripts.study import Found, Given, Part, table
from tests.support.cases_drawn import DAMPINGS, KINDS, LAGS, PRESETS, draw_servo
from tests.support.judges import (
    WINDOW_S,
    deadline_after,
    large,
    own_oscillation,
    sustains,
    unseen,
)
from tests.support.operators import HANDS, HARDER, draw_operator
from tests.support.planar_arm import PERIOD, ArmCase, energy, run_arm
from tests.support.truth import Truth
from tests.support.truths_drawn import bench_of, critical_of, damping_ceiling_of, log_uniform

_LIGHTEST, _HEAVIEST = 0.1, 30.0
"""Range of the links' inertia about their joint, over the servo's [1]"""
_LENGTHS = 0.05, 0.3
"""[m]"""
_OF_THE_LIMIT = 0.9
"""Stiffness under hands, over the limit of the servo alone [1]"""
_HAND_S, _WALL_S = 60.0, 12.0
"""Length of a trial [s]"""

Numbered = tuple[str, int, int]
"""A kind of operator, or a range of lags; the seed; the number of the trial"""
Row = TypeVar("Row")


class Oscillated(NamedTuple):
    """The answer to an arm that oscillates by itself."""

    oscillates: bool
    in_time: bool = True
    late_s: float = 0.0
    """Time after the deadline until it has calmed down [s]"""
    never: bool = False
    unseen: bool = False
    tripped: bool = False


class Held(NamedTuple):
    """The trial of a hand at the tip."""

    seconds: float
    probes: int
    softened: int
    """Alarms"""
    softer_s: float
    """Time with less than the whole walls, probes included [s]"""
    tripped: bool


def _truth(preset: str, lags: str, damping: float, random: np.random.Generator) -> Truth:
    while True:
        truth = draw_servo(preset, KINDS["plain"], lags, random)
        if damping <= _OF_THE_LIMIT * damping_ceiling_of(truth):
            return truth


def _arm(lags: str, random: np.random.Generator) -> ArmCase:
    """Draw an arm with the dampings of its walls, and no stiffness yet."""
    preset = str(random.choice(PRESETS))
    dampings = [float(random.choice(DAMPINGS[preset])) for _ in range(2)]
    first, second = (_truth(preset, lags, damping, random) for damping in dampings)
    l1, l2 = (log_uniform(_LENGTHS, random) for _ in range(2))
    m1, m2 = (
        log_uniform((_LIGHTEST, _HEAVIEST), random) * truth.inertia / length**2
        for truth, length in ((first, l1), (second, l2))
    )
    return ArmCase(
        preset,
        (first, second),
        (l1, l2),
        (m1, m2),
        (0.0, 0.0),
        (dampings[0], dampings[1]),
        pose=(0.0, float(random.uniform(-2.5, 2.5))),
        start=(0.0, 0.0),
    )


def wall_row(case: Numbered) -> Oscillated:
    """Return how the detector answers walls of 0.8 to 4 times what the believed servos bear.

    In time: six cycles of the slowest motion after the onset, 5 s at most, the arm has less than
    half of the energy that it keeps where nobody answers, or of its largest. Motions of two joints
    beat: no half-cycle tells whether they die.
    """
    random = np.random.default_rng([*case[1:], 1])
    arm = _arm(case[0], random)
    belief = bench_of(arm.preset).belief
    factor = log_uniform((0.8, 4.0), random)
    bears = [
        critical_of(
            replace(
                truth,
                inertia=belief.inertia.low,
                damping=belief.damping.low,
                delay=belief.delay.high,
                torque_gain=belief.torque_gain.high,
            ),
            damping,
        )
        for truth, damping in zip(arm.truths, arm.damping, strict=True)
    ]
    start = (log_uniform((0.02, 0.3), random), log_uniform((0.02, 0.3), random))
    stiffness = (factor * bears[0], factor * bears[1])
    arm = replace(arm, stiffness=stiffness, start=start, duration_s=_WALL_S)
    unanswered = run_arm(arm, "report")
    if not any(sustains(trial, large(4096)) for trial in unanswered):
        return Oscillated(False)
    trials = run_arm(arm)
    spent = energy(arm, trials)
    kept = energy(arm, unanswered)[-round(WINDOW_S / PERIOD) :]
    most = 0.5 * min(float(np.median(kept)), float(spent.max()))
    calm_s = PERIOD * float(np.flatnonzero(spent > most)[-1] + 1)
    heaviest = float(np.linalg.eigvalsh(arm.inertia())[-1])
    slow = replace(belief, inertia=Bounded(heaviest, heaviest, heaviest))
    onsets_s = [own_oscillation(trial, slow).onset_s for trial in trials]
    onset_s = min((one for one in onsets_s if not math.isnan(one)), default=math.inf)
    late_s = calm_s - onset_s - max(deadline_after(slow, k) for k in stiffness)
    return Oscillated(
        True,
        late_s <= 0.0,
        max(late_s, 0.0),
        any(sustains(trial, large(4096)) and trial.trip is None for trial in trials),
        any(unseen(trial) for trial in trials),
        trials[0].trip is not None,
    )


def hand_row(case: Numbered) -> Held:
    """Move the tip by a hand, at nine tenths of each servo's own limit."""
    random = np.random.default_rng([*case[1:], 2])
    arm = _arm("within", random)
    k1, k2 = (
        _OF_THE_LIMIT * critical_of(truth, damping)
        for truth, damping in zip(arm.truths, arm.damping, strict=True)
    )
    arm = replace(arm, stiffness=(k1, k2), duration_s=_HAND_S)
    inertia = float(arm.inertia()[0, 0])
    hertz = math.sqrt(k1 / inertia) / math.tau
    hand = draw_operator(case[0], inertia, _HAND_S, random, natural_hz=hertz)
    trials = run_arm(arm, operator=hand, angle=float(random.uniform(0.0, math.tau)))
    softer = [trial.stiffness < 0.999 * k for trial, k in zip(trials, arm.stiffness, strict=True)]
    return Held(
        trials[0].output.size * trials[0].period,
        sum(trial.counts[0] for trial in trials),
        sum(trial.counts[2] for trial in trials),
        float(np.count_nonzero(softer[0] | softer[1])) * trials[0].period,
        trials[0].trip is not None,
    )


def _walls(given: Given) -> Iterator[Numbered]:
    return ((lags, given.seed, i) for i in range(given.walls) for lags in LAGS)


def _hands(given: Given) -> Iterator[Numbered]:
    kinds = (*HANDS, *HARDER)
    trials = max(1, round(given.hours * 3600.0 / _HAND_S / len(kinds)))
    return ((kind, given.seed, i) for i in range(trials) for kind in kinds)


def _wall_lines(found: Found[Numbered, Oscillated]) -> Iterable[str]:
    def line(name: str, rows: list[Oscillated]) -> tuple[object, ...]:
        there = [row for row in rows if row.oscillates]
        in_time = sum(row.in_time for row in there)
        share = f" (>{lower_bound(in_time, len(there)):.2f})" if there else ""
        late = max((row.late_s for row in there), default=0.0)
        return (
            name,
            len(rows),
            len(there),
            f"{in_time}{share}",
            f"{late:.2g}" if late else "",
            sum(row.never for row in there),
            sum(row.unseen for row in there),
            sum(row.tripped for row in there),
        )

    yield from table(
        (
            "lag over its bound",
            "drawn",
            "oscillate",
            "in time",
            "late by",
            "never",
            "unseen",
            "trips",
        ),
        *_by_kind(found, line),
    )


def _hand_lines(found: Found[Numbered, Held]) -> Iterable[str]:
    def line(name: str, rows: list[Held]) -> tuple[object, ...]:
        seconds = sum(row.seconds for row in rows)
        hours = seconds / 3600.0
        return (
            name,
            f"{hours:.2f}",
            f"{sum(row.probes for row in rows) / hours:.0f}",
            hourly(sum(row.softened for row in rows), hours),
            hourly(sum(row.tripped for row in rows), hours),
            f"{100.0 * sum(row.softer_s for row in rows) / seconds:.2g} %",
        )

    head = ["hand at the tip", "hours", "probes/h", "softened/h", "trips/h", "softer for"]
    yield from table(head, *_by_kind(found, line))


def _by_kind(
    found: Found[Numbered, Row], line: Callable[[str, list[Row]], tuple[object, ...]]
) -> Iterator[tuple[object, ...]]:
    for kind in dict.fromkeys(case[0] for case, _ in found):
        yield line(kind, [row for case, row in found if case[0] == kind])
    yield line("all", [row for _, row in found])


PARTS = (
    Part("oscillations", _walls, wall_row, _wall_lines, case_s=4.0),
    Part("tip", _hands, hand_row, _hand_lines, case_s=8.0),
)
