"""Worst-case search: an evolution strategy over a box, its trials in parallel processes.

A (mu + lambda) strategy with differences between survivors as steps, so that their size and their
direction adapt; a fraction of the children is drawn anew from the box and its corners.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from haptic_wall.controller.experiments.processes import cores, processes
from haptic_wall.controller.theory.checks import FloatArray

Point = Mapping[str, float]
Objective = Callable[[Point], float]
NICE = 10
_FRESH = 0.2
"""Fraction of the children drawn anew from the box."""
_CORNER = 0.3
"""Probability that a coordinate of those is at one of its bounds."""
_JITTER = 0.02


@dataclass(frozen=True, slots=True)
class Axis:
    """One dimension of the box."""

    name: str
    low: float
    high: float
    log: bool = False
    """Searched logarithmically; ``low`` > 0 then"""

    def value(self, share: float) -> float:
        """Convert a fraction of the axis, 0 to 1, to the value."""
        if self.log:
            return self.low * float((self.high / self.low) ** share)
        return self.low + share * (self.high - self.low)


@dataclass(frozen=True, slots=True)
class Found:
    """A point of the box, and its objective."""

    value: float
    point: dict[str, float]


def worst_cases(
    objective: Objective,
    box: Sequence[Axis],
    *,
    parents: int = 12,
    children: int = 24,
    generations: int = 20,
    seed: int = 1,
    workers: int | None = None,
    enough: float | None = None,
) -> list[Found]:
    """Search for the points with the largest objective.

    Args:
        objective: Gets a point by the axes' names; must be importable by other processes. NaN
            counts as the smallest value.
        box: Its axes.
        parents: Points that survive each generation.
        children: Points tried in each generation.
        generations: Largest number of generations.
        seed: Seed of everything drawn: the same search with any number of workers.
        workers: Processes; 0: this one; None: one for each core, at low priority.
        enough: Stop after the generation that has found a value above it.

    Returns:
        All tried points, the largest value first.
    """
    random = np.random.default_rng(seed)
    limits = (parents, children, generations, random, enough)
    count = cores() if workers is None else workers
    if count == 0:
        return _evolve(lambda points: [objective(point) for point in points], box, *limits)
    nicely = partial(_nicely, objective)
    with processes(count) as pool:
        return _evolve(lambda points: list(pool.map(nicely, points)), box, *limits)


def _evolve(
    judged: Callable[[list[dict[str, float]]], list[float]],
    box: Sequence[Axis],
    parents: int,
    children: int,
    generations: int,
    random: np.random.Generator,
    enough: float | None,
) -> list[Found]:
    shares = np.array([_fresh(len(box), random) for _ in range(parents + children)])
    values = _values(judged, box, shares)
    every = [(values, shares)]
    for _ in range(generations - 1):
        if enough is not None and float(values.max()) > enough:
            break
        best = np.argsort(-values, kind="stable")[:parents]
        values, shares = values[best], shares[best]
        young = np.array([_child(shares, random) for _ in range(children)])
        found = _values(judged, box, young)
        every.append((found, young))
        values, shares = np.concatenate([values, found]), np.concatenate([shares, young])
    values = np.concatenate([one for one, _ in every])
    shares = np.concatenate([one for _, one in every])
    order = np.argsort(-values, kind="stable")
    return [Found(float(values[i]), _point(box, shares[i])) for i in order.tolist()]


def _values(
    judged: Callable[[list[dict[str, float]]], list[float]],
    box: Sequence[Axis],
    shares: FloatArray,
) -> FloatArray:
    values = np.array(judged([_point(box, row) for row in shares]), dtype=np.float64)
    return np.where(np.isnan(values), -np.inf, values)


def _point(box: Sequence[Axis], shares: FloatArray) -> dict[str, float]:
    return {axis.name: axis.value(share) for axis, share in zip(box, shares.tolist(), strict=True)}


def _fresh(dimensions: int, random: np.random.Generator) -> FloatArray:
    shares = random.random(dimensions)
    corner = random.random(dimensions) < _CORNER
    result: FloatArray = np.where(corner, np.rint(shares), shares)
    return result


def _child(parents: FloatArray, random: np.random.Generator) -> FloatArray:
    """Return a parent moved along the difference of two others, or a new point."""
    dimensions = parents.shape[1]
    if random.random() < _FRESH or len(parents) < 3:
        return _fresh(dimensions, random)
    # A better point is more likely a parent.
    first = min(random.integers(len(parents)), random.integers(len(parents)))
    one, other = parents[random.choice(len(parents), 2, replace=False)]
    moved = random.random(dimensions) < 0.7
    step = random.uniform(0.3, 1.0) * (one - other) + _JITTER * random.standard_normal(dimensions)
    result: FloatArray = np.clip(parents[first] + moved * step, 0.0, 1.0)
    return result


def _nicely(objective: Objective, point: Point) -> float:
    """Evaluate the objective, at low priority from now on."""
    os.setpriority(os.PRIO_PROCESS, 0, max(NICE, os.getpriority(os.PRIO_PROCESS, 0)))
    return objective(point)
