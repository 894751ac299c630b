"""Compares the limit that backlash sets with simulations of walls on servos with backlash.

    scripts/study backlash_check [--servos N] [--seed S] [--quick]

Random servos with friction and backlash on two-sided walls. The true limit is the least stiffness
at which a kick of .01, .03, .1 or .3 rad ends in an oscillation of more than four encoder counts.
Takes some minutes.
"""

import math
from typing import NamedTuple

import numpy as np

from haptic_wall.controller.theory import critical_stiffness, max_virtual_damping
from haptic_wall.controller.theory.backlash import backlash_limit
from haptic_wall.hw.settings import TrueServo
from scripts.kicked_walls import kicked, least_bad
from scripts.study import Found, Option, Part, Study, table
from scripts.trials.truth import COUNT

PERIOD = 1e-3
COUNTS = 4
KICKS = (0.01, 0.03, 0.1, 0.3)
CYCLES = 60
SHARES = (0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.15, 1.3)
"""Stiffnesses that are tried, over the exact limit; halved three times between two of them"""
SERVOS = ((0.011951, 0.011692, 0.09039), (0.0018142, 0.0036617, 0.012833))
"""Inertia, viscous and Coulomb friction: published fits of an MX-64 and an XL330"""


class Outcome(NamedTuple):
    """One servo; both limits as shares of the exact one."""

    predicted: float
    true: float
    """The last of ``SHARES`` if nothing sustained itself"""
    width_counts: float
    of_ceiling: float
    """Virtual damping over its ceiling"""


def sustains(true: TrueServo, stiffness: float, virtual_damping: float) -> bool:
    """Whether some kick ends in an oscillation of more than four counts."""
    count = math.ceil(CYCLES * 2 * math.pi * math.sqrt(true.inertia / stiffness) / PERIOD)
    for kick in KICKS:
        positions = kicked(true, stiffness, virtual_damping, kick, count, furthest=5.0)
        if positions is None or np.ptp(positions[-count // 10 :]) > 2 * COUNTS * COUNT:
            return True
    return False


def outcome(case: tuple[int, int]) -> Outcome:
    """Draw a servo, and find both limits."""
    random = np.random.default_rng(case)
    m, b, c = SERVOS[int(random.integers(2))]
    c *= float(random.uniform(0.5, 2.0))
    width = math.radians(float(random.uniform(0.05, 0.3)))
    delay = float(random.uniform(0.5, 3.0)) * PERIOD
    of_ceiling = float(0.25 * random.random() * random.random())
    virtual = of_ceiling * float(max_virtual_damping(m, b, PERIOD, delay))
    exact = float(critical_stiffness(m, b, virtual, PERIOD, delay))
    predicted = float(backlash_limit(m, b, c, virtual, PERIOD, delay, width, COUNTS * COUNT))
    true = TrueServo(
        inertia=m,
        damping=b,
        coulomb=c,
        backlash=width,
        counts_per_rev=0,
        delay=delay,
        torque_limit=1e3,
    )
    high = least_bad(lambda share: sustains(true, share * exact, virtual), SHARES, halvings=3)
    return Outcome(min(predicted / exact, SHARES[-1]), high, width / COUNT, of_ceiling)


def lines(found: Found[tuple[int, int], Outcome]) -> list[str]:
    """How far apart both are, where backlash binds and where it does not."""
    rows = [row for _, row in found]
    binds = np.array([min(row.predicted, row.true) < 0.95 for row in rows])
    ratio = np.array([min(row.true, 1.0) / min(row.predicted, 1.0) for row in rows])
    cells = []
    for name, chosen in (("backlash binds", binds), ("the exact limit binds", ~binds)):
        some = ratio[chosen]
        if some.size:
            spread = (f"{x:.2f}" for x in (some.min(), np.median(some), some.max()))
            cells.append((name, some.size, *spread, int(np.sum(some < 0.8))))
    head = ("servos where", "number", "least", "median", "most", "below the margin of 0.8")
    return [
        *table(head, *cells),
        "",
        "True over predicted limit; of both what exceeds the exact limit counts as that.",
    ]


STUDY = Study(
    "evidence/backlash-check.md",
    (
        Part(
            "servos",
            lambda given: [(given.seed, i) for i in range(given.servos)],
            outcome,
            lines,
            case_s=6.0,
        ),
    ),
    (
        Option("servos", 200, "random servos", quick=6),
        Option("seed", 1, "seed of the servos"),
    ),
)
