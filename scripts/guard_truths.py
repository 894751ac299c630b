"""Tries the guard's walls on servos with every effect of a real one, drawn and searched.

A truth lies inside its belief: inertia, viscous friction each way, Coulomb friction, torque gain,
the lag of drive and current loop, backlash. Effects that no belief contains (friction at rest and
of the load, weight, cogging, errors of the encoder, dead band, back-EMF) are drawn in addition.
Many walls are simulated at once, without the rest of the program; those that swing are run with it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import differential_evolution

from haptic_wall.controller.experiments.maps.loop import Wall
from haptic_wall.controller.experiments.maps.walls import Loop, noise_of, wall_of
from haptic_wall.controller.guard.belief import Belief, Bounded
from haptic_wall.controller.guard.guard import decide
from haptic_wall.controller.guard.types import Decision, GuardSettings, Request, Situation
from haptic_wall.controller.laws.wall import Side
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.hw.truth import TrueServo
from scripts.rates import upper_bound
from scripts.study import Found, Given, Part, table
from tests.support.contacts import restitution
from tests.support.real_servos import DEAD_BAND, KINDS, STATIC, STRIBECK
from tests.support.truth import COUNT

PERIOD = 1e-3
COUNTS = 4
"""Amplitude of a swing that must not go on [counts]"""
MARGIN = 0.8
KICKS = (0.02, 0.3)
"""Displacements from which a two-sided wall is let go [rad]"""
SECONDS = 2.0
WINDOW = 200
"""Of the amplitudes that are kept [periods]"""
BEGIN, BEFORE, END = slice(1, 5), slice(2, 6), slice(6, 10)
"""Windows whose largest are compared: half a slow swing fits into each of them"""
PHASES = (0.001, 0.33, 0.67, 0.999)
"""Of the entry into a one-sided wall within a period"""
SPEEDS = (0.0, 0.5, 1.0)
"""Of the entry, between the ends that the guard states, on a logarithmic scale"""
SLOWEST, FASTEST = 0.05, 6.0
"""Speeds of entry in any case [rad/s]"""
LONGEST = 700
"""Samples of a contact"""
TRUTHS = 20
"""Of each belief"""
BELIEFS = 25
"""In a case"""


class Base(NamedTuple):
    """A servo's published figures, and the widest that its belief may be."""

    inertia: float
    damping: float
    coulomb: float
    stall_torque: float
    no_load_speed: float
    longest_lag: float
    torque_step: float
    most_damping: float


_XL330, _XM430 = KINDS
BASES = (
    Base(*_XM430[1:], 0.002, 0.0048, 0.25),
    Base(*_XL330[1:], 0.005, 0.0005, 0.04),
)
"""XM430-W350 (by an MX-64) and XL330-M288; Rhoban's bam, and the e-manual"""
WIDTHS = {"inertia": 1.5, "damping": 2.0, "coulomb": 2.0, "gain": 1.4}
"""Largest factors between a believed value and its bounds"""
MOST = {
    "static": STATIC[1],
    "stribeck": STRIBECK[1],
    "load_friction": 0.13,
    "gravity": 0.1,
    "cogging": 0.01,
    "eccentricity": 0.0087,
    "noise": 0.34,
    "dead_band": DEAD_BAND,
    "droop": 0.05,
}
"""Largest size of each effect, near those of config/emulated-xm430.yaml; weight, cogging and dead
band over the stall torque, the static friction over the Coulomb friction"""
BELIEVED = (
    "servo",
    "inertia_width",
    "damping_width",
    "coulomb_width",
    "gain_width",
    "lag",
    "lag_width",
    "backlash",
    "age",
    "virtual_damping",
)
TRUE = (
    "inertia",
    "damping",
    "damping_back",
    "coulomb",
    "gain",
    "delay",
    "of_loop",
    "backlash",
    "static",
    "stribeck",
    "load_friction",
    "gravity",
    "gravity_angle",
    "cogging",
    "cogging_phase",
    "eccentricity",
    "encoder_phase",
    "noise",
    "dead_band",
    "droop",
    "back_emf",
)
"""Coordinates from 0 to 1 of a belief with its wall, and of a truth inside it"""


@dataclass(frozen=True, slots=True)
class Asked:
    """A belief with a wall, and what the guard commands there."""

    base: Base
    situation: Situation
    decision: Decision
    age: float


def asked(shares: FloatArray, side: Side) -> Asked:
    """The wall with the stiffness that the guard allows, for coordinates ``BELIEVED``."""
    u = dict(zip(BELIEVED, shares.tolist(), strict=True))
    base = BASES[min(int(u["servo"] * len(BASES)), len(BASES) - 1)]

    def around(value: float, name: str) -> Bounded:
        width = WIDTHS[name] ** u[f"{name}_width"]
        return Bounded(value, value / width, value * width)

    lag = u["lag"] * base.longest_lag
    backlash = math.radians(0.3) * u["backlash"]
    belief = Belief(
        inertia=around(base.inertia, "inertia"),
        damping=around(base.damping, "damping"),
        coulomb=around(base.coulomb, "coulomb"),
        delay=Bounded(lag, lag * (1.0 - u["lag_width"]), lag),
        torque_gain=around(1.0, "gain"),
        backlash=Bounded(backlash, 0.0, backlash),
    )
    situation = Situation(belief, PERIOD, base.stall_torque, COUNT)
    age = 1e-4 + 1.1e-3 * u["age"]
    request = Request(1e6, base.most_damping * u["virtual_damping"] ** 2, side)
    (decision,) = decide(request, GuardSettings(margin=MARGIN), situation, [age])
    return Asked(base, situation, decision, age)


class Truth(NamedTuple):
    """A wall on a servo inside a belief."""

    servo: TrueServo
    wall: Wall
    stiffness: float
    """[N·m/rad]"""
    lag: float
    """Time constant of the current loop [s]"""


def loop_of(truth: Truth, position: float, velocity: float, seed: int, periods: int) -> Loop:
    """Return the loop at its start; the seed decides the noise of its encoder."""
    noise = noise_of(replace(truth.servo, noise_seed=seed), PERIOD, periods)
    return Loop(truth.wall, truth.stiffness, position, velocity, noise=noise)


def truths(
    walls: list[Asked], shares: FloatArray, stiffness: FloatArray | None = None
) -> list[Truth]:
    """The walls on truths.

    Args:
        walls: The wall of each.
        shares: Coordinates ``TRUE`` of each, shape (n, number of coordinates).
        stiffness: In place of the commanded one [N·m/rad].
    """
    u = dict(zip(TRUE, shares.T, strict=True))

    def of_base(name: str) -> FloatArray:
        return np.array([getattr(each.base, name) for each in walls])

    def between(name: str, share: FloatArray) -> FloatArray:
        found = [getattr(each.situation.belief, name) for each in walls]
        low, high = (np.array([getattr(b, end) for b in found]) for end in ("low", "high"))
        value: FloatArray = low + share * (high - low)
        return value

    stall, gain = of_base("stall_torque"), between("torque_gain", u["gain"])
    device = between("delay", u["delay"])
    by_loop = np.clip(u["of_loop"], 0.02, 1.0) * device
    with np.errstate(divide="ignore"):
        bandwidth = np.where(by_loop > 1.6e-5, 1.0 / (math.tau * np.maximum(by_loop, 1.6e-5)), 0.0)
    by_loop = np.where(bandwidth > 0.0, by_loop, 0.0)
    age = np.array([each.age for each in walls])
    delay = age + device - by_loop
    coulomb, b = between("coulomb", u["coulomb"]), between("damping", u["damping"])
    commanded = np.array([each.decision.stiffness for each in walls])
    fastest = of_base("no_load_speed")
    values = {
        "inertia": between("inertia", u["inertia"]),
        "damping": b,
        "coulomb": coulomb,
        "backlash": np.maximum(between("backlash", u["backlash"]), 1e-9),
        "torque_limit": gain * stall,
        "torque_step": gain * of_base("torque_step"),
        "current_bandwidth": bandwidth,
        "dead_band": MOST["dead_band"] * u["dead_band"] * stall,
        "current_droop": MOST["droop"] * u["droop"],
        "no_load_speed": fastest,
        "static_friction": coulomb * MOST["static"] ** u["static"],
        "stribeck_speed": 0.05 + MOST["stribeck"] * u["stribeck"],
        "damping_back": between("damping", u["damping_back"]),
        "load_friction": MOST["load_friction"] * u["load_friction"],
        "gravity": MOST["gravity"] * u["gravity"] * stall,
        "gravity_angle": math.tau * u["gravity_angle"],
        "cogging": MOST["cogging"] * u["cogging"] * stall,
        "cogging_phase": math.tau * u["cogging_phase"],
        "encoder_eccentricity": MOST["eccentricity"] * u["eccentricity"],
        "encoder_phase": math.tau * u["encoder_phase"],
        "encoder_noise": MOST["noise"] * u["noise"],
    }
    virtual = gain * np.array([each.decision.damping for each in walls])
    stiff = gain * (commanded if stiffness is None else stiffness)
    found = []
    for i, each in enumerate(walls):
        given: dict[str, Any] = {name: float(value[i]) for name, value in values.items()}
        servo = TrueServo(
            counts_per_rev=round(math.tau / COUNT), back_emf=bool(u["back_emf"][i] > 0.5), **given
        )
        wall = wall_of(
            servo,
            period=PERIOD,
            delay=float(delay[i]),
            virtual_damping=float(virtual[i]),
            one_sided=each.decision.request.side != "both",
            # It errs by nothing at the wall: where the wall stands does not matter.
            offset=-servo.encoder_eccentricity * math.sin(servo.encoder_phase),
        )
        found.append(Truth(servo, wall, float(stiff[i]), float(by_loop[i])))
    return found


def amplitudes(truth: Truth, kick: float, seed: int) -> FloatArray:
    """Half the range of the true motion in each window, from a kick."""
    periods = round(SECONDS / PERIOD)
    at = loop_of(truth, kick, 0.0, seed, periods).run(periods)[:, 0]
    found: FloatArray = 0.5 * np.ptp(at.reshape(-1, WINDOW), axis=1)
    return found


def kicked(walls: list[Truth], seed: int) -> FloatArray:
    """``amplitudes`` from every kick, shape (windows, kicks, n)."""
    found = [[amplitudes(one, kick, seed + i) for i, one in enumerate(walls)] for kick in KICKS]
    return np.moveaxis(np.array(found), 2, 0)


def goes_on(found: FloatArray) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which walls grow, and which swing for ever, of ``kicked``."""
    first, before = (found[part].max(axis=0) for part in (BEGIN, BEFORE))
    last = np.sort(found[END], axis=0)[-2]  # one slip of a shaft at rest is no oscillation
    large = last > COUNTS * COUNT
    grows = large & (last > 1.02 * first)
    swings = large & (last > 0.97 * before)
    return grows.any(axis=0), swings.any(axis=0)


def energy(servo: TrueServo, position: FloatArray, velocity: FloatArray) -> FloatArray:
    """Kinetic energy and that of weight and cogging [J]."""
    n = servo.cogging_periods
    weight = -servo.gravity * np.cos(position - servo.gravity_angle)
    teeth = -servo.cogging / n * np.cos(n * position + servo.cogging_phase)
    found: FloatArray = 0.5 * servo.inertia * velocity * velocity + weight + teeth
    return found


def gained(walls: list[Truth], speed: FloatArray, phase: FloatArray, seed: int) -> FloatArray:
    """Log of kinetic energy after over before a contact; -inf: it does not come out."""
    each = enumerate(zip(walls, speed.tolist(), phase.tolist(), strict=True))
    return np.array([_gained(one, v, at, seed + i) for i, (one, v, at) in each])


def _gained(truth: Truth, speed: float, phase: float, seed: int) -> float:
    start = -speed * PERIOD * (1.0 + phase)
    course = loop_of(truth, start, speed, seed, LONGEST).run(LONGEST)
    x = np.concatenate([[start], course[:, 0]])
    e = energy(truth.servo, x, np.concatenate([[speed], course[:, 1]]))
    at_wall = float(energy(truth.servo, np.zeros(1), np.zeros(1))[0])
    after = truth.wall.whole + 3 + math.ceil(8.0 * truth.lag / PERIOD)
    came, went, outside, inside = math.nan, -math.inf, 0, False
    for k, measured in enumerate(course[:, 2].tolist()):
        before, at, now = float(x[k]), float(x[k + 1]), float(e[k + 1])
        if inside != (at > 0.0):
            crossing = float(e[k]) + (now - float(e[k])) * before / (before - at)
            came = crossing if math.isnan(came) else came
            went = max(crossing, now)
        inside = at > 0.0
        if inside:
            went = -math.inf
        elif not math.isnan(came):
            went = max(went, now)
        outside = outside + 1 if not inside and not math.isnan(came) and measured <= 0.0 else 0
        if outside > after:
            return math.log(max(went - at_wall, 1e-300) / max(came - at_wall, 1e-12))
    return -math.inf


def speeds_of(wall: Asked) -> tuple[float, float]:
    """Least and greatest speed at which counts and saturation matter little [rad/s].

    Below the least one, the error of one count may do more work than an ideal contact takes; above
    the greatest one, the torque may saturate.
    """
    d, situation = wall.decision, wall.situation
    belief, t = situation.belief, situation.period
    gain = belief.torque_gain.high
    one_count = situation.position_step * (d.stiffness + abs(d.damping) / t)
    m, m_most = belief.inertia.low, belief.inertia.high
    k, b = gain * d.stiffness, gain * d.damping
    kept = float(restitution(m, belief.damping.low, k, b, t, d.delay))
    low = 4.0 * gain * one_count / (math.sqrt(m * k) * max(1.0 - kept, 1e-3))
    longest = d.delay + t + math.sqrt(m_most / k)
    high = (situation.torque_limit - one_count) / (d.stiffness * longest + max(d.damping, 0.0))
    return max(low, SLOWEST), min(high, FASTEST)


class Share(NamedTuple):
    """One belief: the commanded stiffness over margin times the true limit of its worst corner."""

    share: float
    """NaN: nothing is commanded, and none is stable"""
    binding: str


class Row(NamedTuple):
    """Results for the truths of some beliefs."""

    tried: int
    """Truths"""
    refused: int
    """Truths of beliefs where nothing is commanded, or no speed is stated"""
    grow: int
    swing: int
    throw: int
    shares: list[Share]


def shares_for(count: int, size: int, random: np.random.Generator) -> FloatArray:
    """Coordinates of ``count`` points: uniform, a third of them at an end."""
    found = random.random((count, size))
    ends = random.random((count, size)) < 1.0 / 3.0
    return np.where(ends, np.rint(found), found)


def drawn(case: tuple[int, int, Side]) -> Row:
    """Draw some beliefs, and truths inside each; try what the guard commands."""
    seed, number, side = case
    random = np.random.default_rng((seed, number, side == "both"))
    believed = shares_for(BELIEFS, len(BELIEVED), random)
    walls = [asked(each, side) for each in believed]
    shares = shares_for(BELIEFS * TRUTHS, len(TRUE), random)
    owner = np.repeat(np.arange(BELIEFS), TRUTHS)
    some = [index for index in range(BELIEFS) if walls[index].decision.stiffness > 0.0]
    chosen = np.flatnonzero(np.isin(owner, some))
    each = [walls[owner[index]] for index in chosen]

    grow = swing = throw = 0
    refused = owner.size - chosen.size
    if side == "both":
        grows, swings = goes_on(kicked(truths(each, shares[chosen]), number))
        grow, swing = int(grows.sum()), int(swings.sum())
    else:
        ends = {id(wall): speeds_of(wall) for wall in walls if wall.decision.stiffness > 0.0}
        stated = np.array([ends[id(wall)] for wall in each])
        refused += int(np.sum(stated[:, 1] <= stated[:, 0]))
        throw = int(np.sum(thrown(truths(each, shares[chosen]), stated, number) > 0.0))
    return Row(owner.size, refused, grow, swing, throw, corner_shares(walls, side, number))


class Beyond(NamedTuple):
    """Results for truths at a multiple of the commanded stiffness."""

    tried: int
    grow: int
    swing: int
    throw: int


def stiffer(case: tuple[int, int, Side, float]) -> Beyond:
    """Try walls that are stiffer than the guard commands: whether the trial notices it."""
    seed, number, side, factor = case
    random = np.random.default_rng((seed, number, side == "both"))
    walls = [asked(each, side) for each in shares_for(BELIEFS, len(BELIEVED), random)]
    each = [wall for wall in walls if wall.decision.stiffness > 0.0 for _ in range(TRUTHS)]
    stiffness = factor * np.array([wall.decision.stiffness for wall in each])
    some = truths(each, shares_for(len(each), len(TRUE), random), stiffness)
    if side == "both":
        grows, swings = goes_on(kicked(some, number))
        return Beyond(len(each), int(grows.sum()), int(swings.sum()), 0)
    stated = np.broadcast_to((0.5, 3.0), (len(each), 2))
    return Beyond(len(each), 0, 0, int(np.sum(thrown(some, stated, number) > 0.0)))


FACTORS = (1.0, 2.0, 4.0)


def stiffer_cases(given: Given) -> Iterator[tuple[int, int, Side, float]]:
    """A block of beliefs, two-sided and one-sided, at each multiple."""
    for factor in FACTORS:
        yield given.seed, 1000, "both", factor
        yield given.seed, 1000, "above", factor


def stiffer_lines(found: Found[tuple[int, int, Side, float], Beyond]) -> list[str]:
    """A line for each multiple."""
    cells = []
    for factor in FACTORS:
        both, above = (
            next(row for case, row in found if case[2:] == (side, factor))
            for side in ("both", "above")
        )
        of = f"of {both.tried}"
        cells.append((f"{factor:g}", f"{both.grow} {of}", both.swing, above.throw))
    head = ("K over the commanded", "grow", "swing on", "throw back")
    return list(table(head, *cells))


def thrown(walls: list[Truth], stated: FloatArray, seed: int) -> FloatArray:
    """Greatest ``gained`` of each wall, over speeds between the stated ends and phases."""
    size = len(walls)
    low, high = stated.T
    grid = [(s, p) for s in SPEEDS for p in PHASES]
    index = np.repeat(np.arange(size), len(grid))
    share, phase = np.tile(np.array(grid).T, size)
    ratio = np.maximum(high, low) / low
    speed = low[index] * ratio[index] ** share
    found = gained([walls[i] for i in index], speed, phase, seed)
    worst: FloatArray = found.reshape(size, -1).max(axis=1)
    return np.where(high > low, worst, -np.inf)


NOTHING = "nothing commanded"
"""Binding, where the asked damping alone is rougher than allowed"""
CORNER = {
    "inertia": 0.0,
    "damping": 0.0,
    "damping_back": 0.0,
    "coulomb": 0.0,
    "gain": 1.0,
    "delay": 1.0,
    "backlash": 1.0,
}
"""The worst corner of a belief; every other coordinate is 0: no effect that helps"""
STIFFNESSES = np.geomspace(0.7, 7.0, 12)
"""That are tried on it, over the commanded one"""


def corner_shares(walls: list[Asked], side: Side, seed: int) -> list[Share]:
    """Commanded stiffness over margin times the least that is bad on the worst corner."""
    some = [wall for wall in walls if wall.decision.stiffness > 0.0]
    many = [wall for wall in some for _ in STIFFNESSES]
    corner = np.array([[CORNER.get(name, 0.0) for name in TRUE]] * len(many))
    commanded = np.array([wall.decision.stiffness for wall in some])
    at = truths(many, corner, np.outer(commanded, STIFFNESSES).ravel())
    if side == "both":
        bad = goes_on(kicked(at, seed))[1]
    else:
        exact = [one._replace(wall=one.wall._replace(limit=1e3, counts=1e6)) for one in at]
        stated = np.broadcast_to((0.5, 3.0), (len(many), 2))
        bad = thrown(exact, stated, seed) > 0.0
    bad = bad.reshape(len(some), -1)
    first = np.where(bad.any(axis=1), bad.argmax(axis=1), STIFFNESSES.size - 1)
    shares = 1.0 / (MARGIN * STIFFNESSES[first])
    names = [str(wall.decision.binding) for wall in some]
    found = [Share(float(a), name) for a, name in zip(shares, names, strict=True)]
    return found + [Share(0.0, NOTHING)] * (len(walls) - len(some))


def cases(given: Given) -> Iterator[tuple[int, int, Side]]:
    """Blocks of beliefs, two-sided and one-sided in turn."""
    for number in range(max(2, round(given.servos / (TRUTHS * BELIEFS)))):
        yield given.seed, number, "above" if number % 2 else "both"


def none_bad(found: Found[tuple[int, int, Side], Row]) -> bool:
    """Whether no truth is a counter-example."""
    return not any(row.grow or row.swing or row.throw for _, row in found)


def lines(found: Found[tuple[int, int, Side], Row]) -> list[str]:
    """Rates with bounds, and how timid the guard is."""
    return [*rates(found), "", *timidity(found)]


def rates(found: Found[tuple[int, int, Side], Row]) -> list[str]:
    """How many truths came to each bad end."""
    cells = []
    for side, name in (("both", "two-sided"), ("above", "one-sided")):
        rows = [row for case, row in found if case[2] == side]
        tried = sum(row.tried - row.refused for row in rows)
        for what in ("grow", "swing") if side == "both" else ("throw",):
            bad = sum(getattr(row, what) for row in rows)
            words = {"grow": "grow", "swing": "swing on", "throw": "throw back"}
            cells.append((name, words[what], tried, bad, f"{100 * upper_bound(bad, tried):.2g} %"))
    head = ("wall", "that", "truths", "number", "rate at most (95 %)")
    return list(table(head, *cells))


ROUGH = ("quantisation", NOTHING)
"""The limits that bind if the wall would be rough"""


def timidity(found: Found[tuple[int, int, Side], Row]) -> list[str]:
    """Quantiles of what is commanded, over margin times the worst corner's true limit."""
    cells = []
    for side, name in (("both", "two-sided"), ("above", "one-sided")):
        some = [one for case, row in found if case[2] == side for one in row.shares]
        values = np.array([one.share for one in some if one.binding not in ROUGH])
        spread = (f"{v:.2f}" for v in np.quantile(values, (0.1, 0.5)))
        cells.append((name, values.size, *spread))
    return list(table(("wall", "beliefs", "tenth percentile", "median"), *cells))


class Worst(NamedTuple):
    """The result of a search."""

    goal: str
    evaluated: int
    worst: float


def growth(walls: list[Asked], shares: FloatArray, seed: int) -> FloatArray:
    """Return the growth from the worst kick of each two-sided wall.

    The log of an amplitude at the end over one at the beginning, or over four counts if that is
    more.
    """
    found = kicked(truths(walls, shares), seed) + 0.1 * COUNT
    begun, ended = (found[part].max(axis=0) for part in (BEGIN, END))
    goal: FloatArray = np.log(ended / np.maximum(begun, COUNTS * COUNT)).max(axis=0)
    return goal


def energy_returned(walls: list[Asked], shares: FloatArray, seed: int) -> FloatArray:
    """Return the greatest log of energy after over before of each one-sided wall."""
    stated = np.array([speeds_of(wall) for wall in walls])
    return np.maximum(thrown(truths(walls, shares), stated, seed), -9.0)


Goal = Callable[[list[Asked], FloatArray, int], FloatArray]
GOALS: dict[str, tuple[Side, Goal]] = {
    "growth of a two-sided wall": ("both", growth),
    "return of a one-sided wall": ("above", energy_returned),
}


def cost(points: FloatArray, goal: str, seed: int) -> FloatArray:
    """Return minus the goal of coordinates, shape (size, n); 9: nothing is commanded."""
    side, of_goal = GOALS[goal]
    walls = [asked(each[: len(BELIEVED)], side) for each in points.T]
    stable = [i for i, wall in enumerate(walls) if wall.decision.stiffness > 0.0]
    result = np.full(len(walls), 9.0)
    if stable:
        shares = points.T[stable, len(BELIEVED) :]
        result[stable] = -of_goal([walls[i] for i in stable], shares, seed)
    return result


def searched(case: tuple[int, str, int, int]) -> Worst:
    """Search for the worst truth in any belief by differential evolution."""
    seed, goal, size, generations = case
    found = differential_evolution(
        partial(cost, goal=goal, seed=seed),
        [(0.0, 1.0)] * (len(BELIEVED) + len(TRUE)),
        maxiter=generations,
        popsize=size,
        vectorized=True,
        updating="deferred",
        polish=False,
        rng=seed,
        tol=0.0,
        init="random",
    )
    tried = size * (len(BELIEVED) + len(TRUE)) * (found.nit + 1)
    return Worst(goal, tried, -float(found.fun))


def searches(given: Given) -> list[tuple[int, str, int, int]]:
    """Both goals; the second, whose speeds take long to find, with half as many walls."""
    sizes = (given.population, max(1, given.population // 2))
    return [
        (given.seed, goal, size, given.generations) for goal, size in zip(GOALS, sizes, strict=True)
    ]


def search_lines(found: Found[tuple[int, str, int, int], Worst]) -> list[str]:
    """Return a table with the result of each search."""
    head = ("searched for", "walls tried", "worst")
    cells = [(row.goal, row.evaluated, f"{row.worst:+.3f}") for _, row in found]
    return list(table(head, *cells))


DRAWN = Part("drawn", cases, drawn, lines, case_s=30.0, wanted=none_bad)
STIFFER = Part("stiffer", stiffer_cases, stiffer, stiffer_lines, case_s=20.0)
SEARCHED = Part("searched", searches, searched, search_lines, case_s=600.0)
