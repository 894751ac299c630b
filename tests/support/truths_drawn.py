"""Draws true servos from a preset's whole belief, and beyond: lag, back-EMF, backlash."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from haptic_wall.controller.guard.belief import Belief, Bounded
from haptic_wall.controller.settings.load import load_config
from haptic_wall.controller.theory import critical_stiffness, max_virtual_damping
from tests.support.real_servos import (
    BACKWARD,
    BANDWIDTH,
    COGGING,
    DEAD_BAND,
    DROOP,
    ECCENTRICITY,
    LOAD,
    LOOP_PERIOD,
    NOISE,
    PERIODS,
    STATIC,
    STRIBECK,
)
from tests.support.truth import BackEmf, Truth

LAG_FACTOR = 4.0
"""Largest lag, as a multiple of its believed upper bound [1]"""
MOST_BACKLASH = math.radians(0.5)
MODE_HZ, MODE_DAMPING, MODE_LOAD = (10.0, 60.0), (0.01, 0.05), (0.1, 0.7)
"""Ranges for a flexible transmission: frequency with both ends free [Hz], damping ratio, load's
fraction of the inertia"""
_ARC_MINUTES = math.radians(0.25)
"""Backlash of servos of the X series [rad]. Source: e-manual, tables of the XM540 and XH430"""
_CORNERS = 0.5
"""Probability of a corner of the belief."""
_MOTORS = {"xm430-w350": (46.0, 0.00269 * 4.1 / 2.3), "xl330-m288": (103.0, 0.0)}
"""Speed without a load [rpm], and torque of a unit of current [N·m]; the XL330's units are those of
its supply's current, fine beside its friction, and left out. Source: ROBOTIS e-Manual"""


@dataclass(frozen=True, slots=True)
class Bench:
    """A servo's preset, with the values that trials need."""

    name: str
    belief: Belief
    torque_limit: float
    """[N·m]"""
    stall_torque: float
    """[N·m]"""
    no_load_speed: float
    """[rad/s]"""
    torque_step: float
    """[N·m]; 0: none"""
    sets: tuple[str, ...]
    """The belief as changes of a configuration"""


@lru_cache
def bench_of(preset: str) -> Bench:
    """Return the bench of ``xm430-w350`` or ``xl330-m288``.

    Raises:
        ValueError: The preset's motor is unknown.
    """
    if preset not in _MOTORS:
        raise ValueError(f"preset {preset!r} is no bench; give one of {', '.join(_MOTORS)}")
    config = load_config(preset).config
    limit = config.servo.torque_limit
    rpm, step = _MOTORS[preset]
    assert limit is not None
    belief = config.belief()
    sets = [f"servo.torque_limit={limit!r}", f"servo.inertia={belief.inertia.value!r}"]
    for name in ("inertia", "damping", "coulomb", "delay", "torque_gain"):
        bounds: Bounded = getattr(belief, name)
        sets.append(
            f"model.{name}={{value: {bounds.value!r}, low: {bounds.low!r}, high: {bounds.high!r}}}"
        )
    return Bench(
        name=preset,
        belief=belief,
        torque_limit=limit,
        stall_torque=limit,
        no_load_speed=rpm * math.tau / 60.0,
        torque_step=step,
        sets=tuple(sets),
    )


def draw_real(
    bench: Bench, random: np.random.Generator, lags: tuple[float, float] = (0.0, 1.0)
) -> Truth:
    """Draw a servo from the whole belief that has every effect of a real one.

    Args:
        bench: Bench with the belief; also of the backlash, 15 arcmin where it has none.
        random: Draws.
        lags: Range of the lag, as multiples of its believed upper bound; half of them are at its
            upper end.
    """
    truth = draw_truth(bench, random, back_emf="current")
    delay = draw_lag(bench, lags, random)
    periods = random.integers(*PERIODS, 2, endpoint=True).astype(np.float64).tolist()
    phases = random.uniform(-math.pi, math.pi, 4).tolist()
    real: dict[str, int | float] = {
        "static_friction": truth.coulomb * random.uniform(*STATIC),
        "stribeck_speed": random.uniform(*STRIBECK),
        "damping_back": truth.damping * _within(BACKWARD, random),
        "load_friction": random.uniform(*LOAD),
        "gravity": truth.coulomb * random.uniform(0.0, 0.8),
        "gravity_angle": phases[0],
        "cogging": truth.coulomb * random.uniform(0.0, COGGING),
        "cogging_periods": periods[0],
        "cogging_phase": phases[1],
        "encoder_eccentricity": random.uniform(0.0, ECCENTRICITY),
        "encoder_phase": phases[3],
        "encoder_noise": random.uniform(0.0, NOISE),
        "noise_seed": int(random.integers(1 << 31)),
        "current_bandwidth": _within(BANDWIDTH, random),
        "current_period": random.uniform(0.0, LOOP_PERIOD),
        "current_droop": random.uniform(0.0, DROOP),
        "dead_band": bench.torque_limit * random.uniform(0.0, DEAD_BAND),
    }
    backlash = random.uniform(0.0, bench.belief.backlash.high or _ARC_MINUTES)
    return replace(truth, delay=delay, backlash=backlash, real=real)


def draw_lag(bench: Bench, lags: tuple[float, float], random: np.random.Generator) -> float:
    """Draw a lag [s] from a range, in multiples of its believed upper bound; half at its end."""
    most = bench.belief.delay.high
    low, high = max(bench.belief.delay.low, lags[0] * most), lags[1] * most
    return high if random.random() < 0.5 else float(random.uniform(low, high))


def draw_truth(
    bench: Bench,
    random: np.random.Generator,
    *,
    lag_factor: float = LAG_FACTOR,
    back_emf: BackEmf | None = None,
    backlash: bool | None = False,
    flexible: bool | None = False,
) -> Truth:
    """Draw a servo from the whole belief.

    With probability 1/2 it is a corner; otherwise every quantity is log-uniform, the lag uniform.

    Args:
        bench: Bench with the belief.
        random: Draws.
        lag_factor: Largest lag, as a multiple of its believed upper bound.
        back_emf: None: drawn.
        backlash: None: drawn.
        flexible: Two masses; None: drawn.
    """
    belief = bench.belief
    corner = bool(random.random() < _CORNERS)
    kinds: tuple[BackEmf, ...] = ("none", "current", "voltage")
    drawn = kinds[int(random.integers(3))] if back_emf is None else back_emf
    lag = (belief.delay.low, belief.delay.high, lag_factor * belief.delay.high)
    gain = _between(belief.torque_gain, random, corner=corner)
    truth = Truth(
        inertia=_between(belief.inertia, random, corner=corner),
        damping=_between(belief.damping, random, corner=corner),
        coulomb=_between(belief.coulomb, random, corner=corner),
        torque_gain=gain,
        delay=lag[int(random.integers(3))] if corner else random.uniform(lag[0], lag[2]),
        torque_limit=bench.torque_limit,
        torque_step=bench.torque_step,
        back_emf=drawn,
        stall_torque=gain * bench.stall_torque,
        no_load_speed=bench.no_load_speed,
    )
    if random.random() < 0.5 if backlash is None else backlash:
        width = MOST_BACKLASH if corner else random.uniform(0.0, MOST_BACKLASH)
        truth = replace(truth, backlash=width)
    if random.random() < 0.5 if flexible is None else flexible:
        truth = truth.with_mode(
            _within(MODE_HZ, random), _within(MODE_DAMPING, random), random.uniform(*MODE_LOAD)
        )
        truth = replace(truth, encoder="motor" if random.random() < 0.25 else "output")
    return truth


def critical_of(truth: Truth, damping: float) -> float:
    """Return the commanded critical stiffness of a two-sided wall at 1 kHz [N·m/rad].

    It is that of the rigid servo without Coulomb friction, backlash, limit and back-EMF.

    Args:
        truth: The servo.
        damping: Commanded B [N·m·s/rad].
    """
    gain = truth.torque_gain
    limit = critical_stiffness(truth.inertia, truth.damping, gain * damping, 1e-3, truth.delay)
    return float(limit) / gain


def damping_ceiling_of(truth: Truth) -> float:
    """Return the commanded B above which no stiffness is stable at 1 kHz, rigid [N·m·s/rad]."""
    ceiling = max_virtual_damping(truth.inertia, truth.damping, 1e-3, truth.delay)
    return float(ceiling) / truth.torque_gain


def natural_hz(truth: Truth, stiffness: float) -> float:
    """Return the frequency of the commanded stiffness with this servo's inertia [Hz]."""
    return math.sqrt(truth.torque_gain * stiffness / truth.inertia) / math.tau


def _between(bounds: Bounded, random: np.random.Generator, *, corner: bool) -> float:
    if corner:
        return bounds.high if random.random() < 0.5 else bounds.low
    return _within((bounds.low, bounds.high), random)


def _within(bounds: tuple[float, float], random: np.random.Generator) -> float:
    """Draw log-uniformly; uniformly where the lower bound is 0."""
    low, high = bounds
    if low <= 0.0:
        return float(random.uniform(low, high))
    return log_uniform(bounds, random)


def log_uniform(ends: tuple[float, float], random: np.random.Generator) -> float:
    """Draw log-uniformly; both ends > 0."""
    low, high = ends
    return float(math.exp(random.uniform(math.log(low), math.log(high))))
