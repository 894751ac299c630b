"""Draws simulated servos with the effects of real ones, at the sizes that are published of them.

The ranges are those of docs/concepts/plant.md; where nothing is published, of the sizes in
config/emulated-xm430.yaml.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.settings.load import load_config

SPREAD = 0.2
"""Share by which a servo's inertia and friction may lie off its model's"""
BELIEVED = {"inertia": 1.5, "damping": 2.0, "coulomb": 2.0}
"""Factors between a believed value and its bounds, as in the presets of real servos"""
LONGEST_S = 5e-3
"""Of the delay"""


class Kind(NamedTuple):
    """A servo as its data say it is."""

    name: str
    inertia: float
    damping: float
    coulomb: float
    torque_limit: float
    no_load_speed: float


KINDS = (
    Kind("XL330-like", 0.0018142, 0.0036617, 0.012833, 0.52, 10.9),
    Kind("XM430-like", 0.011951, 0.011692, 0.09039, 4.1, 4.82),
)
EFFECTS = (
    "stribeck",
    "stiction",
    "direction",
    "load",
    "gravity",
    "cogging",
    "eccentricity",
    "noise",
    "current loop",
    "droop",
    "dead band",
    "backlash",
)
"""Effects, each of which is drawn alone and together with all others"""
STATIC, STRIBECK = (1.4, 2.5), (1.1, 2.6)
"""Friction at rest over that in motion, and the speed over which it fades [rad/s]: bam's fits"""
BACKWARD = (0.8, 1.25)
"""Viscous friction at negative over that at positive speeds: not published"""
LOAD = (0.05, 0.15)
"""Share of the load: 0.076 to 0.122 in bam's fits"""
GRAVITY, COGGING, PERIODS = 1.1, 0.33, (4, 96)
"""Largest torques over the Coulomb friction; periods of the cogging in a turn: not published"""
ECCENTRICITY, NOISE = 0.005, 0.3
"""Largest [rad], [counts]: not published"""
BANDWIDTH, LOOP_PERIOD = (100.0, 1000.0), 3e-4
"""Of the current loop [Hz]; its longest period [s]: not published"""
DROOP, DEAD_BAND = 0.03, 0.03
"""Largest; an MX-106 fits 0.02. Largest dead band over the stall torque: 3 % of an XM430's"""
BACKLASH = 0.00436
"""Largest between shaft and encoder [rad]: 15 arcmin, in the tables of the XM540 and XH430"""
ALL = "all together"
IDEAL = "none"


def drawn_servo(kind: Kind, effect: str, seed: int) -> Config:
    """Return the configuration of a seed's servo, whose belief is that of its model.

    Args:
        kind: The model.
        effect: ``IDEAL``, one of ``EFFECTS``, or ``ALL`` of them.
        seed: Decides on all that is drawn; the same servo has the same inertia, friction and delay
            with every effect.
    """
    random = np.random.default_rng(seed)
    inertia, damping, coulomb = random.uniform(1 - SPREAD, 1 + SPREAD, 3).tolist()
    delay, between = random.uniform((0.0, 0.0), (LONGEST_S, math.tau / 4096)).tolist()
    servo = {
        "inertia": kind.inertia * inertia,
        "damping": kind.damping * damping,
        "coulomb": kind.coulomb * coulomb,
        "delay": delay,
        "kick": between,
        "torque_limit": kind.torque_limit,
        "torque_step": 0.0,
        "no_load_speed": kind.no_load_speed,
        **_effects(kind, effect, kind.coulomb * coulomb, kind.damping * damping, random),
    }
    sets = [
        "loop.clock=simulated",
        "wall.side=both",
        f"safety.max_speed={1.6 * kind.no_load_speed:.3g}",
        f"model.delay={{value: {LONGEST_S / 2}, low: 0.0, high: {LONGEST_S}}}",
    ]
    for name, factor in BELIEVED.items():
        value = getattr(kind, name)
        bounds = f"{{value: {value}, low: {value / factor}, high: {value * factor}}}"
        sets.append(f"model.{name}={bounds}")
    sets += [f"servo.{name}={str(value).lower()}" for name, value in servo.items()]
    return load_config("simulated", sets).config


def _effects(
    kind: Kind, effect: str, coulomb: float, damping: float, random: np.random.Generator
) -> dict[str, Any]:
    """Return the fields of the effects; as many numbers are drawn for each effect."""
    static, stribeck = random.uniform(*np.transpose([STATIC, STRIBECK])).tolist()
    backward = math.exp(random.uniform(*np.log(BACKWARD)))
    load, droop = random.uniform(*LOAD), random.uniform(0.0, DROOP)
    gravity, cogging = (random.uniform(0.0, 1.0, 2) * (GRAVITY, COGGING) * kind.coulomb).tolist()
    angle, phase, turned = random.uniform(-math.pi, math.pi, 3).tolist()
    gravity = min(gravity, 0.8 * coulomb)  # it stays where it is without torque
    periods = int(random.integers(*PERIODS, endpoint=True))
    eccentricity, noise = (random.uniform(0.0, 1.0, 2) * (ECCENTRICITY, NOISE)).tolist()
    bandwidth = math.exp(random.uniform(*np.log(BANDWIDTH)))
    loop_period = random.uniform(0.0, LOOP_PERIOD)
    dead_band = random.uniform(0.0, DEAD_BAND * kind.torque_limit)
    backlash = random.uniform(0.0, BACKLASH)
    drive = {"current_bandwidth": bandwidth, "current_period": loop_period, "back_emf": True}
    fields: dict[str, dict[str, Any]] = {
        "stribeck": {"static_friction": static * coulomb, "stribeck_speed": stribeck},
        "stiction": {"static_friction": static * coulomb},
        "direction": {"damping_back": backward * damping},
        "load": {"load_friction": load},
        "gravity": {"gravity": gravity, "gravity_angle": angle},
        "cogging": {"cogging": cogging, "cogging_periods": periods, "cogging_phase": phase},
        "eccentricity": {"encoder_eccentricity": eccentricity, "encoder_phase": turned},
        "noise": {"encoder_noise": noise},
        "current loop": drive,
        "droop": {"back_emf": True, "current_droop": droop},
        "dead band": {"dead_band": dead_band},
        "backlash": {"backlash": backlash},
    }
    if effect == ALL:
        every = (*EFFECTS, "stribeck")  # in place of the stiction alone
        return {name: value for each in every for name, value in fields[each].items()}
    return {} if effect == IDEAL else fields[effect]


def truth_of(kind: Kind, config: Config) -> tuple[float, float, float]:
    """Return inertia, damping and delay as the guard must not overestimate what they allow.

    The damping is that in the direction where it is less. A current loop counts as half its period
    of delay, and by what it makes of the motion: with the back-EMF k that it takes away after its
    time constant tau, ::

        tau u' = command - u - k tau x'',    m x'' = u
        x / command = 1 / (s² (m + k tau) (1 + tau m / (m + k tau) s))

    so it is k tau of inertia, and a lag of tau m / (m + k tau).
    """
    servo = config.servo
    damping, inertia = servo.damping, servo.inertia
    assert damping is not None and inertia is not None, "the drawn servo has both"
    back = damping if servo.damping_back is None else servo.damping_back
    bandwidth = servo.current_bandwidth or 0.0
    lag = 1.0 / (math.tau * bandwidth) if bandwidth else 0.0
    motor = kind.torque_limit / kind.no_load_speed if servo.back_emf else 0.0
    whole = inertia + motor * lag
    delay = (servo.delay or 0.0) + lag * inertia / whole + 0.5 * (servo.current_period or 0.0)
    return whole, min(damping, back), delay
