"""Compares predicted limit cycles with simulated ones.

    scripts/study limit_cycle_check [--walls N]

The tables of docs/evidence/limit-cycle-check.md; the draws are the same on every machine.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.stats import binomtest

from haptic_wall.controller.theory import critical_stiffness, max_virtual_damping
from haptic_wall.controller.theory.cycles import (
    Backlash,
    LimitCycle,
    Quantisation,
    Saturation,
    limit_cycles,
)
from haptic_wall.controller.theory.exact import critical_point
from scripts.nonlinear_walls import PERIOD, Array, Motion, Walls
from scripts.study import Option, Part, Study, table, table_of

INERTIA = 0.01
"""[kg·m²]; only its ratio to the damping matters"""
DELTA, DELAY = (5e-4, 2e-2), 5.0
"""Of random servos: b T / m, and the longest delay [periods]"""
BLOCK = 500
"""Motions simulated together"""
CHUNK, LEAST, MOST = 8.0, 20_000, 500_000
"""Oscillations between two looks; periods simulated at least and at most"""
STEADY = 2e-4
"""Change of the amplitude from look to look that counts as none"""
DEAD, GROWN = 0.02, 1e3
"""Amplitudes, in predicted ones, that count as rest and as growth without end"""
SPREAD_DELTA, SPREAD_STARTS = 0.002, np.geomspace(0.05, 30.0, 40)


class Setting(NamedTuple):
    """A wall, dimensionless."""

    delta: float
    """b T / m"""
    delay: float
    """[periods]"""
    damper: float
    """B over its ceiling"""
    share: float
    """K over the critical stiffness"""


@dataclass(frozen=True, slots=True)
class Case:
    """An effect, and the walls on which it is tried."""

    effect: Saturation | Quantisation | Backlash
    damper: float
    """Greatest virtual damping, over its ceiling"""
    shares: tuple[float, float]
    """Stiffness over the critical one, from and to"""
    starts: tuple[float, ...] = (1.0,)
    """Amplitudes of the motion at the start, in predicted ones"""


ANYWHERE, NEAR = (0.1, 1.0, 10.0), (0.7, 1.0, 1.4)
CASES = {
    "saturation": Case(Saturation(1.0), 0.0, (1.05, 3.0), ANYWHERE),
    "saturation, with B": Case(Saturation(1.0), 0.5, (1.05, 3.0), ANYWHERE),
    "backlash": Case(Backlash(1e-3), 0.0, (0.3, 0.97), NEAR),
    "backlash, with B": Case(Backlash(1e-3), 0.5, (0.3, 0.97), NEAR),
    "middle of a count, K below the limit": Case(Quantisation(1e-3), 0.0, (0.8, 1.0)),
    "middle of a count, K above it": Case(Quantisation(1e-3), 0.0, (1.0, 1.25)),
    "middle of a count, with B, K below": Case(Quantisation(1e-3), 0.5, (0.5, 1.0)),
    "middle of a count, with B, K above": Case(Quantisation(1e-3), 0.5, (1.0, 1.25)),
    "edge of a count": Case(Quantisation(1e-3, at_edge=True), 0.0, (0.2, 0.95)),
    "edge of a count, with B": Case(Quantisation(1e-3, at_edge=True), 0.5, (0.2, 0.95)),
}

SOFTER = {
    "saturation, with B": Case(Saturation(1.0), 0.5, (0.5, 0.99), (1.5, 5.0, 20.0)),
    "middle of a count": Case(Quantisation(1e-3), 0.0, (0.2, 0.78), (1.0, 3.0, 10.0)),
    "middle of a count, with B": Case(Quantisation(1e-3), 0.5, (0.2, 1.0), (1.0, 3.0, 10.0)),
}
"""The same below the limit, to see what is not predicted; starts in counts, or in limit / K"""


class Settled(NamedTuple):
    """Steady motion, relative to the predicted cycle from which it began."""

    amplitude: float
    """0: it died out; inf: it grew without end; NaN: it had not come to rest when time was up"""
    frequency: float


def drawn(case: Case, count: int, seed: int) -> list[Setting]:
    """Random walls of a case; a fifth of them without delay."""
    random = np.random.default_rng(seed)
    return [
        Setting(
            float(np.exp(random.uniform(*np.log(DELTA)))),
            float(random.uniform(0.0, DELAY) * (random.random() > 0.2)),
            float(random.uniform(0.0, case.damper)),
            float(random.uniform(*case.shares)),
        )
        for _ in range(count)
    ]


def wall(setting: Setting) -> tuple[float, float, float, float, float, float]:
    """m, b, K, B, T and t_d in SI units, as ``limit_cycles`` takes them."""
    m, b, delay = INERTIA, setting.delta * INERTIA / PERIOD, setting.delay * PERIOD
    big_b = setting.damper * float(max_virtual_damping(m, b, PERIOD, delay))
    k = setting.share * float(critical_stiffness(m, b, big_b, PERIOD, delay))
    return m, b, k, big_b, PERIOD, delay


def settled(
    effect: Saturation | Quantisation | Backlash,
    begun: Sequence[tuple[Setting, LimitCycle, float]],
) -> list[Settled]:
    """Simulates motion that begins as a multiple of a predicted cycle until it is steady."""
    order = sorted(range(len(begun)), key=lambda i: begun[i][1].frequency)
    found: list[Settled] = [Settled(math.nan, math.nan)] * len(begun)
    for first in range(0, len(order), BLOCK):
        index = order[first : first + BLOCK]
        for i, one in zip(index, _block(effect, [begun[i] for i in index]), strict=True):
            found[i] = one
    return found


def _block(
    effect: Saturation | Quantisation | Backlash,
    begun: Sequence[tuple[Setting, LimitCycle, float]],
) -> list[Settled]:
    columns = np.array([wall(setting) for setting, _, _ in begun]).T
    m, b, k, big_b, _, delay = columns
    one = np.ones(m.size)
    count = getattr(effect, "step", 0.0)
    walls = Walls(
        *(m, b, k, big_b, delay, getattr(effect, "limit", math.inf) * one, count * one),
        *(0.5 * getattr(effect, "at_edge", False) * one, getattr(effect, "width", 0.0) * one),
    )
    predicted = np.array([cycle.amplitude for _, cycle, _ in begun])
    frequency = np.array([cycle.frequency for _, cycle, _ in begun])
    before = predicted * np.array([start for _, _, start in begun])
    # within half a count of the middle nothing drives the motion
    driven = 0.0 if getattr(effect, "at_edge", False) else 0.49 * count
    rest = np.maximum(DEAD * predicted, driven)
    motion = Motion(walls, before, frequency)
    chunk = int(CHUNK / frequency.min() / PERIOD)
    found = [Settled(math.nan, math.nan)] * len(begun)
    left, done = np.arange(len(begun)), 0
    while left.size and done < MOST:
        with np.errstate(over="ignore", invalid="ignore"):  # what grows without end
            seen = motion.run(chunk)
        done += chunk
        size = 0.5 * np.ptp(seen, axis=0)
        dead, grown = size < rest[left], ~(size < GROWN * predicted[left])
        ended = dead | grown | (np.abs(size - before) < STEADY * size)
        if done < LEAST:
            ended[:] = False
        for i in np.flatnonzero(ended):
            at = left[i]
            amplitude = 0.0 if dead[i] else math.inf if grown[i] else size[i] / predicted[at]
            turning = 0.0 if dead[i] or grown[i] else _frequency(seen[:, i]) / frequency[at]
            found[at] = Settled(float(amplitude), turning)
        motion.keep(np.flatnonzero(~ended))
        left, before = left[~ended], size[~ended]
    return found


def _frequency(seen: Array) -> float:
    """Of a steady oscillation, from its crossings of the middle [Hz]."""
    motion = seen - 0.5 * (seen.max() + seen.min())
    up = np.flatnonzero((motion[1:] > 0) & (motion[:-1] <= 0))
    if up.size < 2:
        return math.nan
    at = up + motion[up] / (motion[up] - motion[up + 1])
    return float((up.size - 1) / (at[-1] - at[0]) / PERIOD)


def worth(case: tuple[str, int]) -> list[str]:
    """A row: how many predicted stable cycles are kept up, and how far off they are."""
    name, count = case
    tried = CASES[name]
    begun = [
        (setting, cycle, start)
        for setting in drawn(tried, count, 1)
        for cycle in limit_cycles(*wall(setting), tried.effect)
        if cycle.stable
        for start in tried.starts
    ]
    found = np.array(settled(tried.effect, begun)).reshape(-1, len(tried.starts), 2)
    dead = (found[:, :, 0] == 0.0).any(axis=1)
    grown = np.isinf(found[:, :, 0]).any(axis=1)
    unsettled = np.isnan(found[:, :, 0]).any(axis=1) & ~dead & ~grown
    lasting = ~dead & ~grown & ~unsettled
    kept, count_kept = found[lasting].reshape(-1, 2), int(lasting.sum())
    lost = [f"{each.sum()}" for each in (dead, grown, unsettled)]
    sure = _sure(count_kept, len(found))
    return [
        *(name, f"{len(found)}", f"{count_kept}", sure, *lost),
        *(_range(kept[:, 0]), _range(kept[:, 1])),
    ]


def missed(case: tuple[str, int]) -> list[str]:
    """A row: walls below their limit that move on although no stable cycle is predicted."""
    name, count = case
    tried = SOFTER[name]
    none = [
        setting
        for setting in drawn(tried, count, 2)
        if not any(cycle.stable for cycle in limit_cycles(*wall(setting), tried.effect))
    ]
    begun = [(each, _kick(each, tried), start) for each in none for start in tried.starts]
    found = np.array(settled(tried.effect, begun)).reshape(-1, len(tried.starts), 2)[:, :, 0]
    going = found[found != 0.0]
    lasting = int((found != 0.0).any(axis=1).sum())
    low, high = tried.shares
    return [
        *(name, f"{low:g} to {high:g}", f"{count}", f"{len(none)}", f"{lasting}"),
        *(_sure(lasting, len(none)), _range(going[np.isfinite(going)])),
    ]


def _kick(setting: Setting, case: Case) -> LimitCycle:
    """Motion as large as a count, or as saturates, at the frequency of the boundary."""
    m, b, k, big_b, period, delay = wall(setting)
    frequency = float(critical_point(m, b, big_b, period, delay).frequency)
    effect = case.effect
    size = effect.limit / k if isinstance(effect, Saturation) else 1e-3
    return LimitCycle(size, frequency, stable=False)


def spread(_all: None) -> list[list[str]]:
    """Rows, one for each wall: where saturated motion settles, by how it begins."""
    effect = Saturation(1.0)
    settings = [
        Setting(SPREAD_DELTA, 0.0, damper, share)
        for damper in (0.0, 0.05, 0.2, 0.5)
        for share in (1.1, 1.5, 3.0)
    ]
    cycles = [limit_cycles(*wall(setting), effect)[-1] for setting in settings]
    begun = [
        (setting, cycle, float(start))
        for setting, cycle in zip(settings, cycles, strict=True)
        for start in SPREAD_STARTS
    ]
    found = np.array(settled(effect, begun)).reshape(len(settings), SPREAD_STARTS.size, 2)
    rows = []
    for setting, cycle, ends in zip(settings, cycles, found, strict=True):
        samples = np.round(1.0 / (ends[:, 1] * cycle.frequency * PERIOD))
        rows.append(
            [
                *(f"{setting.damper:g}", f"{setting.share:g}", f"{np.unique(samples).size}"),
                f"{samples.min():g}, {samples.max():g}",
                *(_range(ends[:, 0]), _range(ends[:, 1])),
            ]
        )
    return rows


def _sure(count: int, of: int) -> str:
    """Exact bounds of a rate, 95 %; of none, nothing."""
    if not of:
        return ""
    bounds = binomtest(count, of).proportion_ci(method="exact")
    return f"{bounds.low:.0%} to {bounds.high:.0%}"


def _range(values: Array) -> str:
    """Least, median and greatest; of none, nothing."""
    if not values.size:
        return ""
    return ", ".join(f"{value:.2f}" for value in np.quantile(values, [0.0, 0.5, 1.0]))


STUDY = Study(
    "evidence/limit-cycle-check.md",
    (
        Part(
            "worth",
            lambda given: [(name, given.walls) for name in CASES],
            worth,
            table_of(
                "effect|predicted stable|kept up|95 % sure|die out|grow without end|unsettled"
                "|amplitude over predicted|frequency over predicted"
            ),
            case_s=12.0,
        ),
        Part(
            "missed",
            lambda given: [(name, given.walls) for name in SOFTER],
            missed,
            table_of(
                "effect|K over the limit|walls|none predicted|move on|95 % sure|amplitude [counts]"
            ),
            case_s=12.0,
        ),
        Part(
            "spread",
            lambda _: [None],
            spread,
            lambda found: table(
                [
                    *("B over its ceiling", "K over the limit", "different periods"),
                    *("from, to [samples]", "amplitude over predicted", "frequency over predicted"),
                ],
                *(row for _, rows in found for row in rows),
            ),
            case_s=60.0,
        ),
    ),
    (Option("walls", 100, "random walls for each effect"),),
    everywhere=True,
)
