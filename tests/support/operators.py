"""Operator models that hold the output of a trial's servo.

An operator is a spring and a damper toward a moving reference, with a mass of its own and a push,
all given millisecond by millisecond. After its last row it has released the output.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from haptic_wall.controller.theory.checks import FloatArray

HANDS = ("voluntary", "rhythm", "tremor", "tap", "lean")
"""Motion of several frequencies up to 10 Hz; one rhythm of 1 to 10 Hz; a tremor of 8 to 12 Hz while
leaning; tapping; leaning"""
HARDER = ("jittered", "resonant", "varying", "heavy")
"""A rhythm whose periods vary by 3 to 5 %; a rhythm at 0.8 to 1.2 times the wall's own frequency;
a grip that tightens and loosens; a hand with up to twice the servo's inertia."""
TURN = "turn"
"""A hand that turns the shaft to and fro, up to a turn or so: for laws that go on everywhere"""
OPERATORS = (*HANDS, *HARDER, TURN)
ROW_NS = 1_000_000
_SLOW = 20
"""Periods between drawn values of an operator's slow changes."""
Row = tuple[float, float, float, float, float]
"""Stiffness [N·m/rad], damping [N·m·s/rad], reference [rad] and its speed [rad/s], push [N·m]"""


@dataclass(frozen=True, slots=True)
class Operator:
    """An operator on the output."""

    rows: Sequence[Row] = ()
    """Its action in each millisecond; the reference moves at its speed within it"""
    mass: float = 0.0
    """Inertia that the output carries until the rows end [kg·m²]"""
    name: str = "none"
    row_ns: int = ROW_NS


NOBODY = Operator()


def operator_of(
    spring: float | FloatArray,
    damper: float | FloatArray,
    wanted: FloatArray,
    *,
    push: float | FloatArray = 0.0,
    mass: float = 0.0,
    name: str = "scripted",
) -> Operator:
    """Return an operator with a given motion.

    Args:
        spring: [N·m/rad], one value or shape (n,).
        damper: [N·m·s/rad], one value or shape (n,).
        wanted: Reference of the output in each millisecond, shape (n,) [rad].
        push: Additional torque, one value or shape (n,) [N·m].
        mass: [kg·m²]
        name: For people.
    """
    speed = np.diff(wanted, append=wanted[-1:]) / (ROW_NS * 1e-9)
    columns = [
        np.broadcast_to(np.asarray(column, dtype=np.float64), wanted.shape).tolist()
        for column in (spring, damper, wanted, speed, push)
    ]
    return Operator(list(zip(*columns, strict=True)), mass, name)


def draw_operator(
    kind: str,
    inertia: float,
    duration_s: float,
    random: np.random.Generator,
    *,
    natural_hz: float = 3.0,
) -> Operator:
    """Draw an operator.

    Args:
        kind: One of ``OPERATORS``, or ``none``.
        inertia: Inertia of the servo: says how strong a hand is [kg·m²].
        duration_s: For which it holds the output [s].
        random: Draws how it is, and how it changes.
        natural_hz: Natural frequency of wall and servo [Hz]; a ``resonant`` rhythm is near it.

    Raises:
        ValueError: There is no such kind.
    """
    if kind == "none":
        return NOBODY
    if kind not in OPERATORS:
        raise ValueError(f"operator {kind!r} is not known; give one of {', '.join(OPERATORS)}")
    periods = max(2, round(duration_s * 1e9 / ROW_NS))
    springs, dampers = draw_grips(np.array([inertia]), random)
    spring, damper = float(springs[0]), float(dampers[0])
    mass = 0.0
    if kind == "jittered":
        wanted = _rhythm(random.uniform(1.0, 10.0), random.uniform(0.03, 0.05), periods, random)
    elif kind == "resonant":
        wanted = _rhythm(natural_hz * random.uniform(0.8, 1.2), 0.02, periods, random)
    elif kind == TURN:
        reach = random.uniform(0.5, 3.0)
        wanted = reach * slow_changes(1, periods, random.uniform(0.5, 2.0), random)[:, 0]
    else:
        motion = str(random.choice(HANDS)) if kind in HARDER else kind
        wanted = wanted_motion(motion, 1, periods, random)[:, 0]
    if kind == "heavy":
        mass = random.uniform(0.0, 2.0) * inertia
    if kind == "varying":
        grip = np.exp(0.6 * slow_changes(1, periods, 0.5, random)[:, 0])
        return operator_of(spring * grip, damper * np.sqrt(grip), wanted, name=kind)
    return operator_of(spring, damper, wanted, mass=mass, name=kind)


def _rhythm(hertz: float, jitter: float, periods: int, random: np.random.Generator) -> FloatArray:
    """Return a rhythm with a random period for each cycle, shape (periods,) [rad].

    Args:
        hertz: Mean frequency [Hz].
        jitter: Standard deviation of a cycle's period, relative to the mean [1].
        periods: Milliseconds.
        random: Draws it.
    """
    cycles = int(2 * periods * 1e-3 * hertz) + 4
    lengths = np.maximum(1.0 + jitter * random.standard_normal(cycles), 0.3) / hertz
    ends = np.concatenate([[0.0], np.cumsum(lengths)])
    time = np.arange(periods) * 1e-3
    phase = np.interp(time, ends, np.arange(cycles + 1)) + random.uniform()
    reach = random.uniform(0.08, 0.25) / (1.0 + hertz / 1.5)
    slow = slow_changes(1, periods, 0.7, random)[:, 0]
    result: FloatArray = reach * (1.0 + 0.1 * slow) * np.sin(2.0 * np.pi * phase)
    return result


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
