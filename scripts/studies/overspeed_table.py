"""Tries the overspeed trip on hands and runaways drawn at random.

    scripts/study overspeed_table [--cases N] [--seed N]

The wall, the trip and the exact plant in one loop of 1 kHz with 4096 counts; the same seed gives
the same figures.
"""

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from haptic_wall.controller.detector.acting import ActingTorque
from haptic_wall.controller.guard.belief import Belief
from haptic_wall.controller.guard.guard import decide
from haptic_wall.controller.guard.types import Situation
from haptic_wall.controller.laws.wall import Side, Wall
from haptic_wall.controller.runtime.overspeed import SLACK_COUNTS, DrivenLimits, DrivenSpeed
from haptic_wall.controller.settings.load import load_config
from haptic_wall.controller.settings.shares import DRIVEN_SHARE
from haptic_wall.hw.emulated.motor import Motor, motor_of
from haptic_wall.hw.plant.body import PlantParameters, Pull, State, step
from haptic_wall.hw.servo import JUMP_SHARE, JUMP_SPEED
from scripts.study import Found, Given, Option, Part, Study, table
from scripts.trials.truth import COUNT
from scripts.whole_program import hardware_of

PERIOD = 1e-3
PRESETS = ("xm430-w350", "xl330-m288")
AGE = 0.0006
"""Of a sample when its torque is sent [s]"""
RUN_S = 1.2
GRIP, GRIP_DAMPING = 40.0, 0.4
"""A firm hand's spring [N·m/rad] and damper [N·m·s/rad]"""


@dataclass(frozen=True, slots=True)
class Preset:
    """A servo as its preset believes it to be."""

    name: str
    belief: Belief
    motor: Motor
    supply: float
    no_load: float
    torque_limit: float
    dampings: tuple[float, ...]
    allowed: tuple[float, ...]
    """Stiffness that the guard allows at each of the dampings [N·m/rad]"""


@dataclass(frozen=True, slots=True)
class Case:
    """One servo, one wall, and how the shaft is moved."""

    preset: str
    inertia: float
    damping: float
    coulomb: float
    gain: float
    lag: float
    """From a sample to its torque acting [s]"""
    back_emf: bool
    stiffness: float
    virtual_damping: float
    side: Side
    position: float
    """At the start [rad]"""
    speed: float
    """At the start [rad/s]"""
    hand: str
    """none; press, then let go; jerk: press, then pulled out; shake"""
    hand_size: float
    """Depth [rad], amplitude [rad]"""
    hand_speed: float
    """Speed of the jerk [rad/s], frequency of the shaking [Hz]"""
    sign: int = 1
    """-1: the torque is commanded with the wrong sign"""


@dataclass(frozen=True, slots=True)
class Outcome:
    """Result of a case."""

    trip_s: float
    """NaN: no trip"""
    fast_s: float
    """When the speed alone, driven by the torque over the window, was above the limit; NaN: not"""
    jumped: bool
    """The limit of any motion has tripped"""


@cache
def preset(name: str) -> Preset:
    """The preset, with what its guard allows."""
    config = load_config(name).config
    model, limit = hardware_of(config)
    situation = Situation(config.belief(), PERIOD, limit, COUNT)
    most = 0.5 * config.guard.quantisation_share * limit * PERIOD / COUNT
    dampings = tuple(float(share * most) for share in (0.02, 0.1, 0.3, 1.0))
    allowed = []
    for damping in dampings:
        request = replace(config.request(), stiffness=1e6, damping=damping)
        allowed.append(decide(request, config.guard_settings(), situation, [AGE])[0].stiffness)
    return Preset(
        name,
        config.belief(),
        motor_of(model, model.torque_constant or math.nan),
        model.voltage,
        model.no_load_speed,
        limit,
        dampings,
        tuple(allowed),
    )


def _hand(case: Case, time_s: float) -> Pull | None:
    """The hand's pull in the period that begins at ``time_s``."""
    if case.hand == "none":
        return None
    if case.hand == "shake":
        turn = math.tau * case.hand_speed
        at, slope = math.sin(turn * time_s), turn * math.cos(turn * time_s)
        return Pull(GRIP, GRIP_DAMPING, case.hand_size * at, case.hand_size * slope)
    pressed_s = 0.5
    if time_s < pressed_s:
        slope = case.hand_size / pressed_s
        return Pull(GRIP, GRIP_DAMPING, slope * time_s, slope)
    if case.hand == "press":
        return None
    return Pull(
        GRIP,
        GRIP_DAMPING,
        case.hand_size - case.hand_speed * (time_s - pressed_s),
        -case.hand_speed,
    )


def played(case: Case) -> Outcome:
    """Run the wall until the trip, or for ``RUN_S``."""
    servo = preset(case.preset)
    belief, motor = servo.belief, servo.motor
    gain = belief.torque_gain.high
    limits = DrivenLimits(
        DRIVEN_SHARE * servo.no_load,
        COUNT,
        servo.torque_limit,
        belief.inertia.low / gain,
        belief.damping.low / gain,
        belief.coulomb.low / gain,
    )
    driven = DrivenSpeed(limits)
    alone = DrivenSpeed(replace(limits, inertia=0.0))
    believed = ActingTorque((AGE + belief.delay.value) / PERIOD)
    wall = Wall(case.stiffness, case.virtual_damping, 0.0, case.side)
    program = Wall(0.0, 0.0, 0.0, case.side)
    program.guarded = False  # so that speed alone decides
    state = State(case.position, case.speed)
    late = round(case.lag / PERIOD)
    pending = deque([0.0] * late)
    last = round(case.position / COUNT) * COUNT
    fast_s = trip_s = math.nan
    jumped = False
    fastest = JUMP_SHARE * servo.no_load if case.back_emf else JUMP_SPEED
    for k in range(round(RUN_S / PERIOD)):
        now_ns = k * 1_000_000
        position = round(state.position / COUNT) * COUNT
        acted, contact = believed.acted(1), wall.in_contact(position)
        if math.isnan(fast_s) and alone.too_fast(position, now_ns, acted, contact, program):
            fast_s = k * PERIOD
        jumped = abs(position - last) > fastest * PERIOD + SLACK_COUNTS * COUNT
        if driven.too_fast(position, now_ns, acted, contact, wall) or jumped:
            trip_s = k * PERIOD
            break
        torque = case.sign * wall.torque(position, (position - last) / PERIOD)
        torque = min(max(torque, -servo.torque_limit), servo.torque_limit)
        believed.send(torque)
        last = position
        pending.append(torque)
        acting = case.gain * pending.popleft()
        damping = case.damping
        if case.back_emf:
            duty = motor.duty(acting / motor.torque_constant, servo.supply, state.velocity)
            if abs(duty) > 1.0:  # the supply drives no more than this
                full = math.copysign(servo.supply, duty)
                acting = motor.torque_constant * full / motor.resistance
                damping += motor.braking
        body = PlantParameters(case.inertia, damping, case.coulomb)
        state = step(state, body, acting, PERIOD, _hand(case, k * PERIOD))
    return Outcome(trip_s, fast_s, jumped)


def _drawn(rng: np.random.Generator) -> Case:
    """A servo within its preset's bounds at a wall that the guard allows; nothing moves it."""
    servo = preset(PRESETS[int(rng.integers(len(PRESETS)))])
    belief = servo.belief
    which = int(rng.integers(len(servo.dampings)))

    def within(bounds: object) -> float:
        low, high = bounds.low, bounds.high  # type: ignore[attr-defined]
        ends = rng.random() < 0.5
        return float(rng.choice([low, high]) if ends else rng.uniform(low, high))

    return Case(
        preset=servo.name,
        inertia=within(belief.inertia),
        damping=within(belief.damping),
        coulomb=within(belief.coulomb),
        gain=within(belief.torque_gain),
        lag=AGE + rng.uniform(0.0, belief.delay.high),
        back_emf=servo.motor.senses_supply or bool(rng.random() < 0.5),
        stiffness=servo.allowed[which] * rng.uniform(0.1, 1.0),
        virtual_damping=servo.dampings[which],
        side="above",
        position=0.0,
        speed=0.0,
        hand="none",
        hand_size=0.0,
        hand_speed=0.0,
    )


def _no_load(case: Case) -> float:
    return preset(case.preset).no_load


def _thrown(rng: np.random.Generator) -> Case:
    case = _drawn(rng)
    return replace(case, speed=rng.uniform(0.3, 2.5) * _no_load(case))


def _free(rng: np.random.Generator) -> Case:
    case = _drawn(rng)
    return replace(case, speed=-rng.uniform(0.8, 2.5) * _no_load(case))


def _let_go(rng: np.random.Generator) -> Case:
    return replace(_drawn(rng), hand="press", hand_size=rng.uniform(0.05, 0.8))


def _jerked(rng: np.random.Generator) -> Case:
    case = _let_go(rng)
    return replace(case, hand="jerk", hand_speed=rng.uniform(0.5, 2.0) * _no_load(case))


def _shaken(rng: np.random.Generator) -> Case:
    case, hertz = _drawn(rng), rng.uniform(1.0, 4.0)
    size = rng.uniform(0.5, 1.5) * _no_load(case) / (math.tau * hertz)
    return replace(case, side="both", hand="shake", hand_size=size, hand_speed=hertz)


def _far(rng: np.random.Generator) -> Case:
    case = _drawn(rng)
    servo = preset(case.preset)
    far = math.exp(rng.uniform(math.log(0.5), math.log(19.0)))
    # Enough to move it at all, and clearly: five times its friction.
    least = 5.0 * servo.belief.coulomb.high / (far * servo.belief.torque_gain.low)
    return replace(case, side="both", position=far, stiffness=max(case.stiffness, least))


def _wrong_sign(rng: np.random.Generator) -> Case:
    return replace(_drawn(rng), side="both", position=0.1, speed=1.0, sign=-1)


def _unstable(rng: np.random.Generator) -> Case:
    case = _drawn(rng)
    servo = preset(case.preset)
    return replace(
        case,
        side="both",
        position=0.1,
        stiffness=case.stiffness * rng.uniform(2.0, 5.0),
        virtual_damping=-rng.uniform(0.0, 0.5) * servo.dampings[1],
    )


def _late(rng: np.random.Generator) -> Case:
    case = _unstable(rng)
    return replace(case, lag=rng.uniform(1.0, 4.0) * preset(case.preset).belief.delay.high)


Draw = Callable[[np.random.Generator], Case]
HANDS: dict[str, Draw] = {
    "thrown at the wall, 0.3 to 2.5 times the no-load speed": _thrown,
    "thrown outside of the wall": _free,
    "pressed in by 3 to 46°, then let go": _let_go,
    "pressed in, then pulled out by hand at 0.5 to 2 times the no-load speed": _jerked,
    "a two-sided wall shaken at 1 to 4 Hz, up to 1.5 times the no-load speed": _shaken,
}
RUNAWAYS: dict[str, Draw] = {
    "a two-sided wall comes on 0.5 to 19 rad away": _far,
    "the law has the wrong sign": _wrong_sign,
    "no guard: 2 to 5 times the allowed stiffness, damping below zero": _unstable,
    "the same with 1 to 4 times the longest lag that is believed": _late,
}


Named = tuple[str, Case]
"""An event, and the servo it happens to"""


def drawn(kinds: Mapping[str, Draw]) -> Callable[[Given], list[Named]]:
    """As many cases of each kind as are wanted."""

    def cases(given: Given) -> list[Named]:
        rngs = {name: np.random.default_rng(given.seed) for name in kinds}
        return [(name, kinds[name](rng)) for name, rng in rngs.items() for _ in range(given.cases)]

    return cases


def outcome(case: Named) -> Outcome:
    """Run one of them."""
    return played(case[1])


def _by_kind(found: Found[Named, Outcome]) -> dict[str, list[Outcome]]:
    kinds: dict[str, list[Outcome]] = {}
    for (name, _), one in found:
        kinds.setdefault(name, []).append(one)
    return kinds


def _fast(some: Sequence[Outcome]) -> list[Outcome]:
    return [one for one in some if not math.isnan(one.fast_s)]


def _tripped(some: Sequence[Outcome]) -> str:
    return f"{sum(not math.isnan(one.trip_s) for one in some)} of {len(some)}"


def hands(found: Found[Named, Outcome]) -> list[str]:
    """How many motions by hand were fast, and how many tripped."""
    rows = [[name, f"{len(_fast(some))}", _tripped(some)] for name, some in _by_kind(found).items()]
    return table(["what", "fast", "tripped"], *rows)


def runaways(found: Found[Named, Outcome]) -> list[str]:
    """How many runaways that were fast tripped, and how soon."""
    rows = []
    for name, some in _by_kind(found).items():
        fast = _fast(some)
        later = [1e3 * (o.trip_s - o.fast_s) for o in fast if not math.isnan(o.trip_s)]
        words = f"{np.median(later):.0f}; {max(later):.0f}" if later else "none"
        jumped = sum(o.jumped for o in some)
        rows.append([name, f"{len(fast)} of {len(some)}", _tripped(fast), f"{jumped}", words])
    return table(
        [
            *("what", "fast", "tripped of these", "by the limit of any motion"),
            "after it was fast, median; longest [ms]",
        ],
        *rows,
    )


STUDY = Study(
    "evidence/overspeed-table.md",
    (
        Part("hands", drawn(HANDS), outcome, hands, case_s=0.02),
        Part("runaways", drawn(RUNAWAYS), outcome, runaways, case_s=0.02),
    ),
    (Option("cases", 1000, "random cases of each kind"), Option("seed", 1, "seed of the cases")),
)
