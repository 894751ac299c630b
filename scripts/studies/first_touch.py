"""Computes the figures for the choice of a real servo's first wall.

    scripts/study first_touch

The tables of docs/evidence/first-touch.md; the same on every machine.
"""

import itertools
import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from haptic_wall.controller.guard.belief import Belief
from haptic_wall.controller.guard.guard import decide
from haptic_wall.controller.guard.limits import evaluate
from haptic_wall.controller.guard.plants import Plants
from haptic_wall.controller.guard.types import Situation
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.settings.load import load_config
from haptic_wall.hw.dynamixel.torque_law import TorqueLaw, torque_law
from haptic_wall.hw.emulated.motor import Motor, motor_of
from haptic_wall.hw.plant.body import PlantParameters, State, step
from scripts.study import Found, Given, Part, Study, table
from scripts.trials.truth import COUNT
from scripts.whole_program import hardware_of

CANDIDATES = {
    "xm430-w350": ((2.0, 0.005), (7.0, 0.04), (10.0, 0.04), (15.0, 0.04)),
    "xl330-m288": ((0.25, 0.001), (0.6, 0.005), (0.8, 0.005), (1.2, 0.005)),
}
PERIOD = 1e-3
AGE = 0.0006
"""Of a sample when its torque is sent [s]"""
LONG_LAGS = {"xm430-w350": 0.004, "xl330-m288": 0.008}
"""Longer than believed [s]"""
FINGER_SPEED = 0.5
"""At which the finger turns the shaft [rad/s]"""
KICKS = (2.0, 8.0, 14.0, 20.0, 30.0)
"""[°]"""
QUIET_COUNTS = 4
SWING_S, SPAN_S = 10.0, 0.5
"""How long a kicked wall is watched, and the pieces in which that is judged [s]"""
DIES = 0.98
"""Largest part of a dying motion that two pieces leave"""


@dataclass(frozen=True, slots=True)
class Corner:
    """One servo at the bounds of a preset's belief."""

    inertia: float
    damping: float
    coulomb: float
    gain: float


@dataclass(frozen=True, slots=True)
class Kicked:
    """A two-sided wall on one servo, kicked."""

    corner: Corner
    sent: TorqueLaw
    """Rounds a torque to what the servo can be sent"""
    motor: Motor | None
    """None: without back-EMF"""
    supply: float
    torque_limit: float
    stiffness: float
    damping: float
    lag: float
    """From a sample to its torque acting [s]"""
    kick: float
    """[rad]"""


def corners(belief: Belief, coulomb: tuple[float, ...]) -> list[Corner]:
    """The corners of what is believed, with these Coulomb frictions [N·m]."""
    return [
        Corner(*values)
        for values in itertools.product(
            (belief.inertia.low, belief.inertia.high),
            (belief.damping.low, belief.damping.high),
            coulomb,
            (belief.torque_gain.low, belief.torque_gain.high),
        )
    ]


def swings_on(case: Kicked) -> bool:
    """Whether the motion does not die: at the end it is above ``QUIET_COUNTS``, and no smaller.

    A motion that is below that for ``SPAN_S`` is over.
    """
    corner, motor = case.corner, case.motor
    state, last = State(case.kick, 0.0), round(case.kick / COUNT) * COUNT
    whole, rest = divmod(case.lag, PERIOD)
    pending = deque([0.0] * int(whole))
    before = 0.0
    span = round(SPAN_S / PERIOD)
    sizes: list[float] = []
    for _ in range(round(SWING_S / SPAN_S)):
        largest, smallest = -math.inf, math.inf
        for _ in range(span):
            position = round(state.position / COUNT) * COUNT
            torque = -case.stiffness * position - case.damping * (position - last) / PERIOD
            last = position
            largest, smallest = max(largest, position), min(smallest, position)
            limited = min(max(torque, -case.torque_limit), case.torque_limit)
            pending.append(case.sent.torque(case.sent.goal(limited)))
            after = pending.popleft()
            for acting, seconds in ((before, rest), (after, PERIOD - rest)):
                damping, acts = corner.damping, corner.gain * acting
                if motor is not None:
                    duty = motor.duty(acts / motor.torque_constant, case.supply, state.velocity)
                    if abs(duty) > 1.0:  # the supply drives no more than this
                        full = math.copysign(case.supply, duty)
                        acts = motor.torque_constant * full / motor.resistance
                        damping += motor.braking
                body = PlantParameters(corner.inertia, damping, corner.coulomb)
                state = step(state, body, acts, seconds)
            before = after
        sizes.append(0.5 * (largest - smallest))
        if sizes[-1] <= QUIET_COUNTS * COUNT:
            return False
    return sizes[-1] > DIES * sizes[-3]


def _sent(config: Config) -> TorqueLaw:
    model, _ = hardware_of(config)
    return torque_law(model, model.torque_constant or math.nan, model.voltage)


def _kicked(config: Config, stiffness: float, damping: float, lag: float, *, emf: bool) -> str:
    """The least kick that swings on in any corner of the belief, or none of ``KICKS``."""
    model, limit = hardware_of(config)
    motor = motor_of(model, model.torque_constant or math.nan) if emf else None
    belief = config.belief()
    low = corners(belief, (belief.coulomb.low,))
    for kick in KICKS:
        cases = [
            Kicked(
                corner,
                _sent(config),
                motor,
                model.voltage,
                limit,
                stiffness,
                damping,
                lag,
                math.radians(kick),
            )
            for corner in low
        ]
        if any(map(swings_on, cases)):
            return f"from {kick:g}°"
    return "none"


def _limits(config: Config, damping: float, lag: float) -> tuple[float, float]:
    """Least exact and one-sided limit over the belief's corners [N·m/rad], in commanded units."""
    belief = config.belief()
    exact, one_sided = math.inf, math.inf
    for corner in corners(belief, (0.0,)):
        one = np.ones(1)
        plant = Plants(
            corner.inertia * one,
            corner.damping * one,
            corner.gain * one,
            PERIOD * one,
            (AGE + lag) * one,
        )
        situation = Situation(belief, PERIOD, hardware_of(config)[1], COUNT)
        request = replace(config.request(), damping=damping)
        found = evaluate(request, config.guard_settings(), situation, plant, 1e-3)
        exact = min(exact, float(found.exact[0]))
        assert found.one_sided is not None
        one_sided = min(one_sided, float(found.one_sided[0]))
    return exact, one_sided


def _fingers(config: Config, stiffness: float, degrees: float) -> str:
    """Finger torque at a depth, and over what the gear's drag takes outside of the wall."""
    belief = config.belief()

    def drag(coulomb: float, damping: float) -> float:
        return coulomb + damping * FINGER_SPEED

    sent = _sent(config)
    spring = sent.torque(sent.goal(stiffness * math.radians(degrees)))
    value = belief.torque_gain.value * spring
    outside = drag(belief.coulomb.value, belief.damping.value)
    least = belief.torque_gain.low * spring / drag(belief.coulomb.high, belief.damping.high)
    most = belief.torque_gain.high * spring / drag(belief.coulomb.low, belief.damping.low)
    return f"{value + outside:.2g} (+{least:.2g} to {most:.2g})"


Wall = tuple[str, float, float]
"""Preset, K [N·m/rad], B [N·m·s/rad]"""


def row(case: Wall) -> list[str]:
    """One wall's row of a preset's table."""
    name, stiffness, damping = case
    config = load_config(name).config
    belief, (_, limit) = config.belief(), hardware_of(config)
    situation = Situation(belief, PERIOD, limit, COUNT)
    request = replace(config.request(), stiffness=stiffness, damping=damping)
    decision = decide(request, config.guard_settings(), situation, [AGE])[0]
    bound = f" ({decision.binding})" if decision.binding else ""
    count = stiffness * COUNT + damping * COUNT / PERIOD
    believed = _limits(config, damping, belief.delay.high)
    long_lag = LONG_LAGS[name]
    late = _limits(config, damping, long_lag)
    cells = [
        f"{stiffness:g}, {damping:g}",
        f"{decision.stiffness:.3g}{bound}",
        _fingers(config, stiffness, 1.0),
        _fingers(config, stiffness, 5.0),
        f"{believed[1]:.3g}; {believed[0]:.3g}",
        f"{late[1]:.3g}; {late[0]:.3g}",
        f"{100 * count / limit:.1f} %",
    ]
    for lag in (belief.delay.high, long_lag):
        swings = [_kicked(config, stiffness, damping, AGE + lag, emf=emf) for emf in (False, True)]
        cells.append("; ".join(swings))
    return cells


def lines(found: Found[Wall, list[str]]) -> list[str]:
    """The table of one preset."""
    name = found[0][0][0]
    belief = load_config(name).config.belief()
    high, longer = 1e3 * belief.delay.high, 1e3 * LONG_LAGS[name]
    drag = belief.coulomb.value + belief.damping.value * FINGER_SPEED
    head = [
        *("K, B", "commanded by the guard", "finger at 1° [N·m]", "at 5°"),
        *(f"limits, lag {high:g} ms", f"limits, lag {longer:g} ms", "one count"),
        *(f"kick that swings on, lag {high:g} ms", f"lag {longer:g} ms"),
    ]
    needs = f"The finger needs {drag:.2g} N·m outside of the wall."
    return [*table(head, *(cells for _, cells in found)), "", needs]


def walls(name: str) -> Callable[[Given], list[Wall]]:
    """The candidates of a preset."""
    return lambda _given: [(name, *wall) for wall in CANDIDATES[name]]


STUDY = Study(
    "evidence/first-touch.md",
    tuple(
        Part(
            name,
            walls(name),
            row,
            lines,
            case_s=25.0,
        )
        for name in CANDIDATES
    ),
    everywhere=True,
)
