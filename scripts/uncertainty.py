"""Computes the tables of docs/uncertainty.md: what unknowns cost, and the guard's corner.

    scripts/uncertainty [--beliefs N] [--out FILE]

The same on every machine. A table stands between ``<!-- computed: NAME -->`` and ``<!-- end -->``;
what is around it stays.
"""

import re
import sys
from collections.abc import Callable, Iterator

import numpy as np

from haptic_wall.controller.theory import critical_stiffness, linear_limit, max_virtual_damping
from haptic_wall.controller.theory.guaranteed import cost_of_each_unknown, guaranteed_limit
from haptic_wall.controller.theory.ranges import Member, Ranges
from scripts.whole_program import ROOT, page_options, say_time

PAGE = ROOT / "docs" / "uncertainty.md"
PART = re.compile(r"(<!-- computed: (\w+) -->\n)(.*?)(<!-- end -->)", re.S)
MX_64 = Ranges((0.008, 0.016), (0.008, 0.017), (1e-3, 3e-3), (0.8, 1.2))
NOMINAL = Member(0.011951, 0.011692, 2e-3, 1.0)
PERIOD = 1e-3
BELIEF_S = 0.15
"""Time for one belief [s]"""


def costs() -> Iterator[str]:
    """Yield the table of what each unknown costs an MX-64."""
    yield "| B | everything known | guaranteed | inertia | damping | delay | torque gain | all |"
    yield "| --- | --- | --- | --- | --- | --- | --- | --- |"
    for virtual in (0.0, 0.02, 0.1, 0.5, 1.0):
        found = cost_of_each_unknown(MX_64, NOMINAL, virtual, PERIOD)
        lost = [each.lost for each in found.unknowns]
        shares = " | ".join(f"{100 * share:.1f} %" for share in [*lost, found.lost])
        yield f"| {virtual:g} | {found.known:.4g} | {found.limit.stiffness:.4g} | {shares} |"


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
    ceiling = max_virtual_damping(inertia, damping, period, longest * period, samples) / gain[1]
    virtual = random.choice(
        [0, -0.7 * damping / gain[1] * random.random(), 0.7 * ceiling * random.random()]
    )
    ranges = Ranges(wide(inertia), wide(damping), (shortest * period, longest * period), gain)
    return ranges, float(virtual), period, samples


def corner(count: int) -> Iterator[str]:
    """How the guard's corner compares with the least limit of a member, over random beliefs."""
    random = np.random.default_rng(7)
    exact, guard, gap = (np.zeros(count) for _ in range(3))
    for i in range(count):
        ranges, virtual, period, samples = belief(random)
        gain = ranges.torque_gain[1]
        worst = ranges.damping[0], gain * virtual, period, ranges.delay[1], samples
        found = guaranteed_limit(ranges, virtual, period, samples)
        at_corner = critical_stiffness(ranges.inertia[0], *worst) / gain
        exact[i] = at_corner / found.upper
        guard[i] = min(at_corner, linear_limit(*worst) / gain) / found.upper
        gap[i] = 1 - found.stiffness / found.upper
    yield "| limit at the corner | at most, over the least limit of a member | above it in |"
    yield "| --- | --- | --- |"
    for name, ratio in (("`exact`", exact), ("the smaller of `linear` and `exact`", guard)):
        above = np.count_nonzero(ratio > 1 + 1e-9)
        yield f"| {name} | {ratio.max():.5g} | {above} of {count} |"
    yield ""
    yield f"The least limit is proved to within {100 * gap.max():.1f} %."


def renewed(text: str, tables: dict[str, Callable[[], Iterator[str]]]) -> str:
    """The page with some of its tables computed anew."""

    def part(found: re.Match[str]) -> str:
        begin, name, old, end = found.groups()
        return f"{begin}{_lines(tables[name]()) if name in tables else old}{end}"

    return PART.sub(part, text)


def _lines(table: Iterator[str]) -> str:
    return "".join(f"{line}\n" for line in table)


def main() -> None:
    """Compute, write the page."""
    parser = page_options("uncertainty", __doc__, PAGE.name)
    parser.add_argument("--beliefs", type=int, default=200, help="random ones, for the corner")
    wanted = parser.parse_args()
    say_time(3 + BELIEF_S * wanted.beliefs)
    tables = {"costs": costs, "corner": lambda: corner(wanted.beliefs)}
    text = renewed(PAGE.read_text(), tables)
    sys.stdout.write("".join(found[0] + "\n" for found in PART.finditer(text)))
    wanted.out.write_text(text)


if __name__ == "__main__":
    main()
