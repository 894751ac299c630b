"""Checks that a current loop of first order may be counted as a delay of its time constant.

    scripts/study current_loop_check [--walls N] [--contacts N] [--searches N] [--seed S]

Random rigid servos whose torque lags by the first order: the exact limit, the damping ceiling and
contacts at the one-sided limit, beside those of a delay of the same time. Then an optimiser looks
for the servo on which the delay is the least safe. Takes some minutes.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.optimize import differential_evolution

from haptic_wall.controller.theory import critical_stiffness, max_virtual_damping, one_sided_limit
from haptic_wall.controller.theory.chain import Chain
from haptic_wall.controller.theory.chain_contact import returned
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.controller.theory.flexible import chain_boundary, chain_ceiling
from scripts.study import Found, Given, Option, Part, Study, table

PERIOD = 1e-3
PHASES = 17
DAMPING = (-4.0, 0.0)
"""Decimal exponents of b T / m"""
LAG = (-1.5, 0.7)
"""Decimal exponents of the current loop's time constant, in periods"""
LONGEST = 8.0
"""Delay beside the lag [periods]"""
SHARES = (0.0, 0.1, 0.3, 0.5, 0.7)
"""Of the ceiling, where a class of virtual dampings begins; each is a tenth wide"""


class Servos(NamedTuple):
    """Rigid servos with a lagging torque, each with a virtual damping; in units of the period."""

    delta: FloatArray
    late: FloatArray
    lag: FloatArray
    share: FloatArray
    """Share of the ceiling of a delay of the same time"""

    @classmethod
    def of(cls, unit: FloatArray, *, whole: bool = True) -> "Servos":
        """From four numbers from 0 to 1 for each servo; every other delay is whole if asked."""

        def between(ends: tuple[float, float], where: FloatArray) -> FloatArray:
            found: FloatArray = 10 ** (ends[0] + (ends[1] - ends[0]) * where)
            return found

        late = LONGEST * unit[:, 1]
        if whole:
            late = np.where(unit[:, 1] * 1e3 % 1 < 0.5, np.round(late), late)
        return cls(between(DAMPING, unit[:, 0]), late, between(LAG, unit[:, 2]), unit[:, 3])

    def chain(self, repeats: int = 1) -> Chain:
        """Chains of one mass of 1 kg·m², ``repeats`` times each."""
        ones = np.ones((self.delta.size * repeats, 1))
        none = np.empty((len(ones), 0))
        damping = np.repeat(self.delta / PERIOD, repeats)[:, None]
        bandwidth = np.repeat(1 / (2 * math.pi * self.lag * PERIOD), repeats)
        return Chain(ones, damping, none, none, bandwidth)


def ratios(servos: Servos) -> tuple[FloatArray, FloatArray]:
    """Ceilings and critical stiffnesses of the lag, over those of the delay."""
    b, delay = servos.delta / PERIOD, servos.late * PERIOD
    counted = delay + servos.lag * PERIOD
    shape = servos.delta.shape
    ceiling = max_virtual_damping(1.0, b, PERIOD, counted)
    true_ceiling = chain_ceiling(servos.chain(), shape, PERIOD, delay)
    damping = servos.share * ceiling
    true = chain_boundary(servos.chain(), shape, damping, PERIOD, delay).stiffness
    return true_ceiling / ceiling, true / critical_stiffness(1.0, b, damping, PERIOD, counted)


def greatest_return(servos: Servos) -> FloatArray:
    """Greatest return over the phase of entry, at the one-sided limit of the delay."""
    phase = np.linspace(1e-9, 1.0, PHASES)
    found = []
    for i in range(servos.delta.size):
        one = Servos(*(values[i : i + 1] for values in servos))
        b, delay = one.delta / PERIOD, float(one.late[0]) * PERIOD
        counted = delay + one.lag * PERIOD
        damping = one.share * max_virtual_damping(1.0, b, PERIOD, counted)
        stiffness = one_sided_limit(1.0, b, damping, PERIOD, counted)
        every = np.ones(PHASES)
        speeds = returned(
            one.chain(PHASES), PERIOD, delay, stiffness * every, damping * every, phase
        )
        found.append(float(np.max(speeds)) if stiffness[0] > 0 else math.nan)
    return np.array(found)


def walls(given: Given) -> list[tuple[int, int]]:
    """Seed and number of the random servos, in parts of a thousand."""
    return [(given.seed + i, 1000) for i in range(math.ceil(given.walls / 1000))]


def wall_rows(case: tuple[int, int]) -> list[list[float]]:
    """Share of the ceiling, ratio of the ceilings and of the stiffnesses, of each servo."""
    seed, count = case
    servos = Servos.of(np.random.default_rng(seed).random((count, 4)))
    servos = servos._replace(share=0.999 * servos.share)
    ceiling, stiffness = ratios(servos)
    found: list[list[float]] = np.stack([servos.share, ceiling, stiffness], axis=1).tolist()
    return found


def wall_lines(found: Found[tuple[int, int], list[list[float]]]) -> list[str]:
    """A row for each class of virtual dampings, and the ceiling."""
    rows = np.array([row for _, part in found for row in part])
    lines: list[list[str]] = []
    for low in SHARES:
        chosen = rows[(rows[:, 0] >= low) & (rows[:, 0] < low + 0.1)]
        lines.append([f"K at {low:g} to {low + 0.1:g} of the ceiling", *_spread(chosen[:, 2])])
    lines.append(["ceiling of B", *_spread(rows[:, 1])])
    head = ("limit of the lag over that of the delay", "servos", "least", "median", "9 in 10 below")
    return [*table(head, *lines), "", f"Below 1 in {int(np.sum(rows[:, 1:3] < 1))} of these."]


def _spread(values: FloatArray) -> list[str]:
    low, middle, high = values.min(), np.median(values), np.percentile(values, 90)
    return [str(values.size), f"{low:.5f}", f"{middle:.4f}", f"{high:.3g}"]


def contacts(given: Given) -> list[tuple[int, int]]:
    """Seed and number of the random contacts, in parts of ten."""
    return [(given.seed + 1000 + i, 10) for i in range(math.ceil(given.contacts / 10))]


def contact_rows(case: tuple[int, int]) -> list[float]:
    """Greatest return of each servo."""
    seed, count = case
    unit = np.random.default_rng(seed).random((count, 4)) * (1.0, 1.0, 1.0, 0.7)
    found: list[float] = greatest_return(Servos.of(unit)).tolist()
    return found


def contact_lines(found: Found[tuple[int, int], list[float]]) -> list[str]:
    """One row."""
    values = np.array([value for _, part in found for value in part])
    values = values[np.isfinite(values)]
    head = ("contacts at the one-sided limit of the delay", "greatest return", "median", "above 1")
    row = (values.size, f"{values.max():.5f}", f"{np.median(values):.4f}", np.sum(values > 1))
    return table(head, row)


def searches(given: Given) -> list[tuple[str, int]]:
    """Return the searched quantities, each with a seed."""
    wanted = ("stiffness", "ceiling", "contact")
    return [(what, given.seed + i) for what in wanted for i in range(given.searches)]


def searched(case: tuple[str, int]) -> list[float]:
    """Return the worst result (least ratio, or greatest return) and the servo's numbers."""
    what, seed = case

    def cost(unit: FloatArray) -> FloatArray:
        servos = Servos.of(np.atleast_2d(unit.T), whole=False)
        if what == "contact":
            returns = greatest_return(servos._replace(share=0.7 * servos.share))
            return -np.nan_to_num(returns, nan=0.0)
        servos = servos._replace(share=0.999 * servos.share)
        return ratios(servos)[0 if what == "ceiling" else 1]

    rounds = 12 if what == "contact" else 60
    best = differential_evolution(
        cost,
        [(0.0, 1.0)] * 4,
        popsize=8 if what == "contact" else 100,
        maxiter=rounds,
        rng=seed,
        polish=False,
        vectorized=True,
        updating="deferred",
    )
    one = Servos.of(best.x[None], whole=False)
    return [abs(float(best.fun)), *(float(values[0]) for values in one)]


def search_lines(found: Found[tuple[str, int], list[float]]) -> list[str]:
    """The worst of each kind."""
    names = {
        "stiffness": "least exact limit, lag over delay",
        "ceiling": "least ceiling, lag over delay",
        "contact": "greatest return at the one-sided limit of the delay",
    }
    lines = []
    for what, name in names.items():
        rows = [row for (kind, _), row in found if kind == what]
        worst = (max if what == "contact" else min)(rows)
        value, delta, late, lag, share = worst
        lines.append(
            (name, f"{value:.6f}", f"{delta:.2g}", f"{late:.3g}", f"{lag:.2g}", f"{share:.2g}")
        )
    head = ("searched for", "found", "b T / m", "delay / T", "lag / T", "B over 0.7 or 1 ceiling")
    return table(head, *lines)


STUDY = Study(
    "evidence/current-loop-check.md",
    (
        Part("walls", walls, wall_rows, wall_lines, case_s=0.6),
        Part("contacts", contacts, contact_rows, contact_lines, case_s=0.5),
        Part("searches", searches, searched, search_lines, case_s=20.0),
    ),
    (
        Option("walls", 20_000, "random servos whose limits are compared", quick=1000),
        Option("contacts", 2000, "random servos whose contacts are simulated", quick=20),
        Option("searches", 4, "searches for each of three figures", quick=1),
        Option("seed", 1, "first seed"),
    ),
)
