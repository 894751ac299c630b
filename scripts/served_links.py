"""Searches the bins of the gain schedule for intervals at which a link's wall grows."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import differential_evolution

from haptic_wall.controller.guard.belief import Belief
from haptic_wall.controller.guard.bins import decide_bin, settings_at
from haptic_wall.controller.guard.guard import Decision, GuardSettings, Request, Situation, decide
from haptic_wall.controller.guard.schedule import inserted_delays, interval_bins_ns, served_range
from haptic_wall.controller.guard.types import WITHIN
from haptic_wall.controller.theory.chain import Chain, sampled
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.controller.theory.crossings import Loops, poles
from haptic_wall.controller.theory.velocity_filter import VelocityFilter

PERIOD, PERIOD_NS = 1e-3, 1_000_000
LAG, GAIN = 3, 2
"""Columns of the truths"""
_POPULATION = 40


class ServedLink(NamedTuple):
    """One wall in one bin of the served interval."""

    interval: float
    """At random inside the bin [periods]"""
    random: float
    """Fastest growth over random truths, ages and intervals of the bin [1/s]"""
    searched: float
    """The same, of an optimiser's search [1/s]"""
    stiffness: float
    """Commanded K over that of a bin which counts its upper end alone; NaN where that is 0"""
    damping: float
    """The same of B"""


class Wall(NamedTuple):
    """A belief with a wall that is asked for."""

    belief: Belief
    age: float
    """Oldest sample that the bin of the age covers [s]"""
    steps: int
    """Inserted delay [periods]"""
    damping: float
    """Asked B [N·m·s/rad]"""
    filtered: VelocityFilter | None


def served_links(
    wall: Wall,
    random: np.random.Generator,
    servos: Callable[[FloatArray], tuple[FloatArray, Chain]],
    names: int,
    truths: int,
    steps: int,
    bins: int,
) -> list[ServedLink]:
    """Search some bins for intervals at which their wall grows.

    Args:
        wall: The belief and the wall.
        random: Draws.
        servos: Gives truths and their servos from shares of each believed range.
        names: Number of those ranges.
        truths: Random truths of each bin.
        steps: Generations of the optimiser.
        bins: Number of bins that are searched.
    """
    intervals_ns = interval_bins_ns(PERIOD_NS, flexible=True)
    situation = Situation(wall.belief, PERIOD, 4.1, 0.0)
    request = Request(1e9, wall.damping, "both", velocity_filter=wall.filtered)
    ages_ns = [round(wall.age * 1e9)]
    found = []
    for index in random.choice(len(intervals_ns), bins, replace=False).tolist():
        (decision,) = decide_bin(
            request, GuardSettings(), situation, wall.steps, ages_ns, intervals_ns, index
        )
        low, high = (
            share * intervals_ns[index] * 1e-9 for share in served_range(intervals_ns, index)
        )

        def growths(
            shares: FloatArray,
            low: float = low,
            high: float = high,
            decision: Decision = decision,
        ) -> FloatArray:
            interval = low + shares[:, -1] * (high - low)
            delay = shares[:, -2] * wall.age + [_ring(wall.steps, t) for t in interval.tolist()]
            known, chain = servos(shares[:, :-2])
            return growth(known, chain, interval, delay, decision, wall.filtered)

        shares = random.random((truths, names + 2))
        corners = random.random(shares.shape) < 0.5
        shares = np.where(random.random((truths, 1)) < 0.5, shares, corners)
        tried = growths(shares)
        search = differential_evolution(
            lambda points, growths=growths: -growths(np.atleast_2d(points.T)),
            [(0.0, 1.0)] * shares.shape[1],
            init=shares[np.argsort(-tried)[:_POPULATION]],
            maxiter=steps,
            seed=index,
            polish=False,
            tol=0.0,
            updating="deferred",
            vectorized=True,
        )
        interval = float(random.uniform(low, high))
        before = by_upper_end(request, situation, wall.age, wall.steps, interval)
        found.append(
            ServedLink(
                interval / PERIOD,
                float(tried.max()),
                -float(search.fun),
                decision.stiffness / before.stiffness if before.stiffness > 0.0 else math.nan,
                decision.damping / before.damping if before.damping > 0.0 else math.nan,
            )
        )
    return found


def growth(
    truths: FloatArray,
    chain: Chain,
    interval: FloatArray,
    delay: FloatArray,
    wall: Decision,
    velocity_filter: VelocityFilter | None,
) -> FloatArray:
    """Return the rate at which each truth's loop grows, at most [1/s].

    Args:
        truths: Columns as of the study.
        chain: The servos.
        interval: Interval between ticks of each [s].
        delay: Delay of each, without the servo's lag [s].
        wall: The commanded gains.
        velocity_filter: Filter of the velocity that damps.
    """
    found = np.zeros(len(truths))
    late, gain = (delay + truths[:, LAG]) / interval, truths[:, GAIN]
    for whole in np.unique(np.floor(late)).tolist():
        part = np.flatnonzero(np.floor(late) == whole)
        chains = sampled(chain.take(part), interval[part], late[part] - whole)
        loops = Loops(chains, interval[part], int(whole), 1, velocity_filter)
        closed = poles(loops, gain[part] * wall.stiffness, gain[part] * wall.damping)
        found[part] = np.log(np.abs(closed).max(axis=1)) / interval[part]
    return found


def _ring(steps: int, interval: float) -> float:
    """Return the mean delay of the ring at an interval [s]."""
    each = interval / PERIOD
    waiting = [min(steps - n * each, 1.0) for n in range(math.ceil(steps / each))]
    return interval * sum(waiting)


def by_upper_end(
    request: Request, situation: Situation, age: float, steps: int, interval: float
) -> Decision:
    """Return the decision of the bins of a rigid servo, at their upper end alone.

    Args:
        request: The wall.
        situation: The belief, at the nominal period.
        age: Of the sample [s].
        steps: Inserted delay [periods].
        interval: Between ticks; it chooses the bin [s].
    """
    bins = interval_bins_ns(PERIOD_NS)
    index = next(k for k, ns in enumerate(bins) if interval <= WITHIN * ns * 1e-9)
    end = bins[index] * 1e-9
    inserted = inserted_delays(steps, PERIOD, end, (1.0, 1.0))[1]
    return decide(
        request,
        settings_at(GuardSettings(), index),
        replace(situation, period=end, served=(1.0, 1.0)),
        [inserted + age],
        inserted,
        explained=False,
    )[0]
