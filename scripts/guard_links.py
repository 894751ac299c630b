"""Searches a belief with a flexible transmission for servos on which its walls oscillate."""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, Literal, NamedTuple

import numpy as np

from haptic_wall.controller.guard.belief import HEAVIEST, Belief, Bounded
from haptic_wall.controller.guard.bins import Bins
from haptic_wall.controller.guard.schedule import interval_bins_ns
from haptic_wall.controller.guard.types import Decision, GuardSettings, Request, Situation
from haptic_wall.controller.laws.wall import Side
from haptic_wall.controller.theory.boundary import chain_boundary, chain_ceiling
from haptic_wall.controller.theory.chain import Chain, sampled, two_masses
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.controller.theory.crossings import Loops, poles
from haptic_wall.controller.theory.velocity_filter import VelocityFilter
from haptic_wall.hw.truth import EncoderSide
from scripts.study import Found, Part, table
from tests.support.chain_contact import one_sided_limits, returned

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


class Box(NamedTuple):
    """The worst that the walls of one belief do in one bin of the served interval."""

    interval: int
    """Index of the bin"""
    growth: float
    """Fastest growth of a pole that was found [1/s]"""
    beyond: float
    """The same at 1.2 times the stiffness, where the search looks"""
    thrown: float
    """Largest exit over entry speed of the one-sided wall over some of the truths; else NaN"""
    damping: float
    """Commanded B over the middle's ceiling, where less than asked is commanded; else NaN"""
    stiffness: float
    """Commanded K of the two-sided wall over the middle's limit at the commanded B"""
    one_sided: float
    """Commanded K of the one-sided wall over the middle's one-sided limit; else NaN"""
    of_least: float
    """Commanded K over margin times the least limit of the truths that were found; else NaN"""


Kind = Literal["known", "slow", "ends", "fast", "wide", "lowpass", "notch", "notch_ends"]
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

    def doubted(value: float, least: float = 0.03, most: float = 0.5) -> Bounded:
        return Bounded(
            value, value / (1.0 + between(least, most)), value * (1.0 + between(least, most))
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
    age, of_ceiling = float(random.uniform(0.0, 3e-3)), between(0.05, 2.0)
    if kind == "slow":
        hz = between(4.0, max(0.064 / (age + lag), 6.0))
        belief = replace(belief, flexible_hz=doubted(hz))
    elif kind == "fast":
        hz, of_ceiling = between(60.0, 1000.0), 0.3 * of_ceiling
        belief = replace(belief, flexible_hz=doubted(hz), encoder="output")
    elif kind in ("ends", "notch_ends"):
        load = m * between(0.01, 20.0)
        lag = float(random.choice([0.0, 5e-4, 1e-3, 2e-3, random.uniform(0.0, 4e-3)]))
        belief = replace(
            belief,
            inertia=doubted(m + load, 1e-3),
            damping=doubted(b * between(0.05, 20.0), 1e-3, 2.0),
            delay=Bounded(lag, float(random.choice([0.0, lag])), lag),
            torque_gain=doubted(1.0, 1e-3),
            load_inertia=doubted(load, 1e-3),
            flexible_hz=doubted(between(3.0, 600.0), 1e-3),
            flexible_damping_ratio=doubted(between(1e-4, 0.3), 1e-3, 3.0),
        )
        of_ceiling = float(random.choice([of_ceiling, 1.0, 10.0]))
    if kind == "notch_ends":
        hz = min(belief.flexible_hz.value, 120.0)
        belief = replace(belief, flexible_hz=doubted(hz, 1e-3, 1.0))
    if kind in ("notch", "notch_ends"):
        belief = replace(belief, encoder="output")
    return belief, age, of_ceiling


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
    if kind == "notch_ends":
        at = hz * math.exp(random.uniform(-0.5, 0.5))
        return VelocityFilter("notch", math.tau * at * PERIOD, _between(random, 0.3, 4.0))
    if kind == "lowpass":
        corner = hz * math.exp(random.uniform(math.log(0.2), math.log(3.0)))
        return VelocityFilter("lowpass", math.tau * corner * PERIOD, 0.7)
    return None


class Members(NamedTuple):
    """Truths inside a belief, each at an interval and a delay; arrays of shape (n,)."""

    truths: FloatArray
    """Columns as of the study"""
    chain: Chain
    """The servos"""
    interval: FloatArray
    """Between ticks [s]"""
    delay: FloatArray
    """Without the servo's lag [s]"""

    @property
    def gain(self) -> FloatArray:
        """Return the torque gains."""
        return self.truths[:, NAMES.index("torque_gain")]

    @property
    def total(self) -> FloatArray:
        """Return the delays with the servos' lags [s]."""
        return self.delay + self.truths[:, NAMES.index("delay")]


def growth(
    members: Members,
    wall: Decision,
    velocity_filter: VelocityFilter | None,
    of_stiffness: Value = 1.0,
) -> FloatArray:
    """Return the rate at which each truth's loop grows, at most [1/s].

    Args:
        members: The truths.
        wall: The commanded gains.
        velocity_filter: Filter of the velocity that damps.
        of_stiffness: Rendered over commanded stiffness.
    """
    chain, interval, gain = members.chain, members.interval, members.gain
    found = np.zeros(gain.size)
    late = members.total / interval
    stiffness = gain * of_stiffness * wall.stiffness
    for whole in np.unique(np.floor(late)).tolist():
        part = np.flatnonzero(np.floor(late) == whole)
        chains = sampled(chain.take(part), interval[part], late[part] - whole)
        loops = Loops(chains, interval[part], np.full(part.size, int(whole)), 1, velocity_filter)
        closed = poles(loops, stiffness[part], gain[part] * wall.damping)
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


def outcome(case: Search) -> list[Box]:
    """Draw a belief, and find the worst truth inside it: at the period, and in another bin."""
    seed, number, truths, steps, kind = case
    random = np.random.default_rng((seed, number, list(KINDS).index(kind)))
    belief, age, of_ceiling = drawn(random, kind)
    filtered = _filter(random, kind, belief.flexible_hz.value)
    late = int(random.choice([0, 0, 0, 1, 2, 3, 5]))
    known, gain = middle_of(belief), belief.torque_gain.value
    servo, delay = two_masses(*known, encoder=belief.encoder), age + belief.delay.value
    loop = (PERIOD, late * PERIOD + delay)
    possible = float(chain_ceiling(*servo, *loop, velocity_filter=filtered)) / gain
    asked, found = of_ceiling * possible, []
    edges = interval_bins_ns(round(PERIOD * 1e9), flexible=True)

    def walls(side: Side) -> Bins:
        request = Request(1e9, asked, side, velocity_filter=filtered)
        where = GuardSettings(), Situation(belief, PERIOD, 4.1, 0.0)
        return Bins(request, *where, late, [round(age * 1e9)], edges)

    def decided(side: Side, index: int) -> Decision:
        return walls(side).decide_interval(index)[0]

    for index in (0, int(random.integers(1, len(edges)))):
        wall = decided("both", index)
        low, high = (share * edges[index] * 1e-9 for share in walls("both").at(index)[1].served)

        def members(shares: FloatArray, ends: tuple[float, float] = (low, high)) -> Members:
            interval = ends[0] + shares[:, -1] * (ends[1] - ends[0])
            delay = shares[:, -2] * age + [_ring(late, t) for t in interval.tolist()]
            inner = inside(belief, shares[:, :-2])
            return Members(inner, chain_of(inner, belief.encoder), interval, delay)

        def growths(
            shares: FloatArray,
            of_stiffness: Value,
            wall: Decision = wall,
            members: Callable[[FloatArray], Members] = members,
        ) -> FloatArray:
            return growth(members(shares), wall, filtered, of_stiffness)

        shares = _shares(random, truths, len(NAMES) + 2)
        softer = np.where(random.random(truths) < 0.2, random.random(truths), 1.0)
        worst = float(growths(shares, softer).max())
        top, beyond = _climbed(random, shares, partial(growths, of_stiffness=1.2), steps)
        worst = max(worst, float(growths(top, 1.0).max()))
        thrown_by = of_one_sided = of_least = math.nan
        if index == 0:
            least = _least(members(np.concatenate([shares, top])), wall, filtered)
            of_least = (
                wall.stiffness / (GuardSettings().margin * least) if least > 0.0 else math.nan
            )
        limit = float(chain_boundary(*servo, wall.damping * gain, *loop, 1, filtered).stiffness)
        if filtered is None and index == 0 and number % 4 == 0:  # it takes long
            one, longer = decided("above", 0), late * PERIOD
            thrown_by = thrown(belief, inside(belief, top[:4, :-2]), age + longer, one)
            most = np.array([limit]), np.array([wall.damping * gain])
            free = float(one_sided_limits(servo[0], *loop, *most)[0])
            of_one_sided = one.stiffness * gain / free if free > 0.0 else math.nan
        found.append(
            Box(
                index,
                worst,
                beyond,
                thrown_by,
                wall.damping / possible if wall.damping < asked and index == 0 else math.nan,
                wall.stiffness * gain / limit if limit > 0.0 and index == 0 else math.nan,
                of_one_sided,
                of_least,
            )
        )
    return found


def _least(members: Members, wall: Decision, velocity_filter: VelocityFilter | None) -> float:
    """Return the least stiffness at which a truth oscillates [N·m/rad]; arguments of ``growth``."""
    gain = members.gain
    loop = (gain * wall.damping, members.interval, members.total, 1, velocity_filter)
    limits = chain_boundary(members.chain, gain.shape, *loop).stiffness / gain
    return float(limits.min())


_TOP = 16


def _climbed(
    random: np.random.Generator,
    shares: FloatArray,
    growths: Callable[[FloatArray], FloatArray],
    steps: int,
) -> tuple[FloatArray, float]:
    """Return the worst points that a search from the worst of some finds, and their worst growth.

    Steps around the best alternate with differences between them.
    """
    found = growths(shares)
    for step in range(steps):
        best = np.argsort(-found)[:_TOP]
        shares, found = shares[best], found[best]
        one, other, third = (shares[random.integers(_TOP, size=100)] for _ in range(3))
        moved = random.normal(size=one.shape) * 0.15 * 0.5**step * (random.random(one.shape) < 0.5)
        tried = np.clip(one + (0.7 * (other - third) if step % 2 else moved), 0.0, 1.0)
        shares, found = np.concatenate([shares, tried]), np.concatenate([found, growths(tried)])
    best = np.argsort(-found)[:_TOP]
    return shares[best], float(found[best[0]])


def _ring(steps: int, interval: float) -> float:
    """Return the mean delay of the ring at an interval [s]."""
    each = interval / PERIOD
    waiting = [min(steps - n * each, 1.0) for n in range(math.ceil(steps / each))]
    return interval * sum(waiting)


def lines(found: Found[Search, list[Box]]) -> list[str]:
    """Count growth and throws of each kind of belief, and the shares of what is possible."""
    cells = []
    for kind, words in KINDS.items():
        rows = np.array([box for case, row in found if case.kind == kind for box in row])
        if not rows.size:
            continue
        grow, beyond = (int(np.sum(rows[:, n] > GROWS)) for n in (1, 2))
        thrown = rows[np.isfinite(rows[:, 3]), 3]
        worst = f"{int(np.sum(thrown > 1.0 + 1e-6))} of {thrown.size}" if thrown.size else ""
        shares = [_spread(rows[:, n]) for n in (5, 7, 6, 4)]
        cells.append((words, len(rows), grow, f"{rows[:, 1].max():.2g}", beyond, worst, *shares))
    head = ("belief", "boxes", "grow", "fastest [1/s]", "at 1.2 K", "throw")
    return table((*head, "K two-sided", "over the least", "K one-sided", "B"), *cells)


def none_grows(found: Found[Search, list[Box]]) -> bool:
    """Whether no wall grows or throws."""
    every = [box for _, row in found for box in row]
    return not any(box.growth > GROWS or box.thrown > 1.0 + 1e-6 for box in every)


def _spread(values: FloatArray) -> str:
    kept = values[np.isfinite(values)]
    return ", ".join(f"{x:.2f}" for x in np.quantile(kept, [0.1, 0.5])) if kept.size else ""


KINDS: dict[Kind, str] = {
    "known": "no filter",
    "slow": "slow",
    "ends": "at the ends",
    "fast": "fast",
    "wide": "wide doubt",
    "lowpass": "low-pass",
    "notch": "notch",
    "notch_ends": "notch, at the ends",
}

LINKS = Part(
    "links",
    lambda given: [
        Search(given.seed, i, given.truths, given.steps, kind)
        for i in range(given.beliefs)
        for kind in KINDS
    ],
    outcome,
    lines,
    case_s=0.5,
    wanted=none_grows,
)
