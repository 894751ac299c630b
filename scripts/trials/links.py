"""Walls beyond the ceiling of a link's vibration, with the guard off: is it noticed?"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from haptic_wall.controller.runtime.session import run_session
from haptic_wall.controller.runtime.telemetry import Telemetry
from haptic_wall.controller.settings.load import load_config
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.controller.theory.flexible import flexible_ceiling
from haptic_wall.hw.clock import SimulatedClock

INERTIA, DAMPING, PERIOD = 0.011951, 0.011692, 1e-3
_COUNT = math.tau / 4096
_KICK, _TORQUE = 0.1, 1.0
_SOFT = 0.4
"""Largest stiffness, over the linear condition: the spring's own oscillation is stable"""
_SECONDS, _WINDOW = 6.0, 250


class LinkTrial(NamedTuple):
    """One wall and what became of the vibration."""

    share: float
    """Virtual damping over the ceiling"""
    largest: float
    """Amplitude of the vibration, at most over windows of a quarter second [counts]"""
    last: float
    """In the last such window, up to the alarm [counts]"""
    alarm_s: float
    """First alarm; NaN: none [s]"""


def link_trials(seed: int, count: int, share: float) -> list[LinkTrial]:
    """Draw servos with a link, and run a wall on each after a kick of 0.1 rad."""
    random = np.random.default_rng(seed)
    return [_trial(random, share) for _ in range(count)]


def _trial(random: np.random.Generator, share: float) -> LinkTrial:
    load = INERTIA * random.uniform(0.1, 1.5)
    hertz, ratio = np.exp(random.uniform(np.log([12.0, 0.005]), np.log([90.0, 0.05])))
    delay, coulomb = random.uniform(0.0, 3e-3), random.choice([0.0, 0.002, 0.01])
    moving, rate = INERTIA * load / (INERTIA + load), math.tau * hertz
    stiffness, damping = moving * rate**2, 2.0 * ratio * moving * rate
    ceiling = flexible_ceiling(INERTIA, DAMPING, load, stiffness, damping, PERIOD, delay)
    big_b = share * float(ceiling)
    spring = min(_TORQUE / _KICK, _SOFT * (DAMPING + big_b) / (0.5 * PERIOD + delay))
    given = {
        "loop.clock": "simulated",
        "guard.mode": "off",
        "wall.side": "both",
        "wall.stiffness": spring,
        "wall.damping": big_b,
        "servo.hand": "none",
        "servo.kick": _KICK,
        "servo.inertia": INERTIA,
        "servo.damping": DAMPING,
        "servo.coulomb": coulomb,
        "servo.delay": delay,
        "servo.load_inertia": load,
        "servo.transmission_stiffness": stiffness,
        "servo.transmission_damping": damping,
    }
    config = load_config("simulated", [f"{name}={value}" for name, value in given.items()]).config
    telemetry = Telemetry.create()
    run_session(config, SimulatedClock(), telemetry, _SECONDS)
    rows, _ = telemetry.read(0)
    alarmed = np.flatnonzero(rows["oscillation"] >= 2)
    position = rows["position"][np.isfinite(rows["position"])]
    sizes = [
        _amplitude(position[max(end - _WINDOW, 0) : end], hertz)
        for end in range(position.size, _WINDOW, -_WINDOW)
    ]
    alarm = float(alarmed[0]) * PERIOD if alarmed.size else math.nan
    return LinkTrial(share, max(sizes, default=0.0), sizes[0] if sizes else 0.0, alarm)


def _amplitude(position: FloatArray, hertz: float) -> float:
    """Return the largest amplitude near a frequency [counts]."""
    time = np.arange(position.size) * PERIOD
    window = np.hanning(position.size)
    swing = (position - position.mean()) * window
    near = hertz * np.linspace(0.8, 1.2, 41)
    found = np.exp(-1j * math.tau * np.outer(near, time)) @ swing
    return float(2.0 * np.abs(found).max() / window.sum() / _COUNT)
