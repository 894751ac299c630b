"""Picks the two-mass servos that stand for a believed link, its loads and its frictions."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np

from haptic_wall.controller.guard.belief import (
    HEAVIEST,
    Belief,
    Bounded,
    lightest_load,
    motor_side,
    vibration,
)
from haptic_wall.controller.guard.link_grid import PHASE, Knot
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.controller.theory.flexible_scan import Servos
from haptic_wall.controller.theory.velocity_filter import VelocityFilter

_SLICES, _LOADS = 3.0, 1.45
"""Largest ratio of 1/motor + 1/load within a slice of a belief about a motor alone, and between two
of its loads: the ceiling may be least between the ends"""
_STOPPED, _STEPS = 3.0, 1.4
"""Frequency below which frequencies follow each other by a ratio, over that at which friction stops
the servo; the ratio"""
_MOTORS = 1.6
"""Largest ratio of two motor inertias of the grid"""
_BESIDE = np.linspace(-2.0, 2.0, 17)
"""Frequencies beside that of a notch, in widths of it"""


def slices(belief: Belief) -> list[Belief]:
    """Return a belief about a motor alone in slices of its load, each with its own frequencies.

    A lighter load vibrates faster on the same transmission. The box of all loads and all
    frequencies would contain light loads on a far softer one, which allow hardly any wall.
    """
    stiffness = belief.transmission_stiffness
    if not belief.bare or not stiffness.high > 0.0:
        return [belief]
    found = []
    for heavy, light in pairwise(_loads(belief, _SLICES)):
        load = Bounded(heavy, light, heavy)
        hz = vibration(belief.inertia, load, stiffness, bare=True)
        found.append(replace(belief, load_inertia=load, flexible_hz=hz))
    return found


def _loads(belief: Belief, most: float) -> list[float]:
    """Return loads beside a motor from greatest to least; ``most``: ratio of 1/motor + 1/load."""
    motor, greatest = 1.0 / belief.inertia.low, belief.load_inertia.high
    least = lightest_load(belief.inertia, belief.load_inertia, belief.bare)
    ends = motor + 1.0 / greatest, motor + 1.0 / least
    count = 1 + math.floor(math.log(ends[1] / ends[0]) / math.log(most))
    between: list[float] = (1.0 / (np.geomspace(*ends, count + 1)[1:-1] - motor)).tolist()
    return [greatest, *between, least]


def servos_at(
    belief: Belief, period: float, knot: Knot, velocity_filter: VelocityFilter | None
) -> Servos:
    """Return the servos that stand for the belief at a delay."""
    phase = math.tau * (knot.high - knot.low) * (knot.delay + period)
    count = 2 + math.ceil(phase / PHASE) if phase > 0.0 else 1
    rates = np.linspace(knot.low, knot.high, count)
    # beside the rate at which friction stops it the frequency counts by itself, not by its phase
    slow = min(knot.high, _STOPPED * belief.damping.high / (math.tau * belief.inertia.low))
    if 0.0 < knot.low < slow:
        more = math.ceil(math.log(slow / knot.low) / math.log(_STEPS))
        rates = np.unique([*rates, *np.geomspace(knot.low, slow, more + 1)])
    if velocity_filter is not None and velocity_filter.kind == "notch":
        middle = velocity_filter.w0 / (math.tau * period)
        near = middle * (1.0 + _BESIDE / velocity_filter.q)
        rates = np.unique([*rates, *near[(near > knot.low) & (near < knot.high)]])
    ratios = np.unique([belief.flexible_damping_ratio.low, belief.flexible_damping_ratio.high])
    wholes, loads = _bodies(belief)
    every = np.meshgrid(ratios, math.tau * rates, np.arange(wholes.size), indexing="ij")
    ratio, rate, body = (each.ravel() for each in every)
    whole, load = wholes[body], loads[body]
    stiffness = belief.transmission_stiffness
    if belief.bare and stiffness.high > 0.0:
        # each body from its own slowest vibration on, over as many cycles of the phase
        slowest = np.sqrt(stiffness.low * whole / (load * (whole - load)))
        rate += slowest * knot.low / belief.flexible_hz.low - math.tau * knot.low
        rate = np.minimum(rate, slowest * math.sqrt(stiffness.high / stiffness.low))
    friction = np.unique([belief.damping.low, belief.damping.high])
    motor = whole - load
    moving = motor * load / whole
    return Servos(
        motor,
        np.tile(friction[:, None], whole.size),
        load,
        moving * rate**2,
        2.0 * ratio * moving * rate,
        knot.delay,
    )


def _bodies(belief: Belief) -> tuple[FloatArray, FloatArray]:
    """Return whole inertias and loads that stand for the belief [kg·m²].

    With a heavier motor the transmission takes up more, ``2 zeta rate`` times the whole, but
    friction less, ``b load / motor``: the ceiling, and the limit at a damping, may be least between
    the ends.
    """
    inertia, most = belief.inertia, belief.load_inertia.high
    found = []
    ends = {lightest_load(inertia, belief.load_inertia, belief.bare), most}
    for load in _loads(belief, _LOADS) if belief.bare else ends:
        light, heavy = inertia.low, inertia.high
        if not belief.bare:
            light, heavy = motor_side(light, load), motor_side(heavy, load)
        steps = math.ceil(math.log(heavy / light) / math.log(_MOTORS))
        motor = np.geomspace(light, heavy, steps + 1)
        whole = motor + load
        if not belief.bare:
            whole = np.minimum(whole, motor / (1.0 - HEAVIEST))
        found.append((whole, whole - motor))
    whole, load = np.concatenate(found, axis=1)
    return whole, load
