"""Searches random beliefs for the servo on which a commanded wall is least stable; poles decide."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest

from haptic_wall.controller.guard.belief import LIGHTEST, Belief, Bounded
from haptic_wall.controller.guard.guard import GuardSettings, Request, Situation, decide
from haptic_wall.controller.guard.types import WITHIN
from haptic_wall.controller.theory.checks import FloatArray
from tests.theory import oracles, test_flexible

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


def belief(**changes: Any) -> Belief:
    one, none = Bounded.exactly(1.0), Bounded.exactly(0.0)
    given = {"inertia": one, "damping": one, "coulomb": none, "delay": none, "torque_gain": one}
    return Belief(**(given | changes))


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


def radius(case: Case, member: FloatArray, stiffness: float, damping: float) -> float:
    """Return the largest modulus of a pole of a servo of the belief."""
    whole, b, gain, load, hz, ratio, delay, period = member.tolist()
    k, big_b, n = gain * stiffness, gain * damping, case.samples
    if not load:
        # a longer interval is left to the margin
        rigid = oracles.Loop(whole, b, k, big_b, case.period, delay, n)
        return oracles.radius(rigid)
    load = min(load, 0.99 * whole)
    motor, rate = whole - load, math.tau * hz
    moving = motor * load / whole
    servo = (motor, b, load, moving * rate**2, 2.0 * ratio * moving * rate)
    loop = test_flexible.Loop(*servo, period, delay / period, n, case.belief.encoder)
    return test_flexible.radius(loop, k, big_b)


def worst(
    case: Case, height: Callable[[FloatArray], float], random: np.random.Generator, tries: int
) -> float:
    """Return the largest height that corners, random servos and a climber find in the box."""
    box = [getattr(case.belief, name) for name in NAMES]
    low = np.array([each.low for each in box] + [case.period])
    high = np.array([each.high for each in box] + [WITHIN * case.period])
    low[3] = max(low[3], LIGHTEST * high[3])
    high[6] += case.age

    def at(shares: FloatArray) -> float:
        return height(low + shares * (high - low))

    shares = random.random((tries, low.size))
    shares[::2] = np.round(shares[::2])
    heights = [at(row) for row in shares]
    best, top = shares[np.argmax(heights)], max(heights)
    for k in range(tries):
        step = 0.5 * 0.97**k * random.normal(size=low.size) * (random.random(low.size) < 0.4)
        tried = np.clip(best + step, 0.0, 1.0)
        if (found := at(tried)) > top:
            best, top = tried, found
    return top


def check(case: Case, random: np.random.Generator, tries: int) -> None:
    """Every servo of the belief is stable at the limits of stiffness and virtual damping."""
    settings = GuardSettings()
    situation = Situation(case.belief, case.period, 4.1, 0.0)

    def decided(asked: float) -> Any:
        request = Request(1e9, asked, "both", case.samples)
        return decide(request, settings, situation, [case.age], explained=False)[0]

    ceiling = decided(0.0).damping_ceiling
    least = case.belief.damping.low / case.belief.torque_gain.high
    wall = decided(case.asked * (settings.damping_cap * ceiling if case.asked > 0.0 else least))
    limit = wall.stiffness / settings.margin

    def of_limit(member: FloatArray) -> float:
        return radius(case, member, limit, wall.damping)

    def of_ceiling(member: FloatArray) -> float:
        return radius(case, member, 0.0, 0.999 * ceiling)

    if limit > 0.0:
        assert worst(case, of_limit, random, tries) < 1.0 + 1e-9, case
    assert worst(case, of_ceiling, random, tries) < 1.0 + 1e-9, case


MORE_FRICTION = belief(
    inertia=Bounded.exactly(0.025),
    damping=Bounded(0.8, 0.33, 2.0),
    delay=Bounded(2e-3, 0.3e-3, 5.6e-3),
    load_inertia=Bounded.exactly(3e-4),
    flexible_hz=Bounded.exactly(14.5),
    flexible_damping_ratio=Bounded.exactly(0.017),
)
"""With B = 0 the least critical stiffness is 16.05 N·m/rad, at the most friction"""
INERTIA_INSIDE = belief(
    inertia=Bounded(0.02, 0.0105, 0.04),
    damping=Bounded.exactly(0.02),
    delay=Bounded.exactly(1e-3),
    load_inertia=Bounded.exactly(0.01),
    flexible_hz=Bounded.exactly(20.0),
    flexible_damping_ratio=Bounded.exactly(0.004),
)
"""The ceiling is least between the ends of the inertia"""


@pytest.mark.parametrize("known", [MORE_FRICTION, INERTIA_INSIDE])
def test_the_least_safe_servo_is_not_where_friction_and_inertia_are_least(known: Belief) -> None:
    check(Case(known), np.random.default_rng(1), 60)


@pytest.mark.parametrize("rigid", [False, True])
def test_no_servo_of_a_random_belief_is_unstable(rigid: bool, thorough: bool) -> None:
    for seed in range(400 if thorough else 3):
        random = np.random.default_rng((seed, rigid))
        check(drawn(random, rigid), random, 300 if thorough else 60)


@pytest.mark.parametrize("damping", [0.0, 0.02])
def test_a_vibration_without_damping_has_a_limit(damping: float) -> None:
    def stiffness(ratio: float) -> float:
        found = belief(
            inertia=Bounded.exactly(0.012),
            damping=Bounded.exactly(damping),
            load_inertia=Bounded.exactly(1e-4),
            flexible_hz=Bounded.exactly(50.0),
            flexible_damping_ratio=Bounded.exactly(ratio),
        )
        request, situation = Request(1e9, 0.0, "both", 1), Situation(found, 1e-3, 4.1, 0.0)
        return decide(request, GuardSettings(), situation, [0.0], explained=False)[0].stiffness

    assert stiffness(0.0) == pytest.approx(stiffness(1e-7), rel=1e-2, abs=1e-3)
