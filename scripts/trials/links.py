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
from scripts.trials.truth import COUNT

INERTIA, DAMPING, PERIOD = 0.011951, 0.011692, 1e-3
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


class LinkRun(NamedTuple):
    """A drawn servo with a link, and the rows of a wall on it, up to an alarm."""

    load: float
    """[kg·m²]"""
    hertz: float
    """Of the vibration with both ends free [Hz]"""
    ratio: float
    """Its damping ratio"""
    delay: float
    """[s]"""
    position: FloatArray
    """[rad]"""
    torque: FloatArray
    """Commanded [N·m]"""
    alarm_s: float
    """First alarm; NaN: none [s]"""

    @property
    def largest_and_last(self) -> tuple[float, float]:
        """Return the amplitudes of the vibration in a window, at most and at the end [counts]."""
        sizes = [
            _amplitude(self.position[max(end - _WINDOW, 0) : end], self.hertz)
            for end in range(self.position.size, _WINDOW, -_WINDOW)
        ]
        return max(sizes, default=0.0), sizes[0] if sizes else 0.0


def link_trials(case: tuple[int, int, float]) -> list[LinkTrial]:
    """Draw servos with a link, and run a wall on each after a kick of 0.1 rad.

    Args:
        case: Seed, number of servos, and virtual damping over the ceiling.
    """
    seed, count, share = case
    random = np.random.default_rng(seed)
    runs = (link_run(random, share, 12.0, 90.0) for _ in range(count))
    return [LinkTrial(share, *run.largest_and_last, run.alarm_s) for run in runs]


def link_run(random: np.random.Generator, share: float, slowest: float, fastest: float) -> LinkRun:
    """Draw a servo with a link and run a wall on it, with the guard off.

    Args:
        random: Draws.
        share: Virtual damping over the ceiling.
        slowest: Frequency of the vibration, at least [Hz].
        fastest: At most [Hz].
    """
    load = INERTIA * random.uniform(0.1, 1.5)
    hertz, ratio = np.exp(random.uniform(np.log([slowest, 0.005]), np.log([fastest, 0.05])))
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
    known = np.isfinite(rows["position"])
    alarm = float(alarmed[0]) * PERIOD if alarmed.size else math.nan
    return LinkRun(
        load,
        float(hertz),
        float(ratio),
        float(delay),
        rows["position"][known],
        rows["torque"][known],
        alarm,
    )


def _amplitude(position: FloatArray, hertz: float) -> float:
    """Return the largest amplitude near a frequency [counts]."""
    time = np.arange(position.size) * PERIOD
    window = np.hanning(position.size)
    swing = (position - position.mean()) * window
    near = hertz * np.linspace(0.8, 1.2, 41)
    found = np.exp(-1j * math.tau * np.outer(near, time)) @ swing
    return float(2.0 * np.abs(found).max() / window.sum() / COUNT)
