"""Searches a belief for servos whose limits lie below those that the guard uses.

    scripts/study belief_box [--rounds N] [--seed S]

Boxes are as wide as the presets admit: the inertia to 2.25 times its lowest, the viscous damping
and the torque gain to 4 times, the delay to 5 periods; b T/m at the corner from 0.0001 to the
figure in the table, t_d to 12 periods, B to 0.7 of the ceiling. A search by mutation and
differences looks for the smallest ratio of a member's limit to what is counted with, starting from
random boxes and from boxes with some sides at their ends. The worst it found is in
docs/evidence/guard-searches.md. It takes some minutes.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from haptic_wall.controller.guard.belief import Belief, Bounded
from haptic_wall.controller.guard.limits import LOOKED_UP, evaluate, evaluate_box
from haptic_wall.controller.guard.plants import Plants
from haptic_wall.controller.guard.types import GuardSettings, Request, Situation
from haptic_wall.controller.laws.wall import Side
from haptic_wall.controller.theory import max_virtual_damping
from scripts.study import Found, Option, Part, Study, table

SETTINGS = GuardSettings(mode="off")
PERIOD = 1e-3
INERTIA = 1e-2
# corner's ln(b T/m), B of the ceiling, t_d, width of the delay [periods]; how wide inertia, damping
# and gain are; where in the box the member is, the corner at 0
LOWEST = np.array([np.log(1e-4), 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0])
HIGHEST = np.array([0.0, 0.7, 12.0, 5.0, 2.25, 4.0, 4.0, 1.0, 1.0, 1.0, 1.0])
POPULATION = 48


def belief_of(x: np.ndarray) -> tuple[Belief, float, float]:
    """A box, the longest delay, and the virtual damping asked."""
    b = np.exp(x[0]) * INERTIA / PERIOD
    delay = x[2] * PERIOD
    lag = (max(delay - x[3] * PERIOD, 0.0), delay)
    belief = Belief(
        Bounded(INERTIA, INERTIA, x[4] * INERTIA),
        Bounded(b, b, x[5] * b),
        Bounded.exactly(0.0),
        Bounded(lag[0], *lag),
        Bounded(1.0, 1.0 / x[6], 1.0),
    )
    ceiling = float(max_virtual_damping(INERTIA, b, PERIOD, delay))
    return belief, delay, float(x[1] * ceiling)


def member_of(x: np.ndarray, belief: Belief) -> Plants:
    """A servo inside the box."""
    values = (
        INERTIA * x[4] ** x[7],
        belief.damping.low * x[5] ** x[8],
        x[6] ** -x[9],
        PERIOD,
        belief.delay.high - x[10] * (belief.delay.high - belief.delay.low),
    )
    return Plants(*(np.array([each]) for each in values))


def ratio(x: np.ndarray, side: Side, samples: int, corner_only: bool) -> float:
    """The member's limit over what is counted with; above 1 is safe."""
    belief, _, damping = belief_of(x)
    situation = Situation(belief, PERIOD, 1.0, 0.0)
    request = Request(0.0, damping, side, samples)
    corner = Plants.at_corner(situation, np.zeros(1))
    asked = np.array([damping])
    over = evaluate if corner_only else evaluate_box
    counted = float(over(request, SETTINGS, situation, corner, LOOKED_UP, asked).smallest()[0])
    if counted <= 0:
        return 9.0
    member = member_of(x, belief)
    true = evaluate(request, SETTINGS, situation, member, 1e-3, asked)
    return float(true.smallest()[0]) / counted


def search(
    cost: Callable[[np.ndarray], float], top: float, rounds: int, random: np.random.Generator
) -> tuple[float, np.ndarray]:
    """The least cost found, and where."""
    low, high = LOWEST, HIGHEST.copy()
    high[0] = np.log(top)
    u = random.random((6 * POPULATION, low.size))
    end = random.random(u.shape)
    u = np.where(end < 0.25, 0, np.where(end < 0.4, 1, np.where(end < 0.6, u**3, u)))
    people = low + (high - low) * u
    costs = np.array([cost(x) for x in people])
    best = np.argsort(costs)[:POPULATION]
    people, costs = people[best], costs[best]
    size = 0.1
    for round_ in range(rounds):
        moved = people + (high - low) * size * random.normal(size=people.shape) * (
            random.random(people.shape) < 0.4
        )
        i, j, k = (random.integers(0, POPULATION, POPULATION) for _ in range(3))
        across = people[i] + 0.7 * (people[j] - people[k])
        tried = np.where((random.random(POPULATION) < 0.4)[:, None], moved, across)
        end = random.random(tried.shape)
        tried = np.where(end < 0.04, low, np.where(end > 0.97, high, tried))
        tried = np.clip(tried, low, high)
        found = np.array([cost(x) for x in tried])
        better = found < costs
        people[better], costs[better] = tried[better], found[better]
        if round_ % 20 == 19:
            size *= 0.6
    least = int(np.argmin(costs))
    return float(costs[least]), people[least]


class Searched(NamedTuple):
    """A wall and what is counted with for it."""

    wall: str
    side: Side
    samples: int
    top: float
    """Upper bound of b T/m at the corner"""
    corner_only: bool
    rounds: int
    seed: int


def least(case: Searched) -> float:
    """The least ratio that a search finds."""
    random = np.random.default_rng(case.seed)
    cost = partial(ratio, side=case.side, samples=case.samples, corner_only=case.corner_only)
    return search(cost, case.top, case.rounds, random)[0]


def lines(found: Found[Searched, float]) -> list[str]:
    """A line for each wall and range: the corner alone, the box."""
    rows = [
        [case.wall, f"to {case.top:g}", f"{alone:.3f}", f"{box:.3f}"]
        for (case, alone), (_, box) in zip(found[::2], found[1::2], strict=True)
    ]
    return table(["wall", "b T/m at the corner", "corner alone", "least over the box"], *rows)


WALLS: tuple[tuple[str, Side, int], ...] = (
    ("two-sided", "both", 1),
    ("never pulls", "above", 1),
    ("never pulls, N = 3", "above", 3),
)
STUDY = Study(
    "evidence/guard-searches.md",
    (
        Part(
            "belief_box",
            lambda given: [
                Searched(*wall, top, corner_only, given.rounds, given.seed)
                for wall in WALLS
                for top in (0.1, 1.0)
                for corner_only in (True, False)
            ],
            least,
            lines,
            case_s=30.0,
        ),
    ),
    (Option("rounds", 80, "rounds of each search"), Option("seed", 1, "seed of the searches")),
    everywhere=True,
)
