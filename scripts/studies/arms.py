"""Searches for an arm on which the guard's walls grow or gain energy, each axis decided alone.

scripts/study arms [--arms N] [--flexible N] [--searches N] [--walls N] [--hours H] [--seed S]
                   [--only PART] [--quick]

An arm is a serial chain of point masses in a pose, with a servo's inertia at each joint:
M = links + diag(armature). The guard knows the servos alone, one period, and the longest delay.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm
from scipy.optimize import differential_evolution

from haptic_wall.controller.guard.belief import Belief, Bounded, vibration
from haptic_wall.controller.guard.guard import decide
from haptic_wall.controller.guard.types import GuardSettings, Request, Situation
from haptic_wall.controller.laws.wall import Side
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.controller.theory.servos import SERVOS
from scripts.arm_trials import PARTS
from scripts.study import Found, Given, Option, Part, Study, table
from tests.support.operators import draw_grips

PERIOD = 1e-3
"""Only the products of rates with it matter [s]"""
HEAVIEST = 30.0
"""Largest inertia of the links at a joint, over the armature there [1]"""
GROWS = 1e-8
"""Growth of a pole that counts [1/period]"""
GAINS = 1.0 + 1e-6
"""Energy after over energy before that counts [1]"""
SCALES = 40.0
"""Largest factor that is tried on all stiffnesses [1]"""
COUNT = math.tau / 4096.0
"""Of the encoder, in half of the throws [rad]"""
NEARLY = 0.99 / GuardSettings().margin
"""Factor on the commanded stiffness in a search: 0.99 of the servo's own limit [1]"""
_THROWS, _TICKS = 8, 800
_DELAYS = tuple(0.25 * i for i in range(13))
"""Longest delays of arms [periods]"""
_SHARES = (0.02, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7)
"""B over its ceiling [1]"""
_LIMITS = {"MX-64": 4.1, "MX-106": 8.4, "XL330-M288": 0.52, "XL-320": 0.39}
"""Torque limits of the servos [N·m]"""
_NAMES = tuple(_LIMITS)


class Outcome(NamedTuple):
    """What one arm's walls do."""

    axes: int
    growth: float
    """Of the fastest pole, all walls in contact or some, two-sided [1/period]"""
    gained: float
    """Largest energy after throws at one-sided walls, over that before [1]; 0: none was tried"""
    limit: float
    """Factor on all stiffnesses at which the arm becomes unstable [1]; 0: not tried"""


def links(random: np.random.Generator, n: int) -> tuple[FloatArray, FloatArray]:
    """Return the inertia of a random chain's links in a random pose, and the tip's Jacobian."""
    bent = random.standard_normal((n, 3))
    if random.random() < 0.3:  # a planar arm
        bent = np.tile([0.0, 0.0, 1.0], (n, 1))
    turns = bent / np.linalg.norm(bent, axis=1)[:, None]
    ways = random.standard_normal((n, 3)) * np.exp(random.uniform(-1.5, 0.0, (n, 1)))
    ends = np.cumsum(ways, axis=0)
    starts = ends - ways
    inertia = np.zeros((n, n))
    jacobian = np.zeros((3, n))
    for k in range(n):
        jacobian = np.zeros((3, n))
        jacobian[:, : k + 1] = np.cross(turns[: k + 1], ends[k] - starts[: k + 1]).T
        inertia += math.exp(random.uniform(-4.0, 0.0)) * jacobian.T @ jacobian
    return inertia, jacobian


def held(
    tip: FloatArray, armature: FloatArray, random: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Return spring and damper of a hand at the tip, in the joints; a grip as in other trials."""
    joints = tip.T @ tip
    most = int(np.argmax(np.diag(joints)))
    spring, damper = draw_grips(armature[most : most + 1], random)
    joints /= joints[most, most]
    return spring[0] * joints, damper[0] * joints


@cache
def commanded(name: str, rubs: float, share: float, side: Side, count: float = 0.0) -> FloatArray:
    """Return K and B that the guard commands for a bare servo at each of the longest delays.

    ``rubs``: its viscous friction over the published one; ``share``: B over its ceiling [1].
    """
    servo, exactly = SERVOS[name], Bounded.exactly
    friction, none = exactly(rubs * servo.damping), exactly(0.0)
    belief = Belief(exactly(servo.inertia), friction, none, none, exactly(1.0))
    situation = Situation(belief, PERIOD, _LIMITS[name], count)
    request, settings = Request(1e9, 1e9, side), GuardSettings(damping_cap=share)
    delays = [delay * PERIOD for delay in _DELAYS]
    found = decide(request, settings, situation, delays)
    return np.array([[one.stiffness, one.damping] for one in found])


def flexible_belief(name: str, random: np.random.Generator) -> Belief:
    """Return a belief about a bare servo, up to as wide as a preset's, with a load of any size."""

    def about(value: float, most: float) -> Bounded:
        factor = most ** random.choice([0.0, random.random(), 1.0])
        return Bounded(value, value / factor, value * factor)

    servo, lag = SERVOS[name], PERIOD * random.uniform(0.0, 2.0)
    inertia = about(servo.inertia, 1.5)
    load = Bounded(servo.inertia, 0.01 * servo.inertia, 100.0 * servo.inertia)
    stiffness = about(servo.inertia * math.exp(random.uniform(8.0, 11.5)), 4.0)
    return Belief(
        inertia,
        about(servo.damping, 2.0),
        Bounded.exactly(0.0),
        Bounded(lag, lag * random.choice([0.0, 1.0]), lag),
        about(1.0, 1.35),
        load_inertia=load,
        flexible_hz=vibration(inertia, load, stiffness, bare=True),
        flexible_damping_ratio=about(math.exp(random.uniform(-4.6, -2.0)), 3.0),
        transmission_stiffness=stiffness,
        bare=True,
    )


@cache
def commanded_flexible(setting: int) -> tuple[list[tuple[Belief, float, float]], float]:
    """Return belief, K and B of four servos with flexible joints, and the longest delay [s]."""
    random = np.random.default_rng(setting)
    age, settings = PERIOD * random.uniform(0.0, 2.0), GuardSettings(damping_cap=0.5)
    beliefs = [flexible_belief(str(name), random) for name in random.choice(_NAMES, 4)]
    longest = max(one.delay.high for one in beliefs)
    found = []
    for each in beliefs:
        belief = replace(each, delay=replace(each.delay, high=longest))
        situation = Situation(belief, PERIOD, 4.1, 0.0)
        wall = decide(Request(1e9, 1e9, "both"), settings, situation, [age])[0]
        found.append((belief, wall.stiffness, wall.damping))
    return found, age + longest


class Loop:
    """An arm's exactly discretised motion under late torques on the first of its masses.

    The last ones are measured. ``delays`` are in periods.
    """

    def __init__(
        self, mass: FloatArray, damping: FloatArray, spring: FloatArray, delays: FloatArray
    ) -> None:
        total, n = len(mass), len(delays)
        inverse = np.linalg.inv(mass)
        self.outputs = np.arange(total - n, total)
        motion = np.zeros((2 * total + n, 2 * total + n))
        motion[:total, total : 2 * total] = np.eye(total)
        motion[total : 2 * total, :total] = -inverse @ spring
        motion[total : 2 * total, total : 2 * total] = -inverse @ damping
        motion[total : 2 * total, 2 * total :] = inverse[:, :n]
        size = 2 * total

        def held(span: float) -> FloatArray:
            result: FloatArray = expm(motion * span * PERIOD)
            return result[:size]

        whole = held(1.0)
        self.free = whole[:, :size]
        self.late = np.floor(delays).astype(int)
        self.now, self.before = np.zeros((size, n)), np.zeros((size, n))
        for i, delay in enumerate(delays):
            after = held(1.0 - delay % 1.0)
            self.now[:, i] = after[:, size + i]
            self.before[:, i] = whole[:, size + i] - after[:, size + i]

    def growth(self, stiffness: FloatArray, damping: FloatArray) -> float:
        """Return the growth of the fastest pole with walls that always act [1/period]."""
        size, n = self.now.shape
        steps = int(self.late.max()) + 1
        torque = np.zeros((n, size + n + n * steps))  # of the state, the last place, the last ones
        rows = np.arange(n)
        torque[rows, self.outputs] = -stiffness - damping / PERIOD
        torque[rows, size + rows] = damping / PERIOD
        step = np.zeros((torque.shape[1],) * 2)
        step[:size, :size] = self.free
        step[size + rows, self.outputs] = 1.0
        step[size + n : size + 2 * n] = torque
        step[size + 2 * n :, size + n : -n] = np.eye(n * (steps - 1))
        for i, late in enumerate(self.late.tolist()):
            for weight, ago in ((self.now[:, i], late), (self.before[:, i], late + 1)):
                if ago == 0:
                    step[:size] += np.outer(weight, torque[i])
                else:
                    step[:size, size + n * ago + i] += weight
        return float(np.log(np.abs(np.linalg.eigvals(step)).max()))

    def gained(
        self,
        mass: FloatArray,
        walls: FloatArray,
        count: float,
        random: np.random.Generator,
    ) -> float:
        """Return the largest kinetic energy after throws at walls above 0, over that before [1]."""
        n, last = len(mass), int(self.late.max()) + 1
        stiffness, damping = (each[:, None] for each in walls)
        speed = np.linalg.solve(np.linalg.cholesky(mass).T, random.standard_normal((n, _THROWS)))
        away = -np.abs(speed) * PERIOD * random.uniform(0.0, 8.0, (n, _THROWS))
        state, before = np.vstack([away, speed]), away - speed * PERIOD
        energy = np.einsum("is,ij,js->s", speed, mass, speed)
        sent = np.zeros((last + 1, n, _THROWS))
        most, rows = np.zeros(_THROWS), np.arange(n)
        for _ in range(_TICKS):
            place = np.rint(state[:n] / count) * count if count else state[:n]
            torque = -stiffness * place - damping * (place - before) / PERIOD
            sent = np.roll(sent, 1, axis=0)
            sent[0] = np.where(place > 0.0, np.minimum(torque, 0.0), 0.0)
            before = place
            state = self.free @ state + self.now @ sent[self.late, rows]
            state += self.before @ sent[self.late + 1, rows]
            clear = ~sent.any(axis=(0, 1))
            left = np.einsum("is,ij,js->s", state[n:], mass, state[n:]) / energy
            most = np.where(clear, np.maximum(most, left), most)
            if (clear & (state[n:] <= 0.0).all(axis=0)).all():
                break
        return float(most.max())


def limit_of(loop: Loop, stiffness: FloatArray, damping: FloatArray) -> float:
    """Return the factor on all stiffnesses at which the arm becomes unstable [1]."""
    low, high = 0.0, SCALES
    for _ in range(10):
        middle = 0.5 * (low + high)
        stable = loop.growth(middle * stiffness, damping) <= GROWS
        low, high = (middle, high) if stable else (low, middle)
    return low


def arm_row(case: tuple[int, int]) -> Outcome:
    """Return what a random arm's walls do, by seed and number."""
    random = np.random.default_rng(case)
    n = int(random.integers(2, 7))
    names = [str(name) for name in random.choice(_NAMES, n)]
    number = int(random.integers(0, 13))
    longest = _DELAYS[number]
    delays = np.full(n, longest) if random.random() < 0.5 else random.uniform(0.0, longest, n)
    delays[random.integers(n)] = longest
    armature = np.array([SERVOS[name].inertia for name in names])
    if random.random() < 0.5:
        armature = armature * random.uniform(1.0, 1.5, n)
    added, tip = links(random, n)
    heaviest = math.exp(random.uniform(math.log(0.01), math.log(HEAVIEST)))
    mass = np.diag(armature) + added * heaviest / np.max(np.diag(added) / armature)
    rubs = float(random.choice([1.0, 0.1]))
    friction = rubs * np.diag([SERVOS[name].damping for name in names])
    shares = random.choice(_SHARES, n) if random.random() < 0.7 else np.full(n, 0.7)
    count = COUNT if random.random() < 0.5 else 0.0

    def walls(side: Side, step: float = 0.0) -> FloatArray:
        each = zip(names, shares, strict=True)
        return np.transpose([commanded(x, rubs, float(y), side, step)[number] for x, y in each])

    acts = random.random(n) < (1.0 if random.random() < 0.5 else 0.6)
    hand, drag = np.zeros((n, n)), friction
    if random.random() < 0.5:
        hand, damper = held(tip, armature, random)
        drag = friction + damper
    loop = Loop(mass, drag, hand, delays)
    stiffness, damping = walls("both")
    growth = max(loop.growth(acts * stiffness, acts * damping), loop.growth(stiffness, damping))
    gained = 0.0
    if not hand.any():
        gained = loop.gained(mass, acts * walls("above", count), count, random)
    limit = limit_of(loop, stiffness, damping) if case[1] % 5 == 0 else 0.0
    return Outcome(n, growth, gained, limit)


def flexible_row(case: tuple[int, int]) -> Outcome:
    """Return what the walls of a random arm with flexible joints within the beliefs do."""
    random = np.random.default_rng(case)
    walls, longest = commanded_flexible(case[1] // 20)
    n, corner = int(random.integers(2, 5)), random.random() < 0.5
    beliefs = [belief for belief, _, _ in walls[:n]]

    def drawn(name: str) -> FloatArray:
        shares = random.choice([0.0, 0.0, 1.0], n) if corner else random.random(n)
        ends = np.array([(each.low, each.high) for each in (getattr(b, name) for b in beliefs)])
        found: FloatArray = ends[:, 0] * (ends[:, 1] / ends[:, 0]) ** shares
        return found

    motors, k, friction = (drawn(x) for x in ("inertia", "transmission_stiffness", "damping"))
    c, gain = 2.0 * drawn("flexible_damping_ratio") * np.sqrt(k * motors), drawn("torque_gain")
    added, _ = links(random, n)
    heaviest = math.exp(random.uniform(math.log(0.01), math.log(HEAVIEST)))
    lightest = np.array([belief.load_inertia.low for belief in beliefs])
    load = np.diag(lightest) + added * heaviest / np.max(np.diag(added) / motors)
    between = np.block([[np.eye(n), -np.eye(n)], [-np.eye(n), np.eye(n)]])
    drag = between * np.tile(c, 2) + np.diag([*friction, *[0.0] * n])
    mass = np.block([[np.diag(motors), np.zeros((n, n))], [np.zeros((n, n)), load]])
    loop = Loop(mass, drag, between * np.tile(k, 2), np.full(n, longest / PERIOD))
    stiffness, damping = (gain * [wall[i] for wall in walls[:n]] for i in (1, 2))
    return Outcome(n, loop.growth(stiffness, damping), 0.0, limit_of(loop, stiffness, damping))


def searched_row(case: tuple[int, int]) -> Outcome:
    """Return the fastest growth that an optimiser finds, without a margin of the stiffness."""
    random = np.random.default_rng(case)
    n = int(random.integers(2, 4))
    names = [str(name) for name in random.choice(_NAMES, n)]
    armature = np.array([SERVOS[name].inertia for name in names])
    friction = np.diag([SERVOS[name].damping for name in names])
    number = int(random.integers(0, 13))
    longest = _DELAYS[number]
    root, corner = np.diag(np.sqrt(armature)), np.tril_indices(n)

    def growth(values: FloatArray) -> float:
        factor = np.zeros((n, n))
        factor[corner] = values[: len(corner[0])]
        mass = np.diag(armature) + root @ factor @ factor.T @ root
        rest = values[len(corner[0]) :]
        shares = [_SHARES[int(x * (len(_SHARES) - 0.01))] for x in rest[:n]]
        walls = [commanded(x, 1.0, y, "both")[number] for x, y in zip(names, shares, strict=True)]
        stiffness, damping = np.array(walls).T
        delays = longest * np.append(1.0, rest[n:])
        return Loop(mass, friction, np.zeros((n, n)), delays).growth(NEARLY * stiffness, damping)

    most = math.sqrt(HEAVIEST / n)
    bounds = [(-most, most)] * len(corner[0]) + [(0.0, 1.0)] * (2 * n - 1)
    found = differential_evolution(
        lambda values: -growth(values), bounds, maxiter=40, popsize=6, rng=random, polish=False
    )
    return Outcome(n, -float(found.fun), 0.0, 0.0)


def _cases(name: str, salt: int) -> Callable[[Given], Iterator[tuple[int, int]]]:
    return lambda given: ((given.seed + salt, i) for i in range(getattr(given, name)))


def _lines(found: Found[tuple[int, int], Outcome]) -> Iterable[str]:
    rows = [row for _, row in found]
    kinds = [(str(n), [row for row in rows if row.axes == n]) for n in range(2, 7)]
    yield from table(
        ("axes", "arms", "grow", "throws that gain", "commanded K over its limit"),
        *(_line(*each) for each in [*kinds, ("all", rows)] if each[1]),
    )


def _line(name: str, rows: list[Outcome]) -> tuple[object, ...]:
    thrown = [row.gained for row in rows if row.gained > 0.0]
    limits = [1.0 / row.limit for row in rows if row.limit > 0.0]
    low, middle, high = np.nanpercentile(limits, (5, 50, 95)) if limits else [math.nan] * 3
    grow = sum(row.growth > GROWS for row in rows)
    return (
        name,
        len(rows),
        f"{grow} (below {3.0 / len(rows):.2g})" if grow == 0 else grow,
        f"{sum(x > GAINS for x in thrown)} of {_THROWS * len(thrown)}" if thrown else "",
        "" if math.isnan(middle) else f"{middle:.2f} ({low:.2f} to {high:.2f})",
    )


def _none(found: Found[tuple[int, int], Outcome]) -> bool:
    return all(row.growth <= GROWS and row.gained <= GAINS for _, row in found)


STUDY = Study(
    "evidence/arms.md",
    (
        Part("arms", _cases("arms", 0), arm_row, _lines, case_s=0.3, wanted=_none),
        Part("flexible", _cases("flexible", 1), flexible_row, _lines, case_s=0.2, wanted=_none),
        Part("searched", _cases("searches", 2), searched_row, _lines, case_s=60.0, wanted=_none),
        *PARTS,
    ),
    (
        Option("arms", 10_000, "random stiff arms and poses", quick=20),
        Option("flexible", 3000, "random arms with flexible joints", quick=10),
        Option("searches", 20, "searches for a stiff arm that grows", quick=1),
        Option("walls", 100, "random arms with walls for each range of lags", quick=1),
        Option("hours", 10.0, "hours of hands at the tip", quick=0.1),
        Option("seed", 1, "seed of all draws"),
    ),
)
