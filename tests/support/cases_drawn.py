"""Draws the cases of the detector's table: walls, pushes, laws, links, and operators on them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from haptic_wall.controller.laws.table import EXAMPLES
from haptic_wall.controller.laws.wall import Side
from tests.support.operators import TURN
from tests.support.trial import Case, WallAsked
from tests.support.truth import BackEmf, Truth
from tests.support.truths_drawn import (
    LAG_FACTOR,
    bench_of,
    critical_of,
    damping_ceiling_of,
    draw_lag,
    draw_real,
    draw_truth,
    log_uniform,
)

PRESETS = ("xm430-w350", "xl330-m288")
DAMPINGS = {
    "xm430-w350": (0.005, 0.02, 0.04, 0.1, 0.2),
    "xl330-m288": (0.001, 0.0025, 0.005, 0.01, 0.02),
}
"""Virtual damping of the tried walls [N·m·s/rad]"""
LAGS = {"within": (0.0, 1.0), "1 to 2 times": (1.0, 2.0), "2 to 4 times": (2.0, LAG_FACTOR)}
"""Ranges of the lag, as multiples of the believed upper bound [1]"""
LAWS = (*(law for law in EXAMPLES if law != "wall"), "own")
LAW_HANDS = ("voluntary", "lean", TURN)
WALLS = ("the guard's K", "1.2 to 3 times the limit")
"""Of a shaft that is pushed against one"""
_ANY_STIFFNESS = 1e6
"""A request above every limit, so that the guard commands its own limit [N·m/rad]"""
_OF_THE_LIMIT = 0.9
_ONE_SIDED = 0.4
"""Probability of a wall that never pulls"""
_KICKS = (0.02, 0.5)
"""Range of the initial displacement [rad]"""


@dataclass(frozen=True, slots=True)
class Kind:
    """Properties of a servo in addition to its rigid body."""

    back_emf: BackEmf | None = "none"
    """None: drawn"""
    backlash: bool = False
    flexible: bool = False


KINDS = {
    "plain": Kind(),
    "back-EMF, current mode": Kind(back_emf="current"),
    "back-EMF, voltage mode": Kind(back_emf="voltage"),
    "backlash": Kind(backlash=True),
    "two masses": Kind(flexible=True),
    "all of them": Kind(back_emf=None, backlash=True, flexible=True),
}
_ANY = Kind(back_emf=None)


def draw_servo(preset: str, kind: Kind, lags: str, random: np.random.Generator) -> Truth:
    """Draw a servo of a kind from the whole belief, with its lag from a range of ``LAGS``."""
    bench = bench_of(preset)
    truth = draw_truth(
        bench, random, back_emf=kind.back_emf, backlash=kind.backlash, flexible=kind.flexible
    )
    return replace(truth, delay=draw_lag(bench, LAGS[lags], random))


def _damping(preset: str, random: np.random.Generator) -> float:
    return float(random.choice(DAMPINGS[preset]))


def _kick(random: np.random.Generator) -> float:
    return log_uniform(_KICKS, random)


def _guards(damping: float, side: Side = "both") -> WallAsked:
    """Return the wall that the guard commands with this B [N·m·s/rad]."""
    return WallAsked(_ANY_STIFFNESS, damping, side, forced=False)


def draw_wall(random: np.random.Generator, preset: str, kind: str, lags: str) -> Case:
    """Draw a servo, and the guard's own wall; it is let go."""
    truth = draw_servo(preset, KINDS[kind], lags, random)
    return Case(preset, truth, _guards(_damping(preset, random)), position=_kick(random))


def draw_limit(random: np.random.Generator, preset: str, lags: str) -> Case:
    """Draw a wall at 1.2 to 2 times the servo's own limit; it is let go."""
    while True:
        truth = draw_servo(preset, _ANY, lags, random)
        damping = _damping(preset, random)
        ratio = log_uniform((1.2, 2.0), random)
        kick = _kick(random)
        if damping <= _OF_THE_LIMIT * damping_ceiling_of(truth):
            wall = WallAsked(ratio * critical_of(truth, damping), damping)
            return Case(preset, truth, wall, position=kick)


def draw_bounces(random: np.random.Generator, preset: str, wall: str, lags: str) -> Case:
    """Draw a wall that never pulls, and a steady push against it: 1.3 to 6 times the friction."""
    bench = bench_of(preset)
    truth = draw_servo(preset, _ANY, lags, random)
    damping = _damping(preset, random)
    asked = _guards(damping, "above")
    if wall != WALLS[0]:
        ratio = log_uniform((1.2, 3.0), random)
        limit = max(critical_of(truth, damping), 0.1 * bench.torque_limit)
        asked = WallAsked(ratio * limit, damping, "above")
    least = 1.3 * truth.coulomb
    highest = max(min(6.0 * truth.coulomb, 0.3 * bench.torque_limit), 1.01 * least)
    push = float(random.uniform(least, highest))
    return Case(preset, truth, asked, position=-_kick(random), push=push)


def draw_small_cycle(random: np.random.Generator, preset: str) -> Case:
    """Draw a servo with backlash of 0.1 to 0.5 degrees, and the guard's own wall."""
    truth = draw_servo(preset, KINDS["backlash"], "within", random)
    width = float(random.uniform(math.radians(0.1), math.radians(0.5)))
    truth = replace(truth, backlash=width)
    wall = _guards(_damping(preset, random))
    return Case(preset, truth, wall, position=float(random.uniform(0.02, 0.05)))


def draw_real_wall(random: np.random.Generator, preset: str, lags: str) -> Case:
    """Draw a servo with every effect, and the guard's own wall; it is let go."""
    truth = draw_real(bench_of(preset), random, LAGS[lags])
    return Case(preset, truth, _guards(_damping(preset, random)), position=_kick(random))


def draw_held(
    random: np.random.Generator, preset: str, operator: str, seconds: float, *, real: bool = False
) -> Case:
    """Draw a servo within the belief, a wall at nine tenths of its limit, and an operator.

    Args:
        random: Draws.
        preset: Of the servo.
        operator: See ``draw_operator``.
        seconds: Length of the trial [s].
        real: The servo has every effect.
    """
    bench = bench_of(preset)
    while True:
        truth = draw_real(bench, random) if real else _believed(preset, random)
        damping = _damping(preset, random)
        side: Side = "above" if random.random() < _ONE_SIDED else "both"
        seed = int(random.integers(1 << 31))
        if damping <= _OF_THE_LIMIT * damping_ceiling_of(truth):
            wall = WallAsked(_OF_THE_LIMIT * critical_of(truth, damping), damping, side)
            return Case(preset, truth, wall, seconds, operator=operator, seed=seed)


def _believed(preset: str, random: np.random.Generator) -> Truth:
    return draw_truth(bench_of(preset), random, lag_factor=1.0, back_emf=None)


# Laws


class Dip:
    """A law of a user: a dip that the shaft falls into; it is free beside it."""

    def __init__(self, width: float = 0.2) -> None:
        self.low, self.high = -width, width
        self._width = width

    def torque(self, position: float) -> float:
        """Return its torque [N·m] at a position [rad]."""
        return -0.1 * math.sin(math.pi * position / self._width)


def draw_law(law: str, random: np.random.Generator) -> tuple[str, ...]:
    """Draw the numbers of a law; return it as changes of a configuration."""
    width = float(random.uniform(0.03, 0.3))
    high = float(random.uniform(0.02, 0.5))
    slopes = random.uniform(-1.0, 1.0, 4)
    places = np.sort(random.uniform(-0.6, 0.6, 3)).tolist()
    torques = np.concatenate([[1.0], slopes[:3], [-1.0]]).tolist()
    points = [list(each) for each in zip([-0.8, *places, 0.8], torques, strict=True)]
    count = int(random.integers(6, 48))
    snap = float(random.uniform(0.1, 0.45))
    numbers: dict[str, tuple[str, ...]] = {
        "stops": (f"wall.low={-high!r}", f"wall.high={high!r}"),
        "detents": (f"wall.count={count}", f"wall.snap={snap!r}"),
        "friction": (f"wall.friction={float(random.uniform(0.02, 0.3))!r}",),
        "texture": (f"wall.period={width!r}",),
        "profile": (f"wall.profile={points!r}",),
        "sum": (
            f"wall.parts=[{{law: detents, count: {count}, snap: {snap!r}}},"
            f" {{law: stops, low: {-high!r}, high: {high!r}, share: 3}}]",
        ),
        "own": (f"wall.options={{width: {width!r}}}",),
    }
    name = f"{__name__}:Dip" if law == "own" else law
    return (f"wall.law={name}", *numbers.get(law, ()))


def _servo_of_a_law(preset: str, random: np.random.Generator) -> tuple[Truth, float]:
    """Draw a servo within the belief, and a virtual damping below nine tenths of its ceiling."""
    while True:
        truth, damping = _believed(preset, random), _damping(preset, random)
        if damping <= _OF_THE_LIMIT * damping_ceiling_of(truth):
            return truth, damping


def draw_law_held(
    random: np.random.Generator, preset: str, law: str, operator: str, seconds: float
) -> Case:
    """Draw a law at nine tenths of the servo's own limit, and the hand that moves its shaft."""
    truth, damping = _servo_of_a_law(preset, random)
    wall = WallAsked(_OF_THE_LIMIT * critical_of(truth, damping), damping)
    seed = int(random.integers(1 << 31))
    sets = draw_law(law, random)
    return Case(preset, truth, wall, seconds, operator=operator, seed=seed, law=sets)


def draw_law_beyond(random: np.random.Generator, preset: str, law: str) -> Case:
    """Draw a law at 1.2 to 20 times the servo's own limit (a damper: its damping); it is let go.

    It has 0.5 to 10 rad/s: friction and a damper do not move a shaft at rest.
    """
    truth, damping = _servo_of_a_law(preset, random)
    ratio = log_uniform((1.2, 20.0), random)
    stiffness = critical_of(truth, damping)
    if law == "damper":
        damping = ratio * damping_ceiling_of(truth)
    else:
        stiffness *= ratio
    kick, speed = _kick(random), log_uniform((0.5, 10.0), random)
    wall, sets = WallAsked(stiffness, damping), draw_law(law, random)
    return Case(preset, truth, wall, position=kick, velocity=speed, law=sets)
