"""Operators on simulated walls: their motion, the record, and the motion without them."""

from __future__ import annotations

import copy
from dataclasses import dataclass

import numpy as np

from haptic_wall.controller.experiments.maps.many_walls import Loops
from haptic_wall.controller.experiments.maps.walls import Walls, blocks
from haptic_wall.controller.theory.checks import FloatArray, IntArray
from scripts.trials.watched import Trace, as_traces

HANDS = ("voluntary", "rhythm", "tremor", "tap", "lean")
_SLOW = 20
"""Periods between drawn values of an operator's slow changes."""
_BEFORE, _CYCLES, _LOOKED = 2, 60, 12
"""Cycles of the wall before an alarm that define the motion, cycles watched without the operator,
and the last of those, compared with as many before them."""
_LOST = 0.07
"""Largest fraction of the amplitude that a persisting motion may lose in so many cycles."""
_LEFT = 0.5
"""Least remaining fraction of the amplitude at the alarm."""


@dataclass(frozen=True, slots=True)
class Hands:
    """An operator on each wall: a spring and damper toward a moving reference."""

    spring: FloatArray
    """Shape (n,) [N·m/rad]"""
    damper: FloatArray
    """Shape (n,) [N·m·s/rad]"""
    wanted: FloatArray
    """Its reference, shape (periods, n) [rad]"""
    speed: FloatArray
    """Speed of the reference, the same shape [rad/s]"""

    def torque(
        self, k: int, who: IntArray, position: FloatArray, velocity: FloatArray
    ) -> FloatArray:
        """Return the torque of the operators ``who`` in period ``k`` [N·m]."""
        drag: FloatArray = self.damper[who] * (self.speed[k, who] - velocity)
        drag += self.spring[who] * (self.wanted[k, who] - position)
        return drag


def draw_hands(walls: Walls, hand: str, periods: int, random: np.random.Generator) -> Hands:
    """Draw an operator for each wall.

    Args:
        walls: Their inertia decides an operator's strength.
        hand: One of ``HANDS``: voluntary motion of several frequencies up to 10 Hz; one rhythm of
            1 to 10 Hz; tremor of 8 to 12 Hz while leaning; tapping; leaning.
        periods: Duration of the motion.
        random: Draws properties and changes.
    """
    spring, damper = draw_grips(walls.inertia, random)
    wanted = wanted_motion(hand, walls.size, periods, random)
    speed = np.diff(wanted, axis=0, append=wanted[-1:]) / walls.period
    return Hands(spring, damper, wanted, speed)


def draw_grips(inertia: FloatArray, random: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Return stiffness [N·m/rad] and damping [N·m·s/rad] of an operator's grip on each servo.

    Args:
        inertia: Inertia of the servos, shape (n,) [kg·m²].
        random: Draws the properties.
    """
    # A finger on a small servo, an arm on a large one.
    size = np.clip(inertia / 0.012, 0.15, 20.0)
    spring = np.exp(random.uniform(np.log(2.0), np.log(20.0), inertia.size)) * size
    ratio = random.uniform(0.4, 0.9, inertia.size)
    return spring, 2.0 * ratio * np.sqrt(spring * np.maximum(inertia, 0.003))


def handled(walls: Walls, hands: Hands) -> list[Trace]:
    """Record walls that operators move, from rest.

    Args:
        walls: Walls with an encoder and stiffness > 0.
        hands: One for each.
    """
    periods = hands.wanted.shape[0]
    traces: dict[int, Trace] = {}
    for index in blocks(walls):
        loops = Loops(walls.take(index), np.zeros(index.size))
        counts, torques, positions = [], [], []
        for k in range(periods):
            bodies = loops.bodies
            loops.hand = hands.torque(k, index, bodies.position, bodies.velocity)
            loops.run(1)
            counts.append(loops.measured.copy())
            torques.append(loops.torque.copy())
            positions.append(bodies.position.copy())
        ends = np.full(index.size, periods)
        recorded = as_traces(loops, counts, torques, positions, ends)
        traces.update(zip(index.tolist(), recorded, strict=True))
    return [traces[i] for i in range(walls.size)]


def goes_on(walls: Walls, hands: Hands, i: int, at: list[int]) -> list[bool]:
    """Whether the motion would persist if the operator no longer moved.

    From each of these samples on the operator is replaced three times: it lets go, it holds still,
    and it pushes with its mean torque. None of them gives energy to an oscillation. The motion
    persists if after one of them it has lost no more than 7 % in the last twelve of 60 cycles, and
    is at least half as large as it was.

    Args:
        walls: As ``handled``.
        hands: As ``handled``.
        i: Index of the wall.
        at: Samples, ascending.
    """
    who = np.array([i])
    loops = Loops(walls.take(who), np.zeros(1))
    cycle = 2.0 * np.pi * np.sqrt(walls.inertia[i] / walls.stiffness[i]) / walls.period[i]
    before = int(_BEFORE * cycle) + 1
    positions: list[float] = []
    torques: list[float] = []
    found: list[bool] = []
    for k in range(at[-1] + 1 if at else 0):
        bodies = loops.bodies
        if k == at[len(found)]:
            size = float(np.ptp(positions[-before:])) if positions else 0.0
            push = float(np.mean(torques[-before:])) if torques else 0.0
            place = float(np.mean(hands.wanted[max(0, k - before) : k + 1, i]))
            spring, damper = float(hands.spring[i]), float(hands.damper[i])
            found.append(
                any(
                    _lasts(copy.deepcopy(loops), int(cycle) + 1, size, *still)
                    for still in (
                        (0.0, 0.0, 0.0),
                        (push, 0.0, 0.0),
                        (spring * place, spring, damper),
                    )
                )
            )
        positions.append(float(bodies.position[0]))
        loops.hand = hands.torque(k, who, bodies.position, bodies.velocity)
        torques.append(float(loops.hand[0]))
        loops.run(1)
    return found


def _lasts(
    loops: Loops, cycle: int, size: float, push: float, spring: float, damper: float
) -> bool:
    """Whether the motion persists under a constant push and a spring and damper to the origin."""
    positions = []
    for _ in range(_CYCLES * cycle):
        bodies = loops.bodies
        loops.hand = push - spring * bodies.position - damper * bodies.velocity
        loops.run(1)
        positions.append(float(bodies.position[0]))
    place = np.array(positions)
    last, earlier = place[-_LOOKED * cycle :], place[-2 * _LOOKED * cycle : -_LOOKED * cycle]
    moved = np.diff(last)
    moved = moved[moved != 0.0]
    turns = int(np.count_nonzero(moved[1:] * moved[:-1] < 0.0))
    kept = float(np.ptp(last)) >= (1.0 - _LOST) * float(np.ptp(earlier))
    # A motion that only drifts away, as after a release outside a one-sided wall, has no turning
    # point.
    return turns >= _LOOKED and kept and float(np.ptp(last)) >= _LEFT * size > 0.0


def wanted_motion(hand: str, n: int, periods: int, random: np.random.Generator) -> FloatArray:
    """Return operators' references, shape (periods, n) [rad], at 1 kHz."""
    time = np.arange(periods)[:, None] * 1e-3

    def slow(seconds: float) -> FloatArray:
        return slow_changes(n, periods, seconds, random)

    def phase(frequency: FloatArray, varies: float, seconds: float) -> FloatArray:
        steps = frequency * (1.0 + varies * slow(seconds))
        return 2.0 * np.pi * (1e-3 * np.cumsum(steps, axis=0) + random.uniform(0.0, 1.0, n))

    result: FloatArray
    if hand == "voluntary":
        result = 0.1 * slow(1.5)
        for _ in range(3):
            f = np.exp(random.uniform(np.log(0.4), np.log(10.0), n))
            result += 0.15 / (1 + f / 1.5) * np.exp(0.4 * slow(1.0)) * np.sin(phase(f, 0.05, 0.7))
    elif hand == "rhythm":
        f = random.uniform(1.0, 10.0, n)
        reach = random.uniform(0.08, 0.25, n) / (1.0 + f / 1.5)
        result = reach * (1.0 + 0.1 * slow(0.7)) * np.sin(phase(f, 0.03, 0.7))
    elif hand == "tremor":
        reach = random.uniform(0.005, 0.03, n) * np.abs(1.0 + 0.35 * slow(0.6))
        result = random.uniform(-0.1, 0.2, n) + 0.03 * slow(2.0)
        result += reach * np.sin(phase(random.uniform(8.0, 12.0, n), 0.05, 0.5))
    elif hand == "tap":
        depth = random.uniform(0.05, 0.3, n) * (1.0 + 0.2 * slow(0.5))
        wave = np.sin(phase(random.uniform(1.0, 6.0, n), 0.1, 0.5))
        result = -0.02 + depth * np.maximum(wave, -0.3)
    elif hand == "lean":
        depth = random.uniform(0.02, 0.5, n) * (0.7 + 0.3 * np.tanh(slow(1.0)))
        result = depth * np.minimum(1.0, time)
    else:
        raise ValueError(f"hand {hand!r} is not known; give one of {', '.join(HANDS)}")
    return result


def slow_changes(n: int, periods: int, seconds: float, random: np.random.Generator) -> FloatArray:
    """Return slow random changes of unit variance with this correlation time; (periods, n)."""
    rows = periods // _SLOW + 3
    keep = np.exp(-_SLOW * 1e-3 / seconds)
    drawn = random.standard_normal((rows, n))
    values = np.empty((rows, n))
    value = random.standard_normal(n)
    for row in range(rows):
        value = keep * value + np.sqrt(1.0 - keep * keep) * drawn[row]
        values[row] = value
    at = np.arange(periods) / _SLOW
    whole = at.astype(np.int64)
    share = (at - whole)[:, None]
    result: FloatArray = values[whole] * (1.0 - share) + values[whole + 1] * share
    return result
