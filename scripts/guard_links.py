"""Searches a belief with a flexible transmission for servos on which its walls oscillate."""

import math
from functools import partial
from typing import Any, Literal, NamedTuple

import numpy as np
from scipy.optimize import differential_evolution

from haptic_wall.controller.guard.belief import HEAVIEST, Belief, Bounded
from haptic_wall.controller.guard.bins import Bins
from haptic_wall.controller.guard.guard import Decision, GuardSettings, Request, Situation, decide
from haptic_wall.controller.guard.schedule import interval_bins_ns, served_range
from haptic_wall.controller.theory.boundary import chain_boundary, chain_ceiling
from haptic_wall.controller.theory.chain import Chain, sampled, two_masses
from haptic_wall.controller.theory.chain_contact import one_sided_limits, returned
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.controller.theory.crossings import Loops, poles
from haptic_wall.controller.theory.velocity_filter import VelocityFilter
from haptic_wall.hw.truth import EncoderSide
from scripts.study import Found, Given, Part, table

PERIOD = 1e-3
SERVOS = ((0.011951, 0.011692), (0.0018142, 0.0036617))
"""Inertia and viscous friction: published fits of an MX-64 and an XL330"""
GROWS = 1e-6
"""Rate of growth that counts as such [1/s]"""
PHASES = np.array([1e-9, 0.5, 0.9, 0.97, 1.0])
NAMES = (
    "inertia",
    "damping",
    "torque_gain",
    "delay",
    "load_inertia",
    "flexible_hz",
    "flexible_damping_ratio",
)


class Outcome(NamedTuple):
    """The worst that one belief's walls do on a truth inside it."""

    random: float
    """Fastest growth of a pole over the random truths [1/s]"""
    searched: float
    """The same, of the optimiser's search"""
    thrown: float
    """Largest exit over entry speed of the one-sided wall over some of the truths"""
    damping: float
    """Commanded B over the middle's ceiling, where less than asked is commanded; else NaN"""
    stiffness: float
    """Commanded K of the two-sided wall over the middle's limit at the commanded B"""
    one_sided: float
    """Commanded K of the one-sided wall over the middle's one-sided limit"""


Kind = Literal["known", "wide", "lowpass", "notch"]
Value = Any
"""A float, or an array"""
Servo = tuple[Value, Value, Value, Value, Value]
"""As of ``two_mass_servo``"""


def _between(random: np.random.Generator, low: float, high: float) -> float:
    """Draw log-uniformly."""
    return float(np.exp(random.uniform(math.log(low), math.log(high))))


def drawn(random: np.random.Generator, kind: Kind = "known") -> tuple[Belief, float, float]:
    """Return a belief, a sample age [s] and the asked B over the middle's ceiling."""
    if kind == "wide":
        return _drawn_wide(random)
    between = partial(_between, random)

    def doubted(value: float) -> Bounded:
        return Bounded(
            value, value / (1.0 + between(0.03, 0.5)), value * (1.0 + between(0.03, 0.5))
        )

    m, b = SERVOS[int(random.integers(2))]
    load = m * between(0.05, 3.0)
    encoder: EncoderSide = "motor" if random.random() < 0.25 else "output"
    lag = random.uniform(0.0, 2e-3)
    belief = Belief(
        inertia=doubted(m + load),
        damping=doubted(b * between(0.3, 3.0)),
        coulomb=Bounded.exactly(0.0),
        delay=Bounded(lag, lag * random.random(), lag),
        torque_gain=doubted(1.0),
        load_inertia=doubted(load),
        flexible_hz=doubted(between(10.0, 120.0)),
        flexible_damping_ratio=doubted(between(0.005, 0.15)),
        encoder=encoder,
    )
    return belief, float(random.uniform(0.0, 3e-3)), between(0.05, 2.0)


def _drawn_wide(random: np.random.Generator) -> tuple[Belief, float, float]:
    """Return the same where frequency and load are in wide doubt, up to far above half the rate."""
    between = partial(_between, random)
    m, b = SERVOS[int(random.integers(2))]
    heaviest = m * between(0.005, 2.0)
    lightest = heaviest * random.choice([1.0, 0.0, random.random()])
    load = 0.5 * (lightest + heaviest)
    slowest = between(10.0, 1500.0)
    fastest = min(slowest * random.choice([1.0, between(1.0, 30.0)]), 4000.0)
    ratio = random.choice([0.0, between(0.0005, 0.1)])
    lag = random.uniform(0.0, 3e-3)
    whole = m + load
    belief = Belief(
        inertia=Bounded(whole, max(whole / between(1.0, 1.5), 1.05 * heaviest), 1.5 * whole),
        damping=Bounded(b, b / between(1.0, 3.0), b),
        coulomb=Bounded.exactly(0.0),
        delay=Bounded(lag, lag * random.random(), lag),
        torque_gain=Bounded(1.0, 0.9, 1.1),
        load_inertia=Bounded(load, lightest, heaviest),
        flexible_hz=Bounded(math.sqrt(slowest * fastest), slowest, fastest),
        flexible_damping_ratio=Bounded(ratio, ratio, ratio * between(1.0, 30.0)),
        encoder="motor" if random.random() < 0.25 else "output",
    )
    return belief, between(1e-5, 2e-2), between(0.05, 2.0)


def inside(belief: Belief, shares: FloatArray) -> FloatArray:
    """Return true values by name, of shares of each believed range; truths × names."""
    low = np.array([getattr(belief, name).low for name in NAMES])
    high = np.array([getattr(belief, name).high for name in NAMES])
    found: FloatArray = low + shares * (high - low)
    rate, load = NAMES.index("flexible_hz"), NAMES.index("load_inertia")
    found[:, rate] = low[rate] * (high[rate] / low[rate]) ** shares[:, rate]
    found[:, load] = np.maximum(found[:, load], 1e-3 * high[load])
    return found


def two_mass_servo(whole: Value, damping: Value, load: Value, hz: Value, ratio: Value) -> Servo:
    """Return inertia and friction of the motor, the load, and stiffness and damping between them.

    Args:
        whole: Inertia of both [kg·m²].
        damping: Viscous friction [N·m·s/rad].
        load: Inertia of the load [kg·m²].
        hz: Frequency of the vibration with both ends free [Hz].
        ratio: Its damping ratio.
    """
    motor, rate = whole - load, math.tau * hz
    moving = motor * load / whole
    return motor, damping, load, moving * rate**2, 2.0 * ratio * moving * rate


def middle_of(belief: Belief) -> Servo:
    """Return the servo in the middle of a belief."""
    whole, b, _, _, load, hz, ratio = (getattr(belief, name).value for name in NAMES)
    return two_mass_servo(whole, b, load, hz, ratio)


def chain_of(truths: FloatArray, encoder: str) -> Chain:
    """Return the servos of these truths."""
    whole, b, _, _, load, hz, ratio = truths.T
    servo = two_mass_servo(whole, b, np.minimum(load, HEAVIEST * whole), hz, ratio)
    return two_masses(*servo, encoder=encoder)[0]


def _filter(random: np.random.Generator, kind: Kind, hz: float) -> VelocityFilter | None:
    """Return a filter of this kind for a vibration at ``hz``; None: this kind has none."""
    if kind == "notch":
        return VelocityFilter("notch", math.tau * hz * PERIOD, float(random.uniform(0.3, 3.0)))
    if kind == "lowpass":
        corner = hz * math.exp(random.uniform(math.log(0.2), math.log(3.0)))
        return VelocityFilter("lowpass", math.tau * corner * PERIOD, 0.7)
    return None


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
    late = (delay + truths[:, NAMES.index("delay")]) / interval
    gain = truths[:, NAMES.index("torque_gain")]
    for whole in np.unique(np.floor(late)).tolist():
        part = np.flatnonzero(np.floor(late) == whole)
        chains = sampled(chain.take(part), interval[part], late[part] - whole)
        loops = Loops(chains, interval[part], np.full(part.size, int(whole)), 1, velocity_filter)
        closed = poles(loops, gain[part] * wall.stiffness, gain[part] * wall.damping)
        found[part] = np.log(np.abs(closed).max(axis=1)) / interval[part]
    return found


def _shares(random: np.random.Generator, truths: int, size: int) -> FloatArray:
    """Draw points between 0 and 1, half of them corners."""
    shares = random.random((truths, size))
    corners = random.random(shares.shape) < 0.5
    return np.where(random.random((truths, 1)) < 0.5, shares, corners)


def thrown(belief: Belief, truths: FloatArray, age: float, wall: Decision) -> float:
    """Return the largest exit over entry speed of these truths."""
    worst = 0.0
    for truth in truths:
        each = np.tile(truth, (PHASES.size, 1))
        ratio = returned(
            chain_of(each, belief.encoder),
            PERIOD,
            age + truth[3],
            each[:, 2] * wall.stiffness,
            each[:, 2] * wall.damping,
            PHASES,
            longest=2000,
        )
        worst = max(worst, float(np.nanmax(ratio, initial=0.0)))
    return worst


class Search(NamedTuple):
    """One belief to draw and to search."""

    seed: int
    number: int
    truths: int
    steps: int
    kind: Kind


def outcome(case: Search) -> Outcome:
    """Draw a belief, and find the worst truth inside it."""
    seed, number, truths, steps, kind = case
    random = np.random.default_rng((seed, number))
    belief, age, of_ceiling = drawn(random, kind)
    known, gain, delay = middle_of(belief), belief.torque_gain.value, age + belief.delay.value
    filtered = _filter(random, kind, belief.flexible_hz.value)
    ceiling = chain_ceiling(
        *two_masses(*known, encoder=belief.encoder), PERIOD, delay, velocity_filter=filtered
    )
    possible = float(ceiling) / gain
    asked = of_ceiling * possible
    situation = Situation(belief, PERIOD, 4.1, 0.0)

    def decided(request: Request) -> Decision:
        return decide(request, GuardSettings(), situation, [age], age, explained=False)[0]

    both = decided(Request(1e9, asked, "both", velocity_filter=filtered))
    shares = _shares(random, truths, len(NAMES))

    def growths(shares: FloatArray) -> FloatArray:
        found, every = inside(belief, shares), np.ones(len(shares))
        chain = chain_of(found, belief.encoder)
        return growth(found, chain, PERIOD * every, age * every, both, filtered)

    tried = growths(shares)
    worst = np.argsort(-tried)
    found = differential_evolution(
        lambda point: -float(growths(point[None])[0]),
        [(0.0, 1.0)] * len(NAMES),
        init=shares[worst[:10]],
        maxiter=steps,
        seed=number,
        polish=False,
    )
    damping = both.damping * gain
    limit = chain_boundary(
        *two_masses(*known, encoder=belief.encoder),
        damping,
        PERIOD,
        delay,
        velocity_filter=filtered,
    ).stiffness
    thrown_by = of_one_sided = math.nan
    if filtered is None:
        one = decided(Request(1e9, asked, "above"))
        thrown_by = thrown(belief, inside(belief, shares[worst[:4]]), age, one)
        chain, _ = two_masses(*known, encoder=belief.encoder)
        limits = np.atleast_1d(limit), np.atleast_1d(damping)
        of_one_sided = float(
            one.stiffness * gain / one_sided_limits(chain, PERIOD, delay, *limits)[0]
        )
    return Outcome(
        float(tried.max()),
        -float(found.fun),
        thrown_by,
        both.damping / possible if both.damping < asked else math.nan,
        float(both.stiffness * gain / limit),
        of_one_sided,
    )


def lines(found: Found[Search, Outcome]) -> list[str]:
    """Count growth and throws of each kind of belief, and the shares of what is possible."""
    cells = []
    for kind, words in KINDS.items():
        rows = np.array([row for case, row in found if case.kind == kind])
        truths = sum(case.truths for case, _ in found if case.kind == kind)
        grow, by_search = (int(np.sum(rows[:, n] > GROWS)) for n in (0, 1))
        thrown = rows[np.isfinite(rows[:, 2]), 2]
        shares = [_spread(rows[:, n]) for n in (4, 5, 3)]
        worst = f"{int(np.sum(thrown > 1.0 + 1e-6))} of {4 * thrown.size}" if thrown.size else ""
        cells.append((words, len(rows), truths, grow, by_search, worst, *shares))
    head = ("belief", "number", "truths", "grow", "by search", "throw")
    return table((*head, "K two-sided", "K one-sided", "B"), *cells)


def _spread(values: FloatArray) -> str:
    kept = values[np.isfinite(values)]
    return ", ".join(f"{x:.2f}" for x in np.quantile(kept, [0.1, 0.5])) if kept.size else ""


KINDS: dict[Kind, str] = {
    "known": "no filter",
    "wide": "no filter, wide doubt",
    "lowpass": "low-pass",
    "notch": "notch",
}
_POPULATION = 40


class Served(NamedTuple):
    """Fastest growth of one wall in one bin of the served interval [1/s]."""

    random: float
    """Over random truths, ages and intervals of the bin"""
    searched: float
    """Of an optimiser's search"""


def served(case: Search) -> list[Served]:
    """Draw a belief and a wall, and search some bins for intervals at which it grows."""
    seed, number, truths, steps, kind = case
    random = np.random.default_rng((seed, number, list(KINDS).index(kind)))
    belief, age, of_ceiling = drawn(random, kind)
    filtered = _filter(random, kind, belief.flexible_hz.value)
    late = int(random.choice([0, 0, 1, 2, 3, 5]))
    delay = late * PERIOD + age + belief.delay.value
    ceiling = chain_ceiling(
        *two_masses(*middle_of(belief), encoder=belief.encoder),
        PERIOD,
        delay,
        velocity_filter=filtered,
    )
    situation = Situation(belief, PERIOD, 4.1, 0.0)
    request = Request(1e9, of_ceiling * float(ceiling), "both", velocity_filter=filtered)
    bins = interval_bins_ns(round(PERIOD * 1e9), flexible=True)
    found = []
    for index in range(len(bins)):
        (wall,) = Bins(
            request, GuardSettings(), situation, late, [round(age * 1e9)], bins
        ).decide_interval(index)
        low, high = (share * bins[index] * 1e-9 for share in served_range(bins, index))

        def growths(
            shares: FloatArray, low: float = low, high: float = high, wall: Decision = wall
        ) -> FloatArray:
            interval = low + shares[:, -1] * (high - low)
            delay = shares[:, -2] * age + [_ring(late, t) for t in interval.tolist()]
            known = inside(belief, shares[:, :-2])
            chain = chain_of(known, belief.encoder)
            return growth(known, chain, interval, delay, wall, filtered)

        shares = _shares(random, truths, len(NAMES) + 2)
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
        found.append(Served(float(tried.max()), -float(search.fun)))
    return found


def _ring(steps: int, interval: float) -> float:
    """Return the mean delay of the ring at an interval [s]."""
    each = interval / PERIOD
    waiting = [min(steps - n * each, 1.0) for n in range(math.ceil(steps / each))]
    return interval * sum(waiting)


def served_lines(found: Found[Search, list[Served]]) -> list[str]:
    """Count growth over kinds of beliefs."""
    cells = []
    for kind, words in KINDS.items():
        own = np.array([each for case, row in found if case.kind == kind for each in row])
        tried = sum(case.truths * len(row) for case, row in found if case.kind == kind)
        random, searched = own.T
        grow, by_search = (int(np.sum(each > GROWS)) for each in (random, searched))
        fastest = f"{max(random.max(), searched.max()):.2g}"
        cells.append((words, len(own), tried, grow, by_search, fastest))
    head = ("belief", "walls", "truths", "grow", "by search", "fastest [1/s]")
    return table(head, *cells)


def _searches(given: Given, seed: int, beliefs: int) -> list[Search]:
    """Return the beliefs of each kind."""
    return [
        Search(seed, i, given.truths, given.steps, kind) for kind in KINDS for i in range(beliefs)
    ]


LINKS = Part(
    "links",
    lambda given: _searches(given, given.seed, given.beliefs),
    outcome,
    lines,
    case_s=4.0,
)
SERVED = Part(
    "served",
    lambda given: _searches(given, given.seed + 400, given.served),
    served,
    served_lines,
    case_s=6.0,
)
