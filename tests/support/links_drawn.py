"""Draws walls at the ceiling of a link's vibration, and walls that passivity control must hold."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from haptic_wall.controller.theory import critical_stiffness, max_virtual_damping
from haptic_wall.controller.theory.boundary import chain_boundary, chain_ceiling, chain_peak
from haptic_wall.controller.theory.chain import one_mass, two_masses
from haptic_wall.controller.theory.servos import SERVOS
from tests.support.cases_drawn import PRESETS
from tests.support.real_servos import BANDWIDTH
from tests.support.trial import Case, WallAsked
from tests.support.truth import COUNT, Truth
from tests.support.truths_drawn import bench_of, draw_truth, log_uniform

SHARES = (0.9, 1.2, 2.0)
"""B over the exact ceiling of a link"""
PERIOD = 1e-3
_STIFFNESS = {"xm430-w350": (50.0, 400.0), "xl330-m288": (5.0, 80.0)}
"""Of gear and horn [N·m/rad]: the presets' belief"""


def draw_linked(preset: str, random: np.random.Generator, *, friction: bool) -> Truth:
    """Draw a servo within the belief with a link whose vibration a late damper feeds.

    Args:
        preset: Of the servo.
        random: Draws.
        friction: It has Coulomb friction.
    """
    while True:
        truth = draw_truth(bench_of(preset), random, lag_factor=1.0, back_emf="none")
        load = log_uniform((0.025, 1.5), random)
        share = load / (1.0 + load)
        rate = math.sqrt(
            log_uniform(_STIFFNESS[preset], random) / ((1.0 - share) * share * truth.inertia)
        )
        truth = truth.with_mode(rate / math.tau, log_uniform((0.01, 0.05), random), share)
        bandwidth = log_uniform(BANDWIDTH, random)
        lag = max(truth.delay, 1.0 / (math.tau * bandwidth))
        if rate * (lag + PERIOD) < 0.45 * math.pi:  # the damper feeds it up to a right angle
            return replace(
                truth,
                delay=lag - 1.0 / (math.tau * bandwidth),
                current_bandwidth=bandwidth,
                coulomb=truth.coulomb if friction else 0.0,
            )


def ceiling_of(truth: Truth) -> float:
    """Return the commanded B above which no soft wall is stable on two masses [N·m·s/rad]."""
    bandwidth = truth.current_bandwidth or None
    ceiling = chain_ceiling(*two_masses(*_masses(truth), bandwidth=bandwidth), PERIOD, truth.delay)
    return float(ceiling) / truth.torque_gain


def limit_of(truth: Truth, damping: float) -> float:
    """Return the commanded K below which a wall is stable on two masses [N·m/rad].

    Args:
        truth: The servo.
        damping: Commanded B [N·m·s/rad].
    """
    gain, bandwidth = truth.torque_gain, truth.current_bandwidth or None
    found = chain_boundary(
        *two_masses(*_masses(truth), bandwidth=bandwidth), gain * damping, PERIOD, truth.delay
    )
    return float(found.stiffness) / gain


def _masses(truth: Truth) -> tuple[float, float, float, float, float]:
    motor, load = truth.inertia - truth.load_inertia, truth.load_inertia
    return motor, truth.damping, load, truth.transmission_stiffness, truth.transmission_damping


def draw_link(random: np.random.Generator, preset: str, share: float) -> Case:
    """Draw a servo with a link, half of them without friction, and a wall with B over its ceiling.

    Half of the walls have K = 0, half of them half of the limit's stiffness. A quarter starts with
    the encoder's rounding alone; at the others the link is struck.
    """
    truth = draw_linked(preset, random, friction=random.random() < 0.5)
    kick, struck = log_uniform((0.02, 0.3), random), log_uniform((0.5, 5.0), random)
    sprung, kicked = random.random() < 0.5, random.random() >= 0.25
    between = float(random.random()) * COUNT
    ceiling = ceiling_of(truth)
    stiffness = 0.5 * limit_of(truth, 0.9 * ceiling) if sprung else 0.0
    case = Case(preset, truth, WallAsked(stiffness, share * ceiling), position=between)
    if kicked:
        return replace(case, position=kick if stiffness > 0.0 else between, struck=struck)
    return case if stiffness > 0.0 else replace(case, velocity=0.02)


_PLANTS = {name: (one.inertia, one.damping, one.coulomb) for name, one in SERVOS.items()}
_PLANTS["Table II"] = (1.0, 0.1, 0.0)
PLANTS = tuple(_PLANTS)
_QUANTISATION = 0.1
"""Largest fraction of the torque limit that a count may command"""


def draw_controlled(random: np.random.Generator, plant: str) -> Case:
    """Draw a wall above its limit, below 0.9 of what damping makes stable, and a wrong belief.

    Delays of 0 to 10 ms; the belief is wrong by up to a fifth in each value.
    """
    m, b, c = _PLANTS[plant]
    limit = 40.0 * c if c else 100.0
    while True:
        delay = float(random.uniform(0.0, 0.010))
        counted = _QUANTISATION * limit * PERIOD / COUNT
        ceiling = float(max_virtual_damping(m, b, PERIOD, delay))
        most = min(0.5 * ceiling, counted)
        damping = float(random.uniform(0.0, most)) if random.random() < 0.8 else 0.0
        kick = log_uniform((10 * COUNT, 0.3), random)
        wrong = random.uniform(0.8, 1.2, 4).tolist()
        least = float(critical_stiffness(m, b, damping, PERIOD, delay))
        top = chain_peak(one_mass(m, b)[0], PERIOD, delay)
        stable = min(top.virtual_damping.item(), max(counted, damping))
        allowed = min(top.stiffness.item(), float(critical_stiffness(m, b, stable, PERIOD, delay)))
        low, high = 1.2 * least, 0.9 * allowed
        if not 0.0 < low < high:
            continue
        stiffness = log_uniform((low, high), random)
        if (room := 0.5 * limit / stiffness) >= 10 * COUNT:
            break
    believed = [value * factor for value, factor in zip((m, b, c, delay), wrong, strict=True)]
    names = ("inertia", "damping", "coulomb", "delay")
    return Case(
        PRESETS[0],
        Truth(m, b, c, delay=delay, torque_limit=limit),
        WallAsked(stiffness, damping),
        position=min(kick, room),
        law=(
            f"servo.torque_limit={limit!r}",
            *(f"model.{name}={value!r}" for name, value in zip(names, believed, strict=True)),
            "model.torque_gain=1.0",
            f"guard.quantisation_share={_QUANTISATION}",
            "guard.mode=off",
            "wall.passivity_control=true",
        ),
    )
