"""Searches for contacts that break the rebound speeds.

    scripts/study rebound_table [--walls N] [--seed S] [--friction SHARE ...]

Random beliefs as wide as the presets admit, at 0.8 of the guard's limit, with an encoder and a
torque limit. For each the two speeds are asked; then a search by mutation over members of the
belief, entry speeds inside the interval, phases and places of the surface in its count tries to
make a contact with counts, friction at its lowest and saturation return the device faster. Below
and above the interval the same search shows what would happen there. The figures are in
docs/evidence/guard-searches.md. It takes some minutes.
"""

import sys
from dataclasses import replace

import numpy as np

from haptic_wall.controller.guard.belief import Belief, Bounded
from haptic_wall.controller.guard.guard import Decision, GuardSettings, Request, Situation, decide
from haptic_wall.controller.guard.rebound import Rebound, rebound
from haptic_wall.controller.theory import max_virtual_damping
from haptic_wall.controller.theory.rebound import BETWEEN
from haptic_wall.controller.theory.rounded_contact import RoundedContacts, returned_speed
from scripts.study import Option, Part, Study, table_of
from scripts.trials.truth import COUNT

PERIOD = 1e-3
LANES, ROUNDS = 96, 8


def wall(random: np.random.Generator, friction: float) -> tuple[Situation, Decision]:
    """A random belief, and the guard's decision for a wall as stiff as may be."""
    m = 10 ** random.uniform(-3, -1.5)
    b = 10 ** random.uniform(-3.5, -1) * m / PERIOD
    lag = random.uniform(0, 5) * PERIOD * (random.random() < 0.7)
    delay = random.uniform(0, 4) * PERIOD * (random.random() < 0.7)
    wide = random.random() < 0.7
    gain = (0.5 + 0.5 * random.random(), 1.0 + random.random()) if wide else (1.0, 1.0)
    ceiling = float(max_virtual_damping(m, b, PERIOD, delay + lag)) / gain[1]
    damping = float(ceiling * random.choice([0.0, 0.003, 0.01, 0.03, 0.1, 0.3, 0.7]))
    belief = Belief(
        Bounded(m, m, m * random.uniform(1, 2.25) if wide else m),
        Bounded(b, b, b * random.uniform(1, 4) if wide else b),
        Bounded.exactly(0.0),
        Bounded(lag, 0.0 if wide else lag, lag),
        Bounded(1.0, *gain),
    )
    situation = Situation(belief, PERIOD, 1e9, COUNT)
    request = Request(1e12, damping, "above", int(random.choice([1, 1, 1, 2])))
    (decision,) = decide(request, GuardSettings(), situation, [delay])
    count = COUNT * (decision.stiffness + decision.damping / request.velocity_samples / PERIOD)
    coulomb = friction * count * gain[1]
    # high enough for some speed to be promised, and low enough to matter
    limit = count * 10 ** random.uniform(0.5, 3)
    belief = replace(belief, coulomb=Bounded(coulomb, coulomb, 4 * coulomb))
    return replace(situation, belief=belief, torque_limit=limit), decision


def contacts(
    x: np.ndarray, situation: Situation, decision: Decision, speeds: tuple[float, float]
) -> RoundedContacts:
    """Members of the belief on the wall; each row of ``x`` says where between the bounds."""
    belief = situation.belief

    def between(known: Bounded, where: np.ndarray) -> np.ndarray:
        return known.low + (known.high - known.low) * where

    m, g = between(belief.inertia, x[:, 0]), between(belief.torque_gain, x[:, 2])
    b, lag = between(belief.damping, x[:, 1]), belief.delay.high - belief.delay.low
    c = belief.coulomb.low
    unit = PERIOD * PERIOD / m
    speed = speeds[0] * (speeds[1] / speeds[0]) ** x[:, 4]
    return RoundedContacts(
        delta=b * PERIOD / m,
        alpha=g * decision.stiffness * unit,
        beta=g * decision.damping * PERIOD / m,
        delay=(decision.delay - lag * x[:, 3]) / PERIOD,
        samples=np.full(len(x), decision.request.velocity_samples),
        friction=c * unit / COUNT,
        limit=g * situation.torque_limit * unit / COUNT,
        first=np.maximum(x[:, 5], 1e-6),
        speed=speed * PERIOD / COUNT,
        phase=x[:, 6],
    )


def fastest(
    situation: Situation,
    decision: Decision,
    speeds: tuple[float, float],
    random: np.random.Generator,
) -> tuple[float, float]:
    """The greatest ratio found between two speeds of entry, and the speed [rad/s]."""
    x = random.random((LANES, 7))
    end = random.random(x.shape)
    x = np.where(end < 0.2, 0.0, np.where(end > 0.85, 1.0, x))
    found = returned_speed(contacts(x, situation, decision, speeds))
    size = 0.15
    for _ in range(ROUNDS):
        kept = np.argsort(-found)[: LANES // 4]
        parents = x[random.choice(kept, LANES)]
        tried = parents + size * random.normal(size=x.shape) * (random.random(x.shape) < 0.5)
        tried = np.clip(tried, 0.0, 1.0)
        new = returned_speed(contacts(tried, situation, decision, speeds))
        better = new > found
        x[better], found[better] = tried[better], new[better]
        size *= 0.8
    best = int(np.argmax(found))
    return float(found[best]), float(speeds[0] * (speeds[1] / speeds[0]) ** x[best, 4])


def row(case: tuple[int, int, float]) -> list[str]:
    """One line of the table: inside the interval, below it, above it."""
    walls, seed, friction = case
    random = np.random.default_rng(seed)
    inside, below, above = [], [], []
    for _ in range(walls):
        situation, decision = wall(random, friction)
        if decision.stiffness == 0:
            continue
        request = decision.request
        speeds: Rebound = rebound(
            decision.stiffness,
            decision.damping,
            request.side,
            request.velocity_samples,
            situation,
            decision.delay,
        )
        high = speeds.highest or 0.0
        low = 1e-3 * high if speeds.lowest is None else speeds.lowest
        if high > low:
            ratio, at = fastest(situation, decision, (low, high), random)
            inside.append(ratio)
            if ratio > 1:
                p = situation.belief
                print("inside", ratio, at / low, speeds, decision, p, file=sys.stderr)
        if speeds.lowest is not None:
            # how close below it something comes back faster: what is left of the factor
            free = replace(situation, torque_limit=1e9)
            ratio, at = fastest(free, decision, (low / BETWEEN, low), random)
            below.append(at / low if ratio > 1 else 0.0)
        if high > 0:
            above.append(fastest(situation, decision, (high, 10 * high), random)[0])
    found = np.array(above)
    text = [
        f"{friction:g}",
        str(len(inside)),
        f"{max(inside):.3f}",
        f"{np.mean(np.array(below) > 0):.0%}" if below else "",
        f"{found.max():.3f} in {np.mean(found > 1):.0%}",
    ]
    return text


STUDY = Study(
    "evidence/guard-searches.md",
    (
        Part(
            "rebound_table",
            lambda given: [(given.walls, given.seed, share) for share in given.friction],
            row,
            table_of(
                "friction|walls|greatest return between the speeds"
                f"|faster within a factor of {BETWEEN:g} below|greatest return above"
            ),
            case_s=60.0,
        ),
    ),
    (
        Option("walls", 25, "random walls in each row"),
        Option("seed", 7, "seed of the walls"),
        Option(
            "friction",
            (0.0, 0.2, 0.5, 0.9, 1.5, 3.0),
            "Coulomb friction over the torque of one count, a row each",
        ),
    ),
    everywhere=True,
)
