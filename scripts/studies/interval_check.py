"""Compares periods that replace irregular intervals with the exact loop.

    scripts/study interval_check [--servos N] [--patterns N]

The tables of docs/evidence/interval-check.md; the same on every machine.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np

from haptic_wall.controller.guard.schedule import (
    INTERVAL_BINS,
    IRREGULAR_CAP,
    GainSchedule,
    interval_bins_ns,
)
from haptic_wall.controller.theory import critical_stiffness, max_virtual_damping
from scripts.irregular_loop import (
    PERIOD,
    QUARTERS,
    Loop,
    interval_matrix,
    least_unstable,
    mean_square_radius,
    pattern_radius,
)
from scripts.study import Option, Part, Study, table, table_of

MX_64 = (0.007967, 0.005846)
"""Lowest inertia and damping believed of the XM430 [SI]"""
MARGIN, CAP = 0.8, 0.7
INERTIAS, RATES = (5e-4, 0.03), (0.3, 10.0)
"""Inertia [kg·m²] and damping over inertia [1/s] of random servos"""
UNSTABLE = 1 + 1e-6
"""Growth that counts as such"""
WINDOW, RUN = 1000, 50
Mixture = tuple[str, tuple[float, ...], tuple[float, ...]]
MIXTURES: tuple[Mixture, ...] = (
    ("1.5 always", (1.5,), (1.0,)),
    ("1 or 2, half each", (1, 2), (0.5, 0.5)),
    ("1, a fifth 2", (1, 2), (0.8, 0.2)),
    ("1, a tenth 3", (1, 3), (0.9, 0.1)),
    ("half 0.5, half 1.5", (0.5, 1.5), (0.5, 0.5)),
    ("1, 2 or 3", (1, 2, 3), (0.5, 0.3, 0.2)),
    ("1 or 4, half each", (1, 4), (0.5, 0.5)),
    ("1, a 20th 8", (1, 8), (0.95, 0.05)),
    ("1, a 100th 8", (1, 8), (0.99, 0.01)),
    ("1, a 250th 8", (1, 8), (0.996, 0.004)),
    ("1, a 100th 16", (1, 16), (0.99, 0.01)),
    ("1, a 300th 16", (1, 16), (0.997, 0.003)),
)
"""Independent intervals [periods] and how often each comes"""
PIECES = (2, 4, 4, 5, 6, 8, 12, 16, 32)
"""Of the patterns that are searched [quarters of a period]"""


@dataclass(frozen=True, slots=True)
class Rule:
    """A period and an additional delay that stand for irregular intervals."""

    period: float
    more_delay: float = 0.0

    def limit(self, loop: Loop) -> float:
        """The exact limit of the regular loop [N·m/rad]."""
        delay = loop.age * PERIOD / QUARTERS + self.more_delay
        found = critical_stiffness(
            loop.inertia, loop.damping, loop.virtual, self.period, max(delay, 0.0)
        )
        return float(found)


def rules(intervals: Sequence[float], weights: Sequence[float]) -> dict[str, Rule]:
    """Periods that might be counted with, for intervals [periods] and their frequencies."""
    each, weight = np.array(intervals) * PERIOD, np.array(weights)
    mean, square = float(weight @ each), float(weight @ each**2)
    weighted = square / mean
    return {
        "nominal": Rule(PERIOD),
        "mean": Rule(mean),
        "delay": Rule(PERIOD, (weighted - PERIOD) / 2),
        "weighted": Rule(weighted),
    }


def random_loop(random: np.random.Generator, period: float) -> Loop:
    """A servo with damping up to the guard's cap at a period [s], with samples up to 2 old."""
    inertia = np.exp(random.uniform(*np.log(INERTIAS)))
    damping = inertia * np.exp(random.uniform(*np.log(RATES)))
    age = int(random.choice([0, 1, 2, 4, 6, 8]))
    ceiling = float(max_virtual_damping(inertia, damping, period, age * PERIOD / QUARTERS))
    return Loop(inertia, damping, ceiling * random.choice([0.005, 0.02, 0.1, 0.3, 0.7]), age)


def mean_square_limit(
    loop: Loop, intervals: Sequence[float], weights: Sequence[float], guess: float
) -> float:
    """Up to which stiffness the mean square decays [N·m/rad]."""

    def radius(stiffness: float) -> float:
        matrices = [
            interval_matrix(loop, stiffness, round(QUARTERS * each), each * PERIOD)
            for each in intervals
        ]
        return mean_square_radius(matrices, weights)

    return least_unstable(radius, guess)


def slow_tick(age: int) -> list[str]:
    """A row: every tick costs 1.5 periods, B = 0.04, the corner of the XM430."""
    loop = Loop(*MX_64, 0.04, age)
    found = rules([1.5], [1.0])

    def radius(stiffness: float, over: float) -> float:
        return pattern_radius([interval_matrix(loop, stiffness, 6, over * PERIOD)])

    guess = found["weighted"].limit(loop)
    true = [least_unstable(partial(radius, over=over), guess) for over in (1.5, 2.0, 1.0)]
    counted = [found[name].limit(loop) for name in ("nominal", "delay", "weighted")]
    return [f"{age * PERIOD / QUARTERS * 1e3:g}", *(f"{each:.4g}" for each in [*true, *counted])]


def counted_by_schedule(intervals: Sequence[float], weights: Sequence[float]) -> float:
    """Median period that the guard's schedule counts with for such intervals [s]."""
    random = np.random.default_rng(3)
    found = []
    for _ in range(9):
        shown = random.choice(intervals, 4 * WINDOW, p=weights)
        found.append(_counted(shown))
    return float(np.median(found))


def _counted(shown: Iterable[float]) -> float:
    period_ns = round(PERIOD * 1e9)
    rows: list[list[Any]] = [[SimpleNamespace()] for _ in INTERVAL_BINS]
    schedule = GainSchedule(rows, [0], interval_bins_ns(period_ns), 90.0, WINDOW, RUN)
    for each in shown:
        schedule.observe(0, round(float(each) * period_ns), may_raise=False)
    return schedule.interval_ns * 1e-9


def mixture(case: tuple[Mixture, int]) -> list[str]:
    """A row: true limit over what each rule allows, least and median over random servos."""
    (name, intervals, weights), servos = case
    random = np.random.default_rng(11)
    found = rules(intervals, weights)
    scheduled = counted_by_schedule(intervals, weights)
    found["schedule"] = Rule(scheduled)
    ratios: dict[str, list[float]] = {key: [] for key in found}
    for _ in range(servos):
        loop = random_loop(random, scheduled)
        guess = found["schedule"].limit(loop)
        true = mean_square_limit(loop, intervals, weights, guess)
        for key, rule in found.items():
            ratios[key].append(min(true, 4 * guess) / max(rule.limit(loop), 1e-9))
    cells = [_least_and_median(each) for each in ratios.values()]
    return [name, *cells[:-1], f"{scheduled * 1e3:g} ms", cells[-1]]


def _least_and_median(values: Sequence[float]) -> str:
    return f"{min(values):.2f}, {float(np.median(values)):.2f}"


def _growth(loop: Loop, pattern: Sequence[int], share: float) -> float:
    """Growth per repetition at a share of what the schedule allows; 0 where that is nothing."""
    repeats = 4 * WINDOW * QUARTERS // sum(pattern) + 1
    counted = _counted(np.tile(np.array(pattern) / QUARTERS, repeats))
    delay = loop.age * PERIOD / QUARTERS
    cap = CAP if counted <= PERIOD else CAP * IRREGULAR_CAP
    ceiling = cap * float(max_virtual_damping(loop.inertia, loop.damping, counted, delay))
    capped = Loop(loop.inertia, loop.damping, min(loop.virtual, ceiling), loop.age)
    stiffness = share * Rule(counted).limit(capped)
    matrices = [interval_matrix(capped, stiffness, d, d * PERIOD / QUARTERS) for d in pattern]
    return pattern_radius(matrices)


def patterns(count: int) -> list[list[str]]:
    """Rows of repeated patterns: random ones, and a search for those that grow most."""
    random = np.random.default_rng(5)
    tried: list[tuple[float, Loop, list[int]]] = []
    unstable = 0
    for _ in range(count):
        loop = random_loop(random, PERIOD)
        pattern = random.choice(PIECES, int(random.integers(1, 9))).tolist()
        tried.append((_growth(loop, pattern, 1.0), loop, pattern))
        unstable += _growth(loop, pattern, MARGIN) > UNSTABLE
    above = sum(growth > UNSTABLE for growth, *_ in tried)
    drawn = ["at random", f"{count}", f"{above}", f"{unstable}"]
    best = sorted(tried, key=lambda each: -each[0])[:10]
    steps, above, unstable = count // 2, 0, 0
    for _ in range(steps):
        _, loop, pattern = best[int(random.integers(len(best)))]
        loop, pattern = _changed(loop, pattern, random)
        growth = _growth(loop, pattern, 1.0)
        above += growth > UNSTABLE
        unstable += _growth(loop, pattern, MARGIN) > UNSTABLE
        best = sorted([*best, (growth, loop, pattern)], key=lambda each: -each[0])[:10]
    return [drawn, ["by search", f"{steps}", f"{above}", f"{unstable}"]]


def _changed(
    loop: Loop, pattern: Sequence[int], random: np.random.Generator
) -> tuple[Loop, list[int]]:
    """A servo and a pattern nearby, the servo within the range of the random ones."""
    changed = list(pattern)
    at, piece = int(random.integers(len(changed))), int(random.choice(PIECES))
    if random.random() < 0.5 and len(changed) < 12:
        changed.insert(at, piece)
    elif len(changed) > 1 and random.random() < 0.4:
        del changed[at]
    else:
        changed[at] = piece
    scale = 10 ** random.normal(0, 0.15, 3)
    inertia = float(np.clip(loop.inertia * scale[0], *INERTIAS))
    rate = float(np.clip(loop.damping / loop.inertia * scale[1], *RATES))
    return Loop(inertia, rate * inertia, loop.virtual * float(scale[2]), loop.age), changed


def _lossy_radius(loop: Loop, weights: Sequence[float], stiffness: float) -> float:
    """Mean square growth where as many readings in a row are lost as the weights say."""
    matrices = [
        interval_matrix(loop, stiffness, QUARTERS * (n + 1), (n + 1) * PERIOD, QUARTERS * n)
        for n in range(len(weights))
    ]
    return mean_square_radius(matrices, weights)


def losses(case: tuple[float, int]) -> list[str]:
    """A row of lost readings: x is held and v is 0 in that tick."""
    share, servos = case
    runs = list(range(8))
    weights = np.array([(1 - share) * share**n for n in runs])
    weights /= weights.sum()
    later = next(n for n in runs if share ** (n + 1) <= 0.1)
    scheduled = counted_by_schedule([n + 1 for n in runs], weights.tolist())
    random = np.random.default_rng(13)
    ratios: list[list[float]] = [[], []]
    for _ in range(servos):
        drawn = random_loop(random, PERIOD)
        for period, found in zip((PERIOD, scheduled), ratios, strict=True):
            rule = Rule(period, later * PERIOD)
            delay = drawn.age * PERIOD / QUARTERS + rule.more_delay
            cap = CAP if period <= PERIOD else CAP * IRREGULAR_CAP
            most = cap * max_virtual_damping(drawn.inertia, drawn.damping, period, delay)
            loop = replace(drawn, virtual=min(drawn.virtual, float(most)))
            guess = rule.limit(loop)
            true = least_unstable(partial(_lossy_radius, loop, weights.tolist()), guess)
            found.append(min(true, 4 * guess) / guess)
    alone, both = map(_least_and_median, ratios)
    return [f"{share:.0%}", alone, f"{scheduled * 1e3:g} ms", both]


STUDY = Study(
    "evidence/interval-check.md",
    (
        Part(
            "slow_tick",
            lambda _: (0, 1, 4),
            slow_tick,
            table_of(
                "age [ms]|true, v over 1.5 ms|true, v over 2 ms|true, v over 1 ms|counted: 1 ms"
                "|delay alone|1.5 ms"
            ),
        ),
        Part(
            "mixtures",
            lambda given: [(each, given.servos) for each in MIXTURES],
            mixture,
            table_of(
                "intervals [periods]|nominal|mean|delay alone|weighted|the schedule counts|schedule"
            ),
            case_s=5.0,
        ),
        Part(
            "patterns",
            lambda given: [given.patterns],
            patterns,
            lambda found: table(
                ["patterns", "tried", "unstable at the counted limit", "unstable at 0.8 of it"],
                *(row for _, rows in found for row in rows),
            ),
            case_s=40.0,
        ),
        Part(
            "losses",
            lambda given: [(share, given.servos) for share in (0.01, 0.02, 0.05, 0.1, 0.2, 0.3)],
            losses,
            table_of("lost|with the age alone|the schedule counts|with age and schedule"),
            case_s=5.0,
        ),
    ),
    (
        Option("servos", 60, "random servos for each mixture of intervals"),
        Option("patterns", 2000, "random patterns of intervals"),
    ),
    everywhere=True,
)
