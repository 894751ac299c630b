"""Searches a belief with a flexible transmission for servos on which its walls oscillate.

    scripts/study flexible_guard [--beliefs N] [--truths N] [--steps N] [--seed S] [--quick]

Takes some seconds a belief.
"""

import itertools
import math
from functools import partial
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import differential_evolution

from haptic_wall.controller.guard.belief import HEAVIEST, Belief, Bounded
from haptic_wall.controller.guard.flexible import returned_share
from haptic_wall.controller.guard.guard import Decision, GuardSettings, Request, Situation, decide
from haptic_wall.controller.theory import critical_stiffness, max_virtual_damping, one_sided_limit
from haptic_wall.controller.theory.chain import Chain, sampled, two_masses
from haptic_wall.controller.theory.chain_contact import one_sided_limits, returned
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.controller.theory.crossings import Loops, poles
from haptic_wall.controller.theory.flexible import (
    chain_boundary,
    chain_ceiling,
    flexible_boundary,
    flexible_ceiling,
)
from haptic_wall.controller.theory.velocity_filter import VelocityFilter
from haptic_wall.hw.settings import EncoderSide
from scripts.study import Found, Option, Part, Study, table
from scripts.trials.links import LinkTrial, link_trials
from scripts.trials.motor_energy import MotorTrial, motor_trials
from scripts.trials.served_links import ServedLink, Wall, growth, served_links

PERIOD = 1e-3
SERVOS = ((0.011951, 0.011692), (0.0018142, 0.0036617))
"""Inertia and viscous friction: published fits of an MX-64 and an XL330"""
SERVO_KINDS: tuple[tuple[EncoderSide, bool], ...] = (
    ("output", True),
    ("output", False),
    ("motor", False),
)
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
    """Largest modulus of a pole over the random truths"""
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


def modulus(
    belief: Belief,
    truths: FloatArray,
    age: float,
    wall: Decision,
    velocity_filter: VelocityFilter | None,
) -> FloatArray:
    """Return the largest modulus of a closed-loop pole of each truth."""
    every, chain = np.ones(len(truths)), chain_of(truths, belief.encoder)
    rate = growth(truths, chain, PERIOD * every, age * every, wall, velocity_filter)
    found: FloatArray = np.exp(PERIOD * rate)
    return found


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
    ceiling = flexible_ceiling(
        *known, PERIOD, delay, encoder=belief.encoder, velocity_filter=filtered
    )
    possible = float(ceiling) / gain
    asked = of_ceiling * possible
    situation = Situation(belief, PERIOD, 4.1, 0.0)

    def decided(request: Request) -> Decision:
        return decide(request, GuardSettings(), situation, [age], age, explained=False)[0]

    both = decided(Request(1e9, asked, "both", velocity_filter=filtered))
    shares = random.random((truths, len(NAMES)))
    corners = random.random(shares.shape) < 0.5
    shares = np.where(random.random((truths, 1)) < 0.5, shares, corners)
    tried = modulus(belief, inside(belief, shares), age, both, filtered)
    worst = np.argsort(-tried)

    def height(point: FloatArray) -> float:
        return -float(modulus(belief, inside(belief, point[None]), age, both, filtered)[0])

    found = differential_evolution(
        height,
        [(0.0, 1.0)] * len(NAMES),
        init=shares[worst[:10]],
        maxiter=steps,
        seed=number,
        polish=False,
    )
    damping = both.damping * gain
    limit = flexible_boundary(
        *known, damping, PERIOD, delay, encoder=belief.encoder, velocity_filter=filtered
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


ORDERS = ("together", "K first", "B first")


class Way(NamedTuple):
    """How many ways from a stable pair (K, B) to an allowed one cross unstable pairs."""

    rigid: bool
    encoder: str
    beyond: bool
    """B starts above the ceiling, and K where it is stable all the same"""
    ways: int
    unstable: tuple[int, ...]
    """Number of unstable ways of each of ``ORDERS``"""


def ways(case: tuple[int, int, EncoderSide, bool]) -> list[Way]:
    """Draw servos with a stable pair (K, B) and a lower allowed one, and count."""
    seed, count, encoder, rigid = case
    random = np.random.default_rng((seed, encoder == "motor", rigid))

    def between(low: float, high: float) -> FloatArray:
        return np.exp(random.uniform(math.log(low), math.log(high), count))

    whole = between(1e-3, 0.03)
    friction = whole * between(0.2, 5.0)
    load = whole * random.uniform(0.03, 0.8, count)
    hz, ratio = between(8.0, 150.0), between(0.004, 0.15)
    chain, _ = two_masses(*two_mass_servo(whole, friction, load, hz, ratio), encoder=encoder)
    if rigid:
        none = np.empty((count, 0))
        chain = Chain(whole[:, None], friction[:, None], none, none)
    steps, late = int(random.integers(4)), random.random(count)
    period, shape = np.full(count, PERIOD), (count,)
    delay = (steps + late) * PERIOD
    loops = Loops(sampled(chain, period, late), period, steps, 1)
    ceiling = chain_ceiling(chain, shape, period, delay)
    to_b = 0.7 * ceiling * random.random(count)
    to_k = 0.8 * chain_boundary(chain, shape, to_b, period, delay).stiffness * random.random(count)
    from_b = np.where(
        random.random(count) < 0.3,
        to_b * random.random(count),
        to_b + (1.3 * ceiling - to_b) * random.random(count),
    )
    from_k = to_k * np.exp(random.uniform(0.0, 1.5, count))

    def stable(k: FloatArray, b: FloatArray) -> NDArray[np.bool_]:
        found: NDArray[np.bool_] = np.abs(poles(loops, k, b)).max(axis=1) < 1.0 + 1e-9
        return found

    def crosses(first_k: bool, first_b: bool) -> NDArray[np.bool_]:
        found = np.zeros(count, dtype=np.bool_)
        for share in np.linspace(0.0, 2.0, 21):
            k_share = min(share, 1.0) if not first_b else max(share - 1.0, 0.0)
            b_share = min(share, 1.0) if not first_k else max(share - 1.0, 0.0)
            k, b = from_k + k_share * (to_k - from_k), from_b + b_share * (to_b - from_b)
            found |= ~stable(k, b)
        return found

    start = stable(from_k, from_b)
    unstable = [crosses(False, False), crosses(True, False), crosses(False, True)]
    return [
        Way(
            rigid,
            encoder,
            beyond,
            int(chosen.sum()),
            tuple(int((chosen & each).sum()) for each in unstable),
        )
        for beyond in (False, True)
        for chosen in [start & ((from_b > ceiling) == beyond)]
    ]


def way_lines(found: Found[tuple[int, int, EncoderSide, bool], list[Way]]) -> list[str]:
    """Count the ways that cross unstable pairs."""
    rows = []
    for rigid, encoder, beyond in itertools.product(
        (True, False), ("output", "motor"), (False, True)
    ):
        chosen = [
            way
            for _, row in found
            for way in row
            if (way.rigid, way.encoder, way.beyond) == (rigid, encoder, beyond)
        ]
        total = sum(way.ways for way in chosen)
        if total:
            name = "rigid" if rigid else f"encoder on the {encoder}"
            each = [sum(way.unstable[i] for way in chosen) for i in range(len(ORDERS))]
            rows.append((name, "above" if beyond else "below", total, *each))
    return table(("servo", "B starts, of the ceiling", "ways", *ORDERS), *rows)


class Contacts(NamedTuple):
    """Of one servo and five dampings: exact one-sided limits over what the guard would use."""

    near: tuple[float, ...]
    """Frequency of the contact at the two-sided limit over the vibration's"""
    over: tuple[float, ...]
    """Exact one-sided limit over the guard's: the two-sided one times both shares"""


def contacts(case: tuple[int, int]) -> Contacts:
    """Draw a servo, and compare the exact one-sided limits with the shares that the guard uses."""
    random = np.random.default_rng(case)
    between = partial(_between, random)
    whole = between(1e-3, 0.03)
    load = whole * random.uniform(0.03, 0.85)
    friction = whole * between(0.2, 5.0)
    hz, ratio = between(8.0, 150.0), between(0.004, 0.15)
    encoder: EncoderSide = "motor" if random.random() < 0.25 else "output"
    delay = random.uniform(0.0, 6e-3)
    servo = two_mass_servo(whole, friction, load, hz, ratio)
    ceiling = float(flexible_ceiling(*servo, PERIOD, delay, encoder=encoder))
    rigid_ceiling = float(max_virtual_damping(whole, friction, PERIOD, delay))
    damping = np.minimum(np.array([0.0, 0.1, 0.3, 0.5, 0.7]) * ceiling, 0.7 * rigid_ceiling)
    both = flexible_boundary(*servo, damping, PERIOD, delay, encoder=encoder).stiffness
    chain, _ = two_masses(*servo, encoder=encoder)
    one = one_sided_limits(chain, PERIOD, delay, both, damping)
    rigid = (whole, friction, damping, PERIOD, delay)
    share = one_sided_limit(*rigid) / critical_stiffness(*rigid)
    belief = Belief(
        inertia=Bounded.exactly(whole),
        damping=Bounded.exactly(friction),
        coulomb=Bounded.exactly(0.0),
        delay=Bounded.exactly(delay),
        torque_gain=Bounded.exactly(1.0),
        load_inertia=Bounded.exactly(load),
        flexible_hz=Bounded.exactly(hz),
        flexible_damping_ratio=Bounded.exactly(ratio),
        encoder=encoder,
    )
    some = both > 0.0
    near = np.sqrt(both / whole) / (math.tau * hz)
    over = one[some] / (both * share * returned_share(belief, both))[some]
    return Contacts(tuple(near[some].tolist()), tuple(over.tolist()))


def contact_lines(found: Found[tuple[int, int], Contacts]) -> list[str]:
    """Show the least ratios over the frequency of the contact."""
    near = np.concatenate([row.near for _, row in found])
    over = np.concatenate([row.over for _, row in found])
    rows = []
    for low, high in itertools.pairwise((0.0, 0.1, 0.15, 0.2, 0.3, 0.4, math.inf)):
        chosen = over[(near >= low) & (near < high)]
        if chosen.size:
            name = f"{low:g} to {high:g}" if math.isfinite(high) else f"{low:g} and above"
            rows.append((name, chosen.size, f"{chosen.min():.3f}", f"{np.median(chosen):.3f}"))
    heads = ("contact over vibration", "walls", "exact limit over the guard's: least", "median")
    return table(heads, *rows)


def lines(found: Found[Search, Outcome]) -> list[str]:
    """Count growth and throws, and the shares of what is possible."""
    rows = np.array([row for _, row in found])
    truths = sum(case.truths for case, _ in found)

    def spread(values: FloatArray) -> tuple[str, ...]:
        kept = values[np.isfinite(values)]
        return (
            tuple(f"{x:.3g}" for x in np.quantile(kept, [0.0, 0.5, 1.0]))
            if kept.size
            else ("",) * 3
        )

    counts = table(
        ("search", "tried", "grow or throw", "worst"),
        (
            "random truths, two-sided",
            truths,
            int(np.sum(rows[:, 0] > 1 + 1e-9)),
            f"{rows[:, 0].max():.6f}",
        ),
        (
            "optimiser, beliefs",
            len(rows),
            int(np.sum(rows[:, 1] > 1 + 1e-9)),
            f"{rows[:, 1].max():.6f}",
        ),
        *[
            (
                "worst four of each, one-sided",
                4 * len(rows),
                int(np.sum(rows[:, 2] > 1 + 1e-6)),
                f"{rows[:, 2].max():.4f}",
            )
        ]
        * bool(np.isfinite(rows[0, 2])),
    )
    possible = table(
        ("share of what is possible", "least", "median", "most"),
        ("B, where less than asked is commanded", *spread(rows[:, 3])),
        ("K, two-sided", *spread(rows[:, 4])),
        *[("K, one-sided", *spread(rows[:, 5]))] * bool(np.isfinite(rows[0, 2])),
    )
    share = 3.0 / truths
    return [
        *counts,
        "",
        "Beliefs with a truth that grows or throws are counted. None of"
        f" {truths} truths bounds the rate of growth at {share:.1g} (95 %).",
        "",
        *possible,
    ]


def _searched(name: str, kind: Kind, seed: int, case_s: float) -> Part[Search, Outcome]:
    """Return the part that searches beliefs of a kind; ``seed`` is added to the study's."""
    return Part(
        name,
        lambda given: [
            Search(given.seed + seed, i, given.truths, given.steps, kind)
            for i in range(given.beliefs)
        ],
        outcome,
        lines,
        case_s=case_s,
    )


KINDS: tuple[Kind, ...] = ("known", "wide", "lowpass", "notch")
SERVED_BINS = 6
"""Bins of each belief that are searched"""


def served(case: Search) -> list[ServedLink]:
    """Draw a belief and a wall, and search some bins of the served interval."""
    seed, number, truths, steps, kind = case
    random = np.random.default_rng((seed, number, KINDS.index(kind)))
    belief, age, of_ceiling = drawn(random, kind)
    filtered = _filter(random, kind, belief.flexible_hz.value)
    late = int(random.choice([0, 0, 1, 2, 3, 5]))
    delay = late * PERIOD + age + belief.delay.value
    ceiling = flexible_ceiling(
        *middle_of(belief), PERIOD, delay, encoder=belief.encoder, velocity_filter=filtered
    )

    def servos(shares: FloatArray) -> tuple[FloatArray, Chain]:
        found = inside(belief, shares)
        return found, chain_of(found, belief.encoder)

    wall = Wall(belief, age, late, of_ceiling * float(ceiling), filtered)
    return served_links(wall, random, servos, len(NAMES), truths, steps, SERVED_BINS)


def served_lines(found: Found[Search, list[ServedLink]]) -> list[str]:
    """Count growth over kinds of beliefs, and compare with bins that count their end alone."""
    words = {
        "known": "no filter",
        "wide": "no filter, wide doubt",
        "lowpass": "low-pass",
        "notch": "notch",
    }
    counts = []
    for kind in KINDS:
        own = [each for case, row in found if case.kind == kind for each in row]
        random, searched = (np.array([getattr(e, n) for e in own]) for n in ("random", "searched"))
        tried = sum(case.truths * len(row) for case, row in found if case.kind == kind)
        counts.append(
            (
                words[kind],
                len(own),
                tried,
                int(np.sum(random > GROWS)),
                int(np.sum(searched > GROWS)),
                f"{max(random.max(), searched.max()):.2g}",
            )
        )
    every = [each for _, row in found for each in row]
    shares = []
    for low, high in itertools.pairwise((1.0, 1.05, 2.1, 4.2, 10.5, 63.0)):
        own = [each for each in every if low <= each.interval < high]
        cells = []
        for name in ("stiffness", "damping"):
            over = np.array([getattr(each, name) for each in own])
            over = over[np.isfinite(over)]
            cells += [f"{x:.2f}" for x in np.quantile(over, [0.5, 0.1])] if over.size else ["", ""]
        shares.append((f"{low:g} to {high:g}", len(own), *cells))
    return [
        *table(
            ("belief", "walls", "random truths", "grow", "grow by search", "fastest [1/s]"),
            *counts,
        ),
        "",
        *table(
            ("interval [periods]", "walls", "K, median", "10 %", "B, median", "10 %"),
            *shares,
        ),
    ]


GROWS = 1e-6
"""Rate of growth that counts as such [1/s]"""


def beyond_lines(found: Found[tuple[int, int, float], list[LinkTrial]]) -> list[str]:
    """A table of what was noticed."""
    every = [trial for _, trials in found for trial in trials]
    rows = []
    for share in BEYOND:
        own = [t for t in every if t.share == share]
        seen = [t for t in own if not math.isnan(t.alarm_s)]
        missed = [t for t in own if math.isnan(t.alarm_s) and t.last > 0.9 * t.largest > 4.0]
        size, when = (np.array([getattr(t, n) for t in seen]) for n in ("last", "alarm_s"))
        rows.append(
            (
                f"{share:g}",
                str(len(own)),
                str(len(own) - len(seen) - len(missed)),
                str(len(seen)),
                str(len(missed)),
                f"{np.median(size):.0f}, {np.percentile(size, 95):.0f}" if seen else "",
                f"{np.median(when):.1f}, {np.percentile(when, 95):.1f}" if seen else "",
            )
        )
    head = (
        "B / ceiling",
        "servos",
        "dies, or stays below 4 counts",
        "alarm",
        "goes on above 4 counts without an alarm",
        "amplitude at the alarm [counts], median and 95 %",
        "time to it [s]",
    )
    return table(head, *rows)


def motor_lines(found: Found[tuple[int, int, float], list[MotorTrial]]) -> list[str]:
    """A table of what each way noticed, and when."""
    every = [trial for _, trials in found for trial in trials]
    rows = []
    for share in MOTOR:
        own = [t for t in every if t.share == share]
        alarmed = [t for t in own if not math.isnan(t.alarm_s)]
        both = [t for t in alarmed if not math.isnan(t.motor_s)]
        alone = [t for t in own if math.isnan(t.alarm_s) and not math.isnan(t.motor_s)]
        missed = [t for t in own if math.isnan(t.alarm_s) and t.last > 0.9 * t.largest > 4.0]
        middle = [
            f"{np.median([getattr(t, name) for t in both]):.2g}" if both else ""
            for name in ("alarm_s", "motor_s", "last", "motor_size")
        ]
        rows.append(
            (
                f"{share:g}",
                str(len(own)),
                str(len(alarmed)),
                str(len(missed)),
                str(len(both)),
                str(len(alone)),
                ", ".join(filter(None, middle[:2])),
                ", ".join(filter(None, middle[2:])),
            )
        )
    head = (
        "B / ceiling",
        "servos",
        "alarm",
        "goes on above 4 counts without an alarm",
        "at the motor, too",
        "at the motor alone",
        "where both: time of alarm, at the motor [s]",
        "amplitude [counts]",
    )
    return table(head, *rows)


MOTOR = (0.8, 1.2, 2.0)
"""The same, where the energy at the motor is judged"""

BEYOND = (0.8, 1.2, 1.5, 2.0)
"""Virtual dampings, over the ceiling of the vibration"""

STUDY = Study(
    "evidence/flexible-guard.md",
    (
        _searched("truths", "known", 0, case_s=4.0),
        _searched("wide", "wide", 200, case_s=8.0),
        _searched("lowpass", "lowpass", 300, case_s=4.0),
        _searched("notch", "notch", 300, case_s=4.0),
        Part(
            "served",
            lambda given: [
                Search(given.seed + 400, i, given.truths, given.steps, kind)
                for kind in KINDS
                for i in range(given.served)
            ],
            served,
            served_lines,
            case_s=6.0,
        ),
        Part(
            "contacts",
            lambda given: [(given.seed + 100, i) for i in range(given.contacts)],
            contacts,
            contact_lines,
            case_s=4.0,
        ),
        Part(
            "ways",
            lambda given: [
                (given.seed + i, given.servos, encoder, rigid)
                for i in range(3)
                for encoder, rigid in SERVO_KINDS
            ],
            ways,
            way_lines,
            case_s=30.0,
        ),
        Part(
            "beyond",
            lambda given: [
                (given.seed + 10 * i, given.links, share) for i in range(4) for share in BEYOND
            ],
            link_trials,
            beyond_lines,
            case_s=5.0,
        ),
        Part(
            "motor",
            lambda given: [(given.seed + 10 * i, given.links, s) for i in range(4) for s in MOTOR],
            motor_trials,
            motor_lines,
            case_s=5.0,
        ),
    ),
    (
        Option("beliefs", 110, "random beliefs", quick=3),
        Option("truths", 100, "random truths of each", quick=20),
        Option("steps", 12, "generations of the search", quick=2),
        Option("served", 60, "beliefs of each kind whose served intervals are searched", quick=2),
        Option("contacts", 200, "servos whose contacts are simulated", quick=4),
        Option("servos", 2000, "servos of each kind and seed on the way to lower gains", quick=40),
        Option("links", 15, "servos of each seed and share beyond the ceiling", quick=2),
        Option("seed", 1, "seed of the beliefs"),
    ),
)
