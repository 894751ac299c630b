"""Tries the oscillation detector on walls, laws, links and operators drawn at random.

    scripts/study detector_table

The thresholds were chosen on the draws of seeds up to 71: judge a change of the detector by a seed
that no change was made for. A case runs again with ``oscillation(case)`` or ``held(case)`` of
``tests.support.verdicts``.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from scripts.rates import hourly, lower_bound
from scripts.study import Found, Given, Option, Part, Study
from tests.support import cases_drawn, links_drawn
from tests.support.cases_drawn import KINDS, LAGS, LAW_HANDS, LAWS, PRESETS, WALLS
from tests.support.links_drawn import PLANTS, SHARES
from tests.support.operators import HANDS, HARDER
from tests.support.trial import Case
from tests.support.verdicts import (
    WORSE,
    Answered,
    Held,
    controlled,
    held,
    oscillation,
    small_cycle,
)

_HAND_S, _LAW_HAND_S = 60.0, 45.0
"""Longest trials with an operator [s]"""
_HARDER, _REAL, _LAW = 0.1, 0.2, 0.1
"""Hours of a harder operator, on servos with every effect, and on a law, relative to ``--hours``"""


@dataclass(frozen=True, slots=True)
class Job:
    """Some cases of a kind; what is drawn depends on these values alone."""

    kind: str
    values: tuple[Any, ...]
    """Of the kind's axes"""
    count: int
    seconds: float
    """Longest trial with an operator [s]"""
    seed: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Tried:
    """The results of a job."""

    drawn: int
    walls: list[Answered] = field(default_factory=list)
    """Those that oscillate by themselves"""
    hands: list[Held] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class Kind:
    """Cases that are drawn and judged in the same way."""

    number: int
    """A part of the seeds"""
    axes: tuple[Sequence[Any], ...]
    """Values for which cases are drawn: all combinations"""
    draw: Callable[..., Case]
    """Called with the random generator, a value of each axis, and for operators the seconds"""
    judge: Callable[[Case], Answered | Held | None]
    together: int = 15
    """Cases in a job"""
    walls: Callable[[tuple[int, ...]], int] = lambda _: 1
    """Walls for each of ``--walls``, by the indices in the axes"""
    tries: int = 1
    """Walls drawn for each that oscillates, at most: they are drawn until enough oscillate"""
    hours: Callable[[tuple[Any, ...]], float] | None = None
    """Hours for each of ``--hours``, by the values of the axes; None: no operator"""
    longest_s: float = _HAND_S


def _by_lag(indices: tuple[int, ...]) -> int:
    return indices[-1] + 1


KINDS_TRIED = {
    "walls": Kind(
        1, (PRESETS, tuple(KINDS), tuple(LAGS)), cases_drawn.draw_wall, oscillation, walls=_by_lag
    ),
    "limit": Kind(
        3, (PRESETS, tuple(LAGS)), cases_drawn.draw_limit, oscillation, walls=lambda _: 2
    ),
    "bounces": Kind(4, (PRESETS, WALLS, tuple(LAGS)), cases_drawn.draw_bounces, oscillation),
    "backlash": Kind(
        5,
        (PRESETS,),
        cases_drawn.draw_small_cycle,
        small_cycle,
        together=10,
        walls=lambda _: 4,
    ),
    "real": Kind(
        7,
        (PRESETS, tuple(LAGS)),
        cases_drawn.draw_real_wall,
        oscillation,
        together=5,
        walls=_by_lag,
    ),
    "real hands": Kind(
        8,
        (PRESETS, HANDS),
        partial(cases_drawn.draw_held, real=True),
        held,
        together=1,
        hours=lambda _: _REAL,
    ),
    "laws": Kind(
        22, (PRESETS, LAWS), cases_drawn.draw_law_beyond, oscillation, together=5, tries=8
    ),
    "law hands": Kind(
        21,
        (PRESETS, LAWS, LAW_HANDS),
        cases_drawn.draw_law_held,
        held,
        together=5,
        hours=lambda _: _LAW,
        longest_s=_LAW_HAND_S,
    ),
    "ceiling": Kind(13, (PRESETS, SHARES), links_drawn.draw_link, oscillation, together=6),
    "passivity": Kind(31, (PLANTS,), links_drawn.draw_controlled, controlled),
    "hands": Kind(
        2,
        (PRESETS, (*HANDS, *HARDER)),
        cases_drawn.draw_held,
        held,
        together=5,
        hours=lambda values: _HARDER if values[1] in HARDER else 1.0,
    ),
}


def jobs(name: str, given: Given) -> Iterator[Job]:
    """Yield the jobs of a kind of cases, from the options."""
    kind = KINDS_TRIED[name]
    seconds, together = kind.longest_s, kind.together
    if kind.hours is not None and kind.longest_s == _HAND_S:
        seconds = min(seconds, 3600.0 * given.hours)
        together = max(1, round(together * _HAND_S / seconds)) if together > 1 else 1
    for numbered in itertools.product(*map(enumerate, kind.axes)):
        indices, values = zip(*numbered, strict=True)
        if kind.hours is None:
            count = max(1, kind.walls(indices) * int(given.walls))
        else:
            count = max(1, round(kind.hours(values) * given.hours * 3600.0 / seconds))
        # Every share of the ceiling meets the same servos.
        drawn = indices[:1] if name == "ceiling" else indices
        for part in range(-(-count // together)):
            some = min(together, count - part * together)
            yield Job(name, values, some, seconds, (given.seed, kind.number, *drawn, part))


def tried(job: Job) -> Tried:
    """Draw the cases of a job, and judge them."""
    kind, random = KINDS_TRIED[job.kind], np.random.default_rng(list(job.seed))
    values = job.values if kind.hours is None else (*job.values, job.seconds)
    made = Tried(0)
    walls, hands, drawn = made.walls, made.hands, 0
    while drawn < kind.tries * job.count and len(walls) < job.count:
        case = kind.draw(random, *values)
        drawn += 1
        found = kind.judge(case)
        if isinstance(found, Answered):
            walls.append(found)
        elif found is not None:
            hands.append(found)
    return Tried(drawn, walls, hands)


def _line(*cells: object) -> str:
    return f"|{'|'.join(map(str, cells))}|"


def _wall_cells(some: list[Tried]) -> list[object]:
    found = [one for each in some for one in each.walls]
    n, in_time = len(found), sum(one.in_time for one in found)
    late = [one.late_s for one in found if not (one.in_time or one.never)]
    alarms = [one for one in found if not math.isnan(one.alarm_s)]
    return [
        sum(each.drawn for each in some),
        n,
        f"{in_time} (>{lower_bound(in_time, n):.2g})" if n else "",
        f"{max(late):.2f}" if late else "",
        sum(one.never for one in found),
        sum(one.unseen for one in found),
        sum(one.trip is not None for one in found),
        f"{sum(one.growth <= WORSE for one in alarms)}/{len(alarms)}",
    ]


def _hand_cells(some: list[Tried]) -> list[object]:
    found = [one for each in some for one in each.hands]
    hours = sum(one.seconds for one in found) / 3600.0
    innocent = [one for one in found if not one.goes_on]
    return [
        f"{hours:.2f}",
        f"{sum(one.probes for one in found) / hours:.0f}",
        hourly(sum(one.softened for one in innocent), hours),
        hourly(sum(one.trip is not None for one in found), hours),
    ]


def _table(found: Found[Job, Tried], name: str) -> Iterator[str]:
    """Yield a table of a kind: a row for each value of an axis, over all others, and one of all."""
    kind = KINDS_TRIED[name]
    here = [(job, row) for job, row in found if job.kind == name]
    if kind.hours is None:
        head, cells = "drawn|oscillate|in time|late by|never|unseen|trips|grow little", _wall_cells
    else:
        head, cells = "hours|probes/h|softened/h|trips/h", _hand_cells
    yield _line(name, head)
    yield "|".join(["", *["---"] * (head.count("|") + 2), ""])
    for place, axis in enumerate(kind.axes):
        for value in axis if len(axis) > 1 else ():
            if some := [row for job, row in here if job.values[place] == value]:
                yield _line(value, *cells(some))
    if here:
        yield _line("all", *cells([row for _, row in here]))


def _lines(found: Found[Job, Tried], names: tuple[str, ...]) -> Iterator[str]:
    for number, name in enumerate(names):
        yield from [""] if number else []
        yield from _table(found, name)


def _part(case_s: float, *names: str) -> Part[Job, Tried]:
    """Return the part of the page with these kinds of cases; ``case_s``: about a job's time [s]."""
    return Part(
        names[0],
        lambda given: [job for name in names for job in jobs(name, given)],
        tried,
        lambda found: _lines(found, names),
        case_s,
    )


STUDY = Study(
    "evidence/detector-table.md",
    (
        _part(4.0, "walls"),
        _part(4.0, "limit"),
        _part(4.0, "bounces"),
        _part(3.0, "backlash"),
        _part(12.0, "real", "real hands"),
        _part(25.0, "laws", "law hands"),
        _part(20.0, "ceiling"),
        _part(2.0, "passivity"),
        _part(6.0, "hands"),
    ),
    (
        Option("seed", 101, "seed of all draws"),
        Option("walls", 25, "walls in each row with a believed lag", quick=0),
        Option("hours", 3.0, "hours of each operator on each servo", quick=1.0 / 720.0),
    ),
    everywhere=True,
)
