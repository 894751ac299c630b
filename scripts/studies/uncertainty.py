"""Computes the cost of unknown values, and compares the guard's corner with the least limit.

    scripts/study uncertainty [--beliefs N]

The tables of docs/uncertainty.md; the same on every machine.
"""

import numpy as np

from haptic_wall.controller.theory import critical_stiffness, linear_limit, max_virtual_damping
from haptic_wall.controller.theory.guaranteed import cost_of_each_unknown, guaranteed_limit
from haptic_wall.controller.theory.ranges import Member, Ranges
from scripts.study import Found, Given, Option, Part, Study, table

MX_64 = Ranges((0.008, 0.016), (0.008, 0.017), (1e-3, 3e-3), (0.8, 1.2))
NOMINAL = Member(0.011951, 0.011692, 2e-3, 1.0)
PERIOD = 1e-3
SEED = 7


def cost(virtual: float) -> tuple[float, ...]:
    """Stiffness allowed to an MX-64 if all is known, at worst, and the loss by each unknown."""
    found = cost_of_each_unknown(MX_64, NOMINAL, virtual, PERIOD)
    lost = [each.lost for each in found.unknowns]
    return found.known, found.limit.stiffness, *lost, found.lost


def cells(row: tuple[float, ...]) -> list[str]:
    """The row as the page has it, behind B."""
    known, sure, *lost = row
    return [f"{known:.4g}", f"{sure:.4g}", *(f"{100 * each:.1f} %" for each in lost)]


def costs(found: Found[float, tuple[float, ...]]) -> list[str]:
    """The table of what each unknown costs."""
    unknowns = ("inertia", "damping", "delay", "torque gain", "all")
    rows = [[f"{virtual:g}", *cells(row)] for virtual, row in found]
    return table(["B", "everything known", "guaranteed", *unknowns], *rows)


def belief(random: np.random.Generator) -> tuple[Ranges, float, float, int]:
    """A random belief, up to four times wide in each; virtual damping, period, N."""

    def wide(low: float) -> tuple[float, float]:
        return low, low * 10 ** random.uniform(0, random.choice([0, 0.1, 0.3, 0.6]))

    period = 10 ** random.uniform(-3.5, -2)
    inertia = 10 ** random.uniform(-3.5, 0)
    damping = 10 ** random.uniform(-4, -0.5) * inertia / period
    shortest = random.choice([0, random.uniform(0, 9)])
    longest = shortest + random.choice([0, 1, random.uniform(0, 4)])
    samples = int(random.choice([1, 1, 1, 2, 3, 8]))
    gain = wide(0.8)
    most = float(max_virtual_damping(inertia, damping, period, longest * period, samples))
    ceiling = most / gain[1]
    virtual = random.choice(
        [0.0, -0.7 * damping / gain[1] * random.random(), 0.7 * ceiling * random.random()]
    )
    ranges = Ranges(wide(inertia), wide(damping), (shortest * period, longest * period), gain)
    return ranges, float(virtual), period, samples


def drawn(given: Given) -> list[tuple[Ranges, float, float, int]]:
    """Random beliefs."""
    random = np.random.default_rng(SEED)
    return [belief(random) for _ in range(given.beliefs)]


def at_corner(case: tuple[Ranges, float, float, int]) -> tuple[float, float, float]:
    """``exact`` and the smaller limit at the corner, over a member's least; the unproved part."""
    ranges, virtual, period, samples = case
    gain = ranges.torque_gain[1]
    worst = ranges.damping[0], gain * virtual, period, ranges.delay[1], samples
    found = guaranteed_limit(ranges, virtual, period, samples)
    exact = float(critical_stiffness(ranges.inertia[0], *worst)) / gain
    guard = min(exact, float(linear_limit(*worst)) / gain)
    return exact / found.upper, guard / found.upper, 1 - found.stiffness / found.upper


def corner(
    found: Found[tuple[Ranges, float, float, int], tuple[float, float, float]],
) -> list[str]:
    """How the guard's corner compares with the least limit of a member."""
    exact, guard, gap = np.array([row for _, row in found]).T
    rows = [
        [name, f"{ratio.max():.5g}", f"{np.count_nonzero(ratio > 1 + 1e-9)} of {len(found)}"]
        for name, ratio in (("`exact`", exact), ("the smaller of `linear` and `exact`", guard))
    ]
    return [
        *table(
            ["limit at the corner", "at most, over the least limit of a member", "above it in"],
            *rows,
        ),
        "",
        f"The least limit is proved to within {100 * gap.max():.1f} %.",
    ]


STUDY = Study(
    "uncertainty.md",
    (
        Part("costs", lambda _: (0.0, 0.02, 0.1, 0.5, 1.0), cost, costs),
        Part("corner", drawn, at_corner, corner, case_s=0.15),
    ),
    (Option("beliefs", 200, "random beliefs for the corner"),),
    everywhere=True,
)
