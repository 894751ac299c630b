"""Tries the detector on random walls: unstable and stable ones, and operators on stable ones.

The servos are those of ``theory.servos`` and the plant of the paper's Table II, all of them with
4096 counts; delays of 0 to 10 ms, half of them fractions; B from 0 to half the ceiling where one
count commands at most a tenth of the torque limit. The truth is the simulated motion after that
kick without further action. The detector's belief is wrong by up to a fifth in each value.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from haptic_wall.controller.detector.oscillation import State
from haptic_wall.controller.experiments.maps.kicks import unsaturated
from haptic_wall.controller.experiments.maps.onset import onset
from haptic_wall.controller.experiments.maps.walls import Walls, split_delay
from haptic_wall.controller.theory import max_virtual_damping
from haptic_wall.controller.theory.checks import FloatArray, IntArray
from haptic_wall.controller.theory.servos import SERVOS
from scripts.trials.hands import draw_hands, goes_on, handled
from scripts.trials.listening import COUNT, PERIOD, listen
from scripts.trials.watched import Trace, kicked, steady_oscillation

LEAST_KICK, LARGEST_KICK = 10.0 * COUNT, 0.3
WRONG = 0.2
NAMES = (*SERVOS, "Table II")
_PLANTS = (*((s.inertia, s.damping, s.coulomb) for s in SERVOS.values()), (1.0, 0.1, 0.0))
_LIMITS = (6.0, 8.4, 0.52, 0.39, np.inf)
"""Stall torques [N·m]"""
_SHARE = 0.1
_CYCLES = 60.0
_UNTIL = 3.0
_KICK_TOLERANCE, _HAND_TOLERANCE = 1e-3, 1e-2


@dataclass(frozen=True, slots=True)
class KickTrial:
    """The result of one kick."""

    name: str
    share: float
    """K over the limit for this kick"""
    undamped: bool
    """B = 0"""
    kick: float
    """[rad]"""
    lasts: bool
    """Whether the motion persists: at the end it has lost less than 7 % in twelve cycles"""
    alarm: bool
    early: bool
    """The alarm came before the amplitude reached twice the kick, or 10 counts"""
    reached: float
    """Amplitude until the alarm, over the kick; NaN without"""


@dataclass(frozen=True, slots=True)
class HandTrial:
    """The result of an operator on a wall below its limit."""

    name: str
    hand: str
    one_sided: bool
    seconds: float
    alarms: int
    real: int
    """Alarms after which the motion persists without the operator"""
    counts: float
    """Amplitude at the first alarm, in counts; NaN without"""
    small: bool
    """It was called sustained, too small for an alarm"""
    small_real: bool
    """And that motion persists without the operator, at its first occurrence"""


@dataclass(frozen=True, slots=True)
class SustainedTrial:
    """The detector's result on an oscillation that the torque limit keeps at one amplitude."""

    name: str
    counts: float
    """True amplitude [counts]"""
    alarm: bool
    shrinks: bool
    """At the end of the record it was still decreasing, and reported as such"""
    frequency_error: float
    amplitude_error: float
    """Relative"""


@dataclass(frozen=True, slots=True)
class Drawn:
    """Walls at their limit or above, with wrong beliefs."""

    walls: Walls
    """Their stiffness is the limit"""
    who: IntArray
    kick: FloatArray
    belief: FloatArray
    """Factors on inertia, damping, Coulomb friction and delay; shape (n, 4)"""


def _draw(count: int, random: np.random.Generator) -> tuple[Walls, IntArray]:
    who = random.integers(0, len(NAMES), count)
    m, b, c = np.array(_PLANTS)[who].T
    limit = np.array(_LIMITS)[who]
    delay = 1e-3 * np.where(
        random.random(count) < 0.5, random.integers(0, 11, count), random.uniform(0.0, 10.0, count)
    )
    damping = random.uniform(0.0, 0.5, count) * max_virtual_damping(m, b, PERIOD, delay)
    cap = 0.7 * _SHARE * limit * PERIOD / COUNT
    damping = np.where(damping > cap, cap * random.random(count), damping)
    damping[random.random(count) < 0.2] = 0.0
    whole, lag, rest = split_delay(delay, np.full(count, PERIOD))
    none = np.zeros(count)
    walls = Walls(
        inertia=m,
        damping=b,
        coulomb=c,
        counts_per_radian=np.full(count, 1.0 / COUNT),
        backlash=none,
        torque_limit=limit,
        torque_step=none,
        stiffness=none,
        virtual_damping=damping,
        period=np.full(count, PERIOD),
        whole=whole,
        lag=lag,
        rest=rest,
        velocity_samples=np.ones(count, dtype=np.int64),
        one_sided=np.zeros(count, dtype=np.bool_),
    )
    return walls, who


def _at_limit(
    walls: Walls, who: IntArray, kick: FloatArray, tolerance: float, random: np.random.Generator
) -> Drawn:
    """Return the walls with a known limit for the kick that respects the encoder's steps."""
    limit = onset(walls, kick, tolerance)
    step = (limit + walls.virtual_damping / PERIOD) * COUNT
    good = np.isfinite(limit) & (limit > 0.0)
    good &= step <= _SHARE * walls.torque_limit
    index = np.flatnonzero(good)
    some = walls.take(index).with_stiffness(limit[index, None])
    start = unsaturated(some, kick[index])
    large = np.flatnonzero(start >= 0.999 * LEAST_KICK)
    shape = (large.size, 4)
    corner = random.choice([-WRONG, WRONG], shape)
    wrong = np.where(random.random(shape) < 0.5, corner, random.uniform(-WRONG, WRONG, shape))
    return Drawn(some.take(large), who[index][large], start[large], 1.0 + wrong)


def draw_kicked(count: int, random: np.random.Generator) -> Drawn:
    """Draw walls at their limit for a kick, see ``kick_trials``."""
    walls, who = _draw(count, random)
    kick = np.exp(random.uniform(np.log(LEAST_KICK), np.log(LARGEST_KICK), count))
    return _at_limit(walls, who, kick, _KICK_TOLERANCE, random)


def kicked_at(drawn: Drawn, share: float) -> tuple[Walls, FloatArray, list[Trace]]:
    """Kick walls at this fraction of their limit; return walls, kicks [rad] and traces."""
    some = drawn.walls.with_stiffness(share * drawn.walls.stiffness[:, None])
    start = np.maximum(unsaturated(some, drawn.kick), LEAST_KICK)
    return some, start, kicked(some, start, _CYCLES, _UNTIL)


def kick_trials(count: int, seed: int, shares: tuple[float, ...]) -> list[KickTrial]:
    """Draw walls, kick each at these fractions of its limit for the kick, and run the detector.

    Args:
        count: Walls drawn; some have no limit, or none within the bound for the encoder's steps.
        seed: Seed of the draw.
        shares: K over the limit.
    """
    drawn = draw_kicked(count, np.random.default_rng(seed))
    trials = []
    for share in shares:
        some, start, traces = kicked_at(drawn, share)
        for i, trace in enumerate(traces):
            heard = listen(some, i, trace, drawn.belief[i], once=True)
            name = NAMES[drawn.who[i]]
            trials.append(kick_trial(name, share, some, i, float(start[i]), trace, heard.alarms))
    return trials


def kick_trial(
    name: str, share: float, walls: Walls, i: int, kick: float, trace: Trace, alarms: list[int]
) -> KickTrial:
    """Judge one kick.

    Args:
        name: Name of the servo.
        share: K over the limit.
        walls: The simulated walls.
        i: Index of the wall.
        kick: [rad]
        trace: Its record.
        alarms: Samples at which an alarm began.
    """
    size, place = np.abs(trace.position), trace.position
    large = np.flatnonzero(size >= max(2.0 * kick, LEAST_KICK))
    cycle = int(2.0 * np.pi * np.sqrt(walls.inertia[i] / walls.stiffness[i]) / PERIOD) + 1
    end, before = place[-2 * cycle :], place[-14 * cycle : -12 * cycle]
    alarm = bool(alarms)
    return KickTrial(
        name=name,
        share=share,
        undamped=bool(walls.virtual_damping[i] == 0.0),
        kick=kick,
        lasts=bool(large.size) or bool(before.size and np.ptp(end) > 0.93 * np.ptp(before) > 0.0),
        alarm=alarm,
        early=alarm and not (large.size and large[0] <= alarms[0]),
        reached=float(np.max(size[: alarms[0] + 1]) / kick) if alarm else np.nan,
    )


def sustained_trials(count: int, seed: int) -> list[SustainedTrial]:
    """Try oscillations at 1.3 to 2 times the limit, from 4 counts up, sustained by a torque limit.

    Args:
        count: Walls drawn; those whose amplitude does not settle are left out.
        seed: Seed of the draw.
    """
    random = np.random.default_rng(seed)
    walls, who = _draw(count, random)
    kick = np.exp(random.uniform(np.log(LEAST_KICK), np.log(LARGEST_KICK), count))
    drawn = _at_limit(walls, who, kick, _HAND_TOLERANCE, random)
    n = drawn.walls.size
    size = COUNT * np.exp(random.uniform(np.log(2.0), np.log(100.0), n))
    stiffness = random.uniform(1.3, 2.0, n) * drawn.walls.stiffness
    some = drawn.walls.with_stiffness(stiffness[:, None])
    limit = np.minimum(stiffness * size + 2.0 * some.coulomb, some.torque_limit)
    some = replace(some, torque_limit=limit)
    trials = []
    for i, trace in enumerate(kicked(some, np.maximum(size, drawn.kick), 2.0 * _CYCLES)):
        cycle = int(2.0 * np.pi * np.sqrt(some.inertia[i] / some.stiffness[i]) / PERIOD) + 1
        truth = steady_oscillation(trace.position[-12 * cycle :], PERIOD)
        if truth is None or truth[1] < 4.0 * COUNT:
            continue
        detector = listen(some, i, trace, drawn.belief[i], once=False).detector
        trials.append(
            SustainedTrial(
                NAMES[drawn.who[i]],
                truth[1] / COUNT,
                detector.alarm,
                detector.state == State.DECAYING,
                detector.frequency_hz / truth[0] - 1.0,
                detector.amplitude / truth[1] - 1.0,
            )
        )
    return trials


def draw_held(count: int, random: np.random.Generator) -> Drawn:
    """Draw walls at nine tenths of their limit, see ``hand_trials``."""
    walls, who = _draw(count, random)
    walls = replace(walls, one_sided=random.random(count) < 0.4)
    # Without Coulomb friction: the limit for the largest motion that an operator may make.
    slippery = replace(walls, coulomb=np.zeros(count))
    drawn = _at_limit(slippery, who, np.full(count, LARGEST_KICK), _HAND_TOLERANCE, random)
    some = drawn.walls.with_stiffness(0.9 * drawn.walls.stiffness[:, None])
    return replace(drawn, walls=replace(some, coulomb=np.array(_PLANTS)[drawn.who, 2]))


def hand_trials(count: int, seed: int, hand: str, seconds: float) -> list[HandTrial]:
    """Try an operator on walls at 0.9 of their limit without friction; four in ten one-sided.

    Args:
        count: Walls drawn; see ``kick_trials``.
        seed: Seed of the draw.
        hand: One of ``hands.HANDS``.
        seconds: For each wall.
    """
    random = np.random.default_rng(seed)
    drawn = draw_held(count, random)
    some = drawn.walls
    trials = []
    hands = draw_hands(some, hand, round(seconds / PERIOD), random)
    for i, trace in enumerate(handled(some, hands)):
        heard = listen(some, i, trace, drawn.belief[i], once=False)
        small = heard.small[:1]
        trials.append(
            HandTrial(
                name=NAMES[drawn.who[i]],
                hand=hand,
                one_sided=bool(some.one_sided[i]),
                seconds=seconds,
                alarms=len(heard.alarms),
                real=sum(goes_on(some, hands, i, heard.alarms)),
                counts=heard.counts,
                small=bool(small),
                small_real=any(goes_on(some, hands, i, small)),
            )
        )
    return trials


def above_limit(count: int, shares: tuple[float, float], random: np.random.Generator) -> Drawn:
    """Draw walls without damping, stiffer by a factor than is stable for their kick."""
    walls, who = _draw(count, random)
    walls = replace(walls, virtual_damping=np.zeros(count))
    kick = np.exp(random.uniform(np.log(LEAST_KICK), np.log(LARGEST_KICK), count))
    drawn = _at_limit(walls, who, kick, _KICK_TOLERANCE, random)
    share = random.uniform(*shares, drawn.walls.size)
    return replace(drawn, walls=replace(drawn.walls, stiffness=drawn.walls.stiffness * share))
