"""Searches laws, servos and starts for a motion that lasts on a law that the guard commands.

scripts/study laws_check [--blocks N] [--rounds N]
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from haptic_wall.controller.guard.belief import Belief, Bounded
from haptic_wall.controller.guard.guard import GuardSettings, Request, Situation, decide
from haptic_wall.controller.laws.wall import Side
from haptic_wall.controller.theory import critical_stiffness, max_virtual_damping
from haptic_wall.controller.theory.flexible import flexible_boundary
from haptic_wall.hw.settings import EncoderSide
from scripts.sampled_laws import Array, Found, Kind, Law, Loads, Servos, lasting, moved
from scripts.study import Given, Option, Part, Study, table
from scripts.trials.rates import upper_bound

PERIOD = 1e-3
"""[s]"""
INERTIA = 0.01
"""Lowest believed [kg·m²]; only its ratio to the other numbers matters"""
DELTA = 1e-3, 5e-2
"""Of the lowest believed servo: b T / m"""
LAWS = 250
"""Laws in a block"""
STARTS = 8
"""Starts of each"""
PERIODS = 6000
"""Simulated for each start"""
KNOTS = 12
"""Of a table of elongations"""
LASTS = 0.97
"""A motion lasts where its energy falls by less than to this, from the second quarter to the last
"""
MULTIPLES = 1.0, 1.25, 1.5, 2.0, 3.0, 5.0
"""Of the commanded stiffness, tried at the belief's worst corner"""
CORNER_LAWS = 60
FLEXIBLE_LAWS = 100
"""Laws in a block on servos of two masses"""
KINDS: dict[str, tuple[Kind, bool]] = {
    "periodic": ("periodic", True),
    "profile": ("bounded", True),
    "profile that only rises": ("bounded", False),
    "stops": ("stops", False),
    "friction": ("friction", False),
    "texture": ("texture", True),
}
"""Kind of the simulation, and whether the torque falls somewhere"""
SHARES = 0.8, 0.9, 1.0, 1.05
"""Of the exact limit, for the search"""
PEOPLE, SEARCH_PERIODS = 40, 3000


@dataclass(frozen=True, slots=True)
class Block:
    """Laws of one kind."""

    kind: str
    seed: int
    flexible: bool = False
    """On servos of two masses"""

    @property
    def name(self) -> str:
        """Return the row of the table that it belongs to."""
        return f"{self.kind}, two masses" if self.flexible else self.kind


class Row(NamedTuple):
    """Of a block."""

    lasting: int
    """Laws with a motion that lasts"""
    longest: float
    """Largest fraction of the energy that is left"""
    back: float
    """Largest energy of the servo over that of the start; of stops alone"""
    timid: tuple[float, ...]
    """Commanded stiffness over the least multiple of it that the worst corner does not bear"""


def drawn(given: Given) -> list[Block]:
    """Return the blocks."""
    counts = {False: given.blocks, True: given.flexible}
    return [
        Block(kind, seed, flexible)
        for flexible, count in counts.items()
        for kind in KINDS
        for seed in range(count)
    ]


def tables(random: np.random.Generator, kind: Kind, falls: bool, count: int) -> Array | None:
    """Return random elongations of slope one; None: the kind has no table."""
    if kind not in ("periodic", "bounded"):
        return None
    slopes = random.uniform(-1.0 if falls else 0.0, 1.0, (count, KNOTS))
    steep = random.random((count, 1)) < 0.5
    return shaped(np.where(steep, np.sign(slopes) * np.abs(slopes) ** 0.2, slopes), kind, falls)


def shaped(slopes: Array, kind: Kind, falls: bool) -> Array:
    """Return the elongations with these slopes, scaled to a steepest one of 1."""
    if kind == "periodic":
        slopes = slopes - slopes.mean(1, keepdims=True)
    elif falls:
        # A torque of some size pushes back from beyond both ends.
        slopes = slopes + np.maximum(3.0 - slopes.sum(1, keepdims=True), 0.0) / slopes.shape[1]
    slopes = slopes / np.abs(slopes).max(1, keepdims=True)
    width = (1.0 if kind == "periodic" else 2.0) / slopes.shape[1]
    e = np.concatenate([np.zeros((slopes.shape[0], 1)), np.cumsum(slopes, 1)], 1) * width
    if kind == "periodic":
        found: Array = e[:, :-1] - e[:, :-1].mean(1, keepdims=True)
    else:
        found = e - 0.5 * (e[:, :1] + e[:, -1:])
    return found


def block(case: Block) -> Row:
    """Try the laws of a block."""
    kind, falls = KINDS[case.kind]
    random = np.random.default_rng([case.seed, *[1] * case.flexible, *case.kind.encode()])
    laws = FLEXIBLE_LAWS if case.flexible else LAWS
    table_of = tables(random, kind, falls, laws)
    one = [_servo(random, kind, case.flexible) for _ in range(laws)]
    found, floor = _tried(random, kind, table_of, _servos([each[0] for each in one]))
    left = lasting(found, floor).reshape(laws, STARTS).max(1)
    back = found.kinetic.max(0) / found.start if kind == "stops" else np.zeros(1)
    corner = _servos([each[1] for each in one[:CORNER_LAWS]])
    few = None if table_of is None else table_of[:CORNER_LAWS]
    timid = np.ones(corner.damping.size) / MULTIPLES[-1]
    for multiple in reversed(MULTIPLES):
        tried, rest = _tried(random, kind, few, corner.stiffer(multiple))
        bad = lasting(tried, rest) > LASTS
        if kind == "stops":
            bad |= tried.kinetic.max(0) > 1.001 * tried.start
        timid = np.where(bad.reshape(-1, STARTS).any(1), 1.0 / multiple, timid)
    return Row(
        int((left > LASTS).sum()), float(left.max()), float(back.max()), tuple(timid.tolist())
    )


def _tried(
    random: np.random.Generator, kind: Kind, table_of: Array | None, servos: Servos
) -> tuple[Found, Array]:
    """Start each law several times; return the motions, and the kinetic energy of rest."""

    def each(values: Array) -> Array:
        return np.repeat(values, STARTS, axis=0)

    many = servos.mapped(each)
    count = many.damping.size
    swing = np.sqrt(many.stiffness)
    speed = swing * 10.0 ** random.uniform(-1.0, 0.7, count) * random.choice([-1.0, 1.0], count)
    x = random.uniform(-1.0, 1.0, count)
    if kind == "periodic":
        speed = np.clip(speed, -0.4, 0.4)
    if many.loads is not None:
        shake = speed * random.choice([0.0, -1.0, 1.0], count)
        many = replace(many, loads=replace(many.loads, shake=shake))
    law = Law(kind, count, None if table_of is None else each(table_of))
    return moved(law, many, x, speed, PERIODS), 1e-7 * many.stiffness


def _servos(numbers: Sequence[tuple[float, ...]]) -> Servos:
    """Return servos from the numbers that ``_servo`` gives."""
    b, stiffness, damping, delay, *load = np.array(numbers).T
    return Servos(b, stiffness, damping, delay, Loads(*load) if load else None)


def _servo(
    random: np.random.Generator, kind: Kind, flexible: bool
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return a true servo inside a belief, and its worst corner, both with the guard's gains."""
    delta = 10.0 ** random.uniform(*np.log10(DELTA))
    low = delta * INERTIA / PERIOD
    width = random.uniform(0.0, 1.0)

    belief = Belief(
        inertia=_bounded(INERTIA, INERTIA * (1.0 + 0.5 * width)),
        damping=_bounded(low, low * (1.0 + 2.0 * width)),
        coulomb=Bounded.exactly(0.0),
        delay=_bounded(0.0, random.uniform(0.0, 2.0) * PERIOD),
        torque_gain=_bounded(1.0, 1.0 + 0.3 * width),
    )
    if flexible:
        belief = _with_load(random, belief, width)
    late = random.choice([0.0, 0.3, 1.0, 2.5]) * PERIOD
    ceiling = float(max_virtual_damping(INERTIA, low, PERIOD, late + belief.delay.high))
    damping = random.choice([-0.5 * low, 0.0, *(ceiling * random.uniform(0.0, 0.7, 3))])
    if flexible:
        damping = max(damping, 0.0)
    side: Side = "above" if kind == "stops" else "both"
    request = Request(1e12, float(damping), side, law=kind, linear=False)
    (decision,) = decide(
        request,
        GuardSettings(),
        Situation(belief, PERIOD, 1e9, 0.0),
        [late],
        explained=False,
    )

    def pure(m: float, b: float, gain: float, delay: float, *load: float) -> tuple[float, ...]:
        numbers = (
            b * PERIOD / m,
            gain * decision.stiffness * PERIOD**2 / m,
            gain * decision.damping * PERIOD / m,
            (late + delay) / PERIOD,
        )
        if not load:
            return numbers
        inertia, hertz, ratio = load
        at_motor = float(belief.encoder == "motor")
        return (*numbers, inertia / m, math.tau * hertz * PERIOD, ratio, at_motor, 0.0)

    uncertain = [belief.inertia, belief.damping, belief.torque_gain, belief.delay]
    loads = [belief.load_inertia, belief.flexible_hz, belief.flexible_damping_ratio]
    uncertain += loads if flexible else []
    at = [
        (each.low, each.high)[random.integers(2)]
        if random.random() < 0.5
        else random.uniform(each.low, each.high)
        for each in uncertain
    ]
    worst = (INERTIA, low, belief.torque_gain.high, belief.delay.high)
    if not flexible:
        return pure(*at), pure(*worst)
    corners = [
        pure(*worst, *load)
        for load in itertools.product(*((each.low, each.high) for each in loads))
    ]
    return pure(*at), min(corners, key=_borne)


def _bounded(least: float, most: float) -> Bounded:
    return Bounded(0.5 * (least + most), least, most)


def _with_load(random: np.random.Generator, belief: Belief, width: float) -> Belief:
    """Return a belief with a load behind a transmission, whose vibration is sampled."""
    share, hertz = random.uniform(0.05, 0.7), 10.0 ** random.uniform(1.3, 2.4)
    ratio = 10.0 ** random.uniform(-2.0, -1.0)
    encoder: EncoderSide = "output" if random.random() < 0.5 else "motor"
    return replace(
        belief,
        load_inertia=_bounded(share * INERTIA, share * INERTIA * (1.0 + 0.2 * width)),
        flexible_hz=_bounded(hertz, hertz * (1.0 + 0.2 * width)),
        flexible_damping_ratio=_bounded(ratio, 2.0 * ratio),
        encoder=encoder,
    )


def _borne(numbers: tuple[float, ...]) -> float:
    """Return the linear limit of a servo of two masses over its stiffness."""
    b, stiffness, virtual, delay, share, rate, ratio, at_motor, _ = numbers
    moving = share * (1.0 - share)
    limit = flexible_boundary(
        1.0 - share,
        b,
        share,
        moving * rate**2,
        2.0 * ratio * moving * rate,
        virtual,
        1.0,
        delay,
        encoder="motor" if at_motor else "output",
    ).stiffness
    return float(limit) / max(stiffness, 1e-30)


def kinds(found: Sequence[tuple[Block, Row]]) -> Iterable[str]:
    """Return the table of the drawn laws."""
    rows = []
    for name in dict.fromkeys(case.name for case, _ in found):
        cases = [case for case, _ in found if case.name == name]
        kind = cases[0].kind
        some = [row for case, row in found if case.name == name]
        count = (FLEXIBLE_LAWS if cases[0].flexible else LAWS) * len(some)
        bad = sum(row.lasting for row in some)
        most = upper_bound(bad, count)
        timid = float(np.median([each for row in some for each in row.timid]))
        back = f"{max(row.back for row in some):.3f}" if kind == "stops" else ""
        rows.append(
            [
                name,
                str(count),
                str(bad),
                f"{1e3 * most:.1f} in 1000",
                f"{max(row.longest for row in some):.2f}",
                back,
                f"{timid:.2f}",
            ]
        )
    head = (
        "law",
        "tried",
        "a motion lasts",
        "at most, with 95 %",
        "energy left, largest",
        "energy of the servo over that of the start, largest",
        "commanded over borne, median",
    )
    yield from table(head, *rows)


def harmless(found: Sequence[tuple[Block, Row]]) -> bool:
    """Whether no motion lasts and none is thrown back, and the guard is not timid."""
    return all(row.lasting == 0 and row.back <= 1.001 for _, row in found)


@dataclass(frozen=True, slots=True)
class Search:
    """A search for the worst law and servo at a share of the exact limit."""

    kind: str
    share: float
    rounds: int
    seed: int


class Worst(NamedTuple):
    """Of a search."""

    tried: int
    left: float
    """Largest fraction of the energy that is left"""


def searches(given: Given) -> list[Search]:
    """Return the searches."""
    return [
        Search(kind, share, given.rounds, seed)
        for kind in ("periodic", "profile", "profile that only rises")
        for share in SHARES
        for seed in range(given.seeds)
    ]


def searched(case: Search) -> Worst:
    """Search with a population that keeps the laws on which motion lasts longest."""
    kind, falls = KINDS[case.kind]
    random = np.random.default_rng([case.seed, *case.kind.encode()])
    size = 4 + KNOTS

    def fresh(count: int) -> Array:
        slopes = random.uniform(-1.0 if falls else 0.0, 1.0, (count, KNOTS))
        first = [random.uniform(*each, (count, 1)) for each in _RANGES]
        return np.concatenate([*first, slopes], 1)

    def worst(genes: Array) -> Array:
        delta, delay, damper, speed = (
            np.clip(genes[:, i], *each) for i, each in enumerate(_RANGES)
        )
        delta = 10.0**delta
        virtual = damper * np.where(
            damper > 0.0, max_virtual_damping(1.0, delta, 1.0, delay), delta
        )
        stiffness = case.share * critical_stiffness(1.0, delta, virtual, 1.0, delay)
        slopes = np.clip(genes[:, 4:], -1.0 if falls else 0.0, 1.0)
        flat = np.abs(slopes - slopes.mean(1, keepdims=True) * (kind == "periodic")).max(1) < 1e-6
        slopes[flat, 0] += 0.5
        many = Servos(delta, stiffness, virtual, delay).mapped(lambda each: np.repeat(each, STARTS))
        count = many.damping.size
        v = np.sqrt(many.stiffness) * 10.0 ** (
            np.repeat(speed, STARTS) + random.uniform(-0.5, 0.5, count)
        )
        if kind == "periodic":
            v = np.clip(v, 0.0, 0.4)
        v *= random.choice([-1.0, 1.0], count)
        x = random.uniform(-1.0, 1.0, count)
        law = Law(kind, count, np.repeat(shaped(slopes, kind, falls), STARTS, axis=0))
        found = moved(law, many, x, v, SEARCH_PERIODS)
        left: Array = lasting(found, 1e-6 * many.stiffness).reshape(-1, STARTS).max(1)
        return left

    people = fresh(PEOPLE)
    score = worst(people)
    for _ in range(case.rounds):
        steps = random.normal(0.0, 1.0, (PEOPLE, size)) * _STEPS
        children = people[random.integers(PEOPLE, size=PEOPLE)] + steps * (
            random.random((PEOPLE, size)) < 0.5
        )
        new = random.random(PEOPLE) < 0.15
        children[new] = fresh(int(new.sum()))
        both, scores = np.concatenate([people, children]), np.concatenate([score, worst(children)])
        best = np.argsort(-scores)[:PEOPLE]
        people, score = both[best], scores[best]
    return Worst(PEOPLE * (case.rounds + 1), float(worst(people).max()))


_STEPS = np.array([0.15, 0.4, 0.15, 0.2] + [0.3] * KNOTS)
_RANGES = (-2.0, -0.7), (0.0, 5.0), (-0.65, 0.7), (-1.0, 0.7)
"""Of log10 of b T / m, the delay [periods], B over its ceiling (below 0: over b), log10 of the
start's speed over that of an oscillation of one unit"""


def worst_of(found: Sequence[tuple[Search, Worst]]) -> Iterable[str]:
    """Return the table of the searches."""
    rows = []
    for kind in dict.fromkeys(case.kind for case, _ in found):
        cells = [kind]
        for share in SHARES:
            some = [row for case, row in found if case.kind == kind and case.share == share]
            cells.append(f"{max(row.left for row in some):.2f}")
        tried = sum(row.tried for case, row in found if case.kind == kind)
        rows.append([*cells, str(tried)])
    yield from table(("law", *(f"K = {share:g} exact" for share in SHARES), "tried"), *rows)


STUDY = Study(
    "evidence/laws-check.md",
    (
        Part("drawn", drawn, block, kinds, case_s=8.0, wanted=harmless),
        Part("searched", searches, searched, worst_of, case_s=8.0),
    ),
    (
        Option("blocks", 7, f"blocks of {LAWS} laws of each kind", quick=1),
        Option(
            "flexible", 2, f"blocks of {FLEXIBLE_LAWS} laws of each kind on two masses", quick=1
        ),
        Option("rounds", 25, "rounds of each search", quick=2),
        Option("seeds", 2, "searches of each kind and stiffness", quick=1),
    ),
    everywhere=True,
)
