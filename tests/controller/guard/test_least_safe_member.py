"""Searches random beliefs for the servo on which a commanded wall is least stable; poles decide."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.optimize import differential_evolution

from haptic_wall.controller.guard.belief import LIGHTEST, Belief, Bounded, vibration
from haptic_wall.controller.guard.guard import decide
from haptic_wall.controller.guard.types import WITHIN, Decision, GuardSettings, Request, Situation
from haptic_wall.controller.theory import (
    critical_stiffness,
    max_virtual_damping,
)
from haptic_wall.controller.theory.boundary import chain_boundary, chain_ceiling
from haptic_wall.controller.theory.chain import two_masses
from haptic_wall.controller.theory.checks import FloatArray
from tests.cases import sampled
from tests.support.beliefs import belief
from tests.theory import oracles

NAMES = (
    *("inertia", "damping", "torque_gain", "load_inertia", "flexible_hz"),
    *("flexible_damping_ratio", "delay"),
)


class Case(NamedTuple):
    """A belief, and the wall that is asked for."""

    belief: Belief
    asked: float = 0.0
    """B over the highest that is commanded; below 0: over the least friction"""
    period: float = 1e-3
    age: float = 0.0
    samples: int = 1


def drawn(random: np.random.Generator, rigid: bool) -> Case:
    """Draw loads of 0.01 to 100 times the motor's, 2 to 200 Hz, friction in doubt of up to 10."""

    def between(low: float, high: float) -> float:
        return float(np.exp(random.uniform(math.log(low), math.log(high))))

    def doubted(value: float, most: float) -> Bounded:
        factor = math.sqrt(random.choice([1.0, most, between(1.001, most)]))
        return Bounded(value, value / factor, value * factor)

    motor = between(3e-4, 0.05)
    load = motor * between(0.01, 100.0)
    lag = random.uniform(0.0, 8e-3)
    link: dict[str, Any] = {
        "load_inertia": doubted(min(load, 0.99 * (motor + load)), between(1.5, 30.0)),
        "flexible_hz": doubted(between(2.0, 200.0), between(1.2, 10.0)),
        "flexible_damping_ratio": doubted(between(0.002, 0.3), 10.0),
        "encoder": random.choice(["motor", "output", "output"]),
    }
    found = belief(
        inertia=doubted(motor + load, 4.0),
        damping=doubted((motor + load) * between(0.05, 60.0), 10.0),
        delay=Bounded(lag, lag * random.choice([0.0, 1.0, random.random()]), lag),
        torque_gain=doubted(1.0, 2.0),
        **({} if rigid else link),
    )
    asked = random.choice([0.0, 1.0, random.uniform(-0.99, 1.0), between(0.01, 1.0)])
    period, age = random.choice([1e-3, 1e-3, 2e-3, 4e-3]), random.choice([0.0, 2e-3])
    return Case(found, float(asked), float(period), float(age), int(random.choice([1, 1, 2, 4])))


def members(case: Case, shares: FloatArray) -> FloatArray:
    """Return servos of the belief, and the period of each; rows of shares of the box."""
    known = case.belief
    box = [getattr(known, name) for name in NAMES]
    # of a rigid servo, and of a vibration too fast to be sampled, the margin covers the jitter
    jitter = WITHIN if known.is_flexible and not known.is_fast(case.period) else 1.0
    low = np.array([each.low for each in box] + [case.period])
    high = np.array([each.high for each in box] + [jitter * case.period])
    low[3] = max(low[3], LIGHTEST * high[3])
    high[6] += case.age
    found: FloatArray = low + shares * (high - low)
    return found


def limits(case: Case, some: FloatArray, damping: float) -> FloatArray:
    """Return the commanded stiffness up to which each servo is stable from 0 on."""
    whole, b, gain, load, hz, ratio, delay, period = some.T
    wall: Any = (gain * damping, period, delay, case.samples)
    if load.any():
        servo = masses_of(whole, b, load, hz, ratio)
        found = chain_boundary(*two_masses(*servo, encoder=case.belief.encoder), *wall).stiffness
    else:
        found = critical_stiffness(whole, b, *wall)
    commanded: FloatArray = found / gain
    return commanded


def ceilings(case: Case, some: FloatArray) -> FloatArray:
    """Return the commanded damping up to which each servo is stable without stiffness."""
    whole, b, gain, load, hz, ratio, delay, period = some.T
    loop: Any = (period, delay, case.samples)
    if load.any():
        servo = masses_of(whole, b, load, hz, ratio)
        found = chain_ceiling(*two_masses(*servo, encoder=case.belief.encoder), *loop)
    else:
        found = max_virtual_damping(whole, b, *loop)
    commanded: FloatArray = found / gain
    return commanded


def masses_of(
    whole: FloatArray, b: FloatArray, load: FloatArray, hz: FloatArray, ratio: FloatArray
) -> Any:
    load = np.minimum(load, 0.99 * whole)
    motor, rate = whole - load, math.tau * hz
    moving = motor * load / whole
    return motor, b, load, moving * rate**2, 2.0 * ratio * moving * rate


def radius(case: Case, member: FloatArray, stiffness: float, damping: float) -> float:
    """Return the largest modulus of a pole of a servo of the belief."""
    whole, b, gain, load, *_, delay, period = member.tolist()
    k, big_b, n = gain * stiffness, gain * damping, case.samples
    if not load:
        return oracles.radius(oracles.Loop(whole, b, k, big_b, period, delay, n))
    servo = map(float, masses_of(*member[[0, 1, 3, 4, 5]]))
    loop = oracles.LinkedLoop._make([*servo, period, delay / period, n, case.belief.encoder, 0.0])
    return oracles.linked_radius(loop, k, big_b)


def least(
    case: Case, height: Callable[[FloatArray], FloatArray], seed: int, steps: int
) -> tuple[float, FloatArray]:
    """Return the least height in the box, of corners, random servos and an optimiser; and where."""
    random = np.random.default_rng(seed)
    start = random.random((96, len(NAMES) + 1))
    start[::2] = np.round(start[::2])
    first = height(members(case, start))
    found = differential_evolution(
        lambda points: height(members(case, np.atleast_2d(points.T))),
        [(0.0, 1.0)] * start.shape[1],
        init=start[np.argsort(first)[:32]],
        maxiter=steps,
        rng=seed,
        polish=False,
        tol=0.0,
        updating="deferred",
        vectorized=True,
    )
    return float(found.fun), members(case, found.x[None])[0]


def between(case: Case) -> float:
    """Return how much the limit of a rigid servo between the evaluated members may be lower."""
    if case.belief.is_flexible:
        return 1.0
    return 1.003 if case.samples == 1 else 1.0132  # as CORNER_ALONE says


def decided(case: Case, damping: float = 0.0) -> Decision:
    """Return what the guard commands where as much stiffness as it allows is asked for."""
    request = Request(1e9, damping, "both", case.samples)
    situation = Situation(case.belief, case.period, 4.1, 0.0)
    return decide(request, GuardSettings(), situation, [case.age])[0]


class Found(NamedTuple):
    """What was counted over the least that was found in the box; above 1 is unsafe."""

    stiffness: float
    ceiling: float


def searched(case: Case, seed: int, steps: int) -> Found:
    """Search for the servo on which the limits of stiffness and virtual damping are least."""
    settings, ceiling = GuardSettings(), decided(case).damping_ceiling
    slack = case.belief.damping.low / case.belief.torque_gain.high
    most = settings.damping_cap * ceiling if case.asked > 0.0 else slack
    wall = decided(case, case.asked * most)
    limit = wall.stiffness / settings.margin / between(case)
    top, member = least(case, lambda some: ceilings(case, some), seed, steps)
    bounds = radius(case, member, 0.0, 0.999 * ceiling)
    low, member = least(case, lambda some: limits(case, some, wall.damping), seed, steps)
    # an independent loop decides, too
    worst = max(bounds, radius(case, member, limit, wall.damping) if limit > 0.0 else 0.0)
    if worst > 1.0 + 1e-9:
        return Found(math.inf, math.inf)
    return Found(limit / low if limit > 0.0 else 0.0, ceiling / top)


def check(case: Case, seed: int, steps: int) -> None:
    """Every servo of the belief is stable at the limits of stiffness and virtual damping."""
    assert max(searched(case, seed, steps)) < 1.0 + 1e-9, case


MORE_FRICTION = belief(
    inertia=0.025,
    damping=Bounded(0.8, 0.33, 2.0),
    delay=Bounded(2e-3, 0.3e-3, 5.6e-3),
    load_inertia=3e-4,
    flexible_hz=14.5,
    flexible_damping_ratio=0.017,
)
"""With B = 0 the least critical stiffness is 16.05 N·m/rad, at the most friction"""
INERTIA_INSIDE = belief(
    inertia=Bounded(0.02, 0.0105, 0.04),
    damping=0.02,
    delay=1e-3,
    load_inertia=0.01,
    flexible_hz=20.0,
    flexible_damping_ratio=0.004,
)
"""The ceiling is least between the ends of the inertia"""
LIMIT_INSIDE = belief(
    inertia=Bounded(1.35e-3, 6.744e-4, 2.6977e-3),
    damping=5.785e-3,
    torque_gain=1.3044,
    load_inertia=4.763e-5,
    flexible_hz=2.3673,
    flexible_damping_ratio=1.0948e-3,
)
"""The ceiling is least at the most inertia, but the limit at 0.7 of it between the ends"""


HALF_A_CYCLE = belief(
    inertia=0.08,
    damping=0.1,
    load_inertia=0.03,
    flexible_hz=243.0,
    flexible_damping_ratio=1e-3,
)
"""At half a cycle per period, and only there, the ceiling is half of what it is beside it"""


@pytest.mark.parametrize(
    "case",
    [
        Case(MORE_FRICTION),
        Case(INERTIA_INSIDE),
        Case(LIMIT_INSIDE, 1.0, samples=4),
        Case(replace(HALF_A_CYCLE, flexible_hz=Bounded(243.0, 200.0, 300.0)), 1.0, 2e-3, 2e-3),
    ],
)
def test_the_least_safe_servo_is_not_where_friction_and_inertia_are_least(case: Case) -> None:
    check(case, 1, 6)


def test_an_interval_of_half_a_cycle_is_counted() -> None:
    case = Case(HALF_A_CYCLE, period=2e-3, age=2e-3)
    member = members(case, np.zeros((1, len(NAMES) + 1)))
    member[0, -2:] = 0.95 * 2e-3, 0.5 / 243.0
    assert decided(case).damping_ceiling < ceilings(case, member)[0]


@pytest.mark.parametrize("ratio", [1e-5, 1e-3])
def test_a_hardly_damped_vibration_beside_half_a_cycle_is_counted(ratio: float) -> None:
    known = {"inertia": 0.0102, "damping": 0.007, "load_inertia": 0.0016, "flexible_hz": 490.0}
    case = Case(belief(**known, flexible_damping_ratio=ratio), age=2.5e-4)
    some = np.tile(members(case, np.zeros((1, len(NAMES) + 1))), (2000, 1))
    some[:, -2], some[:, -1] = case.age, np.linspace(1e-3, 1.05e-3, 2000)
    assert 0.0 < decided(case).damping_ceiling < ceilings(case, some).min()


@pytest.mark.parametrize("rigid", [False, True])
def test_no_servo_of_a_random_belief_is_unstable(rigid: bool, thorough: bool) -> None:
    for seed in range(2000 if thorough else 3):
        check(drawn(np.random.default_rng((seed, rigid)), rigid), seed, 12 if thorough else 4)


@pytest.mark.parametrize("damping", [0.0, 0.02])
def test_a_vibration_without_damping_has_a_limit(damping: float) -> None:
    def stiffness(ratio: float) -> float:
        found = belief(
            inertia=0.012,
            damping=damping,
            load_inertia=1e-4,
            flexible_hz=50.0,
            flexible_damping_ratio=ratio,
        )
        return decided(Case(found)).stiffness

    assert stiffness(0.0) == pytest.approx(stiffness(1e-7), rel=1e-2, abs=1e-3)


@pytest.mark.parametrize(("hz", "lag"), [(120.0, 0.0), (400.0, 1.3e-3)])
def test_a_servo_without_any_friction_is_not_called_stable(hz: float, lag: float) -> None:
    case = Case(
        belief(
            inertia=0.012,
            damping=0.0,
            delay=lag,
            load_inertia=3e-3,
            flexible_hz=hz,
            flexible_damping_ratio=0.0,
        )
    )
    wall = decided(case, 0.5 * decided(case).damping_ceiling)
    (member,) = members(case, np.zeros((1, len(NAMES) + 1)))
    assert radius(case, member, wall.stiffness, wall.damping) < 1.0 + 1e-7


def test_a_motor_with_a_load_of_any_size_gets_a_stiffness_that_is_stable() -> None:
    inertia, stiffness = Bounded(0.012, 0.008, 0.018), Bounded(200.0, 50.0, 800.0)
    load, friction = Bounded(0.012, 1.2e-4, 1.2), Bounded(0.012, 0.006, 0.024)
    joint = belief(
        inertia=inertia,
        damping=friction,
        delay=Bounded(1e-3, 0.0, 2e-3),
        load_inertia=load,
        flexible_hz=vibration(inertia, load, stiffness, bare=True),
        flexible_damping_ratio=Bounded(0.03, 0.005, 0.1),
        transmission_stiffness=stiffness,
        bare=True,
    )
    request, situation = Request(1e9, 1e9, "both"), Situation(joint, 1e-3, 4.1, 0.0)
    settings = GuardSettings(damping_cap=0.5)
    wall = decide(request, settings, situation, [1e-3])[0]
    assert wall.stiffness > 1.0
    random = np.random.default_rng(1)
    box = np.array([(each.low, each.high) for each in (inertia, friction, load, stiffness)])
    shares = np.where(random.random((4, 400)) < 0.5, 0.0, random.random((4, 400)))
    motor, b, loads, k = box[:, :1] * (box[:, 1:] / box[:, :1]) ** shares
    c = 2.0 * 0.005 * np.sqrt(k * motor * loads / (motor + loads))
    servo = two_masses(motor, b, loads, k, c)
    delay = random.uniform(1e-3, 3e-3, 400)
    assert wall.damping_ceiling < chain_ceiling(*servo, 1e-3, delay).min()
    limit = chain_boundary(*servo, wall.damping, 1e-3, delay).stiffness.min()
    assert 0.5 * limit < wall.stiffness < limit


@pytest.mark.parametrize(
    ("samples", "friction"), sampled([(16, 1.0), (1, 1.0), (8, 0.4), (16, 0.1), (4, 1.0)], 2)
)
def test_rigid_links_on_a_motor_with_a_long_velocity_difference_are_stable(
    samples: int, friction: float
) -> None:
    """Friction is b T / m of the motor alone; links may be far heavier."""
    motor = belief(
        inertia=0.01,
        damping=friction * 10.0,
        delay=0.0,
        bare=True,
    )
    inertias = 0.01 * np.geomspace(1.0, 300.0, 200)
    for age in (0.0, 1e-3, 2.5e-3):
        for share in (-0.5 * friction, 0.1, 0.6, 10.0):
            wall = decided(Case(motor, age=age, samples=samples), share * 10.0)
            loop = (1e-3, age, samples)
            assert wall.damping < max_virtual_damping(inertias, friction * 10.0, *loop).min()
            limits = critical_stiffness(inertias, friction * 10.0, wall.damping, *loop)
            assert 0.0 < wall.stiffness < 0.85 * limits.min()
