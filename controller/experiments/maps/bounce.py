"""Computes from single contacts whether a one-sided wall returns a servo faster than it came.

``theory.contact`` does the same for servos without friction, encoder, backlash and torque limit.
That module is separate because it is exact and dimensionless. Tests compare each of the two with
the other. The functions are plain: see ``loop``.
"""

from __future__ import annotations

import math
from typing import Final

from haptic_wall.controller.experiments.maps.loop import (
    POSITION,
    VELOCITY,
    Wall,
    act,
    begin,
    command,
    keep,
)
from haptic_wall.hw.plant.motion import response
from haptic_wall.hw.plant.two_masses import Buffer

_PHASES: Final = (17, 9, 9)
"""Numbers of tried instants of entry: over the whole period, then twice around the worst one"""
_JUST: Final = 1e-9
"""Distance between the last tried entry and the end of the period [periods]"""
_HOPELESS: Final = -0.1
"""A wall that returns less at all of the first instants does not return more at one between them"""
_CONTACTS: Final = 6.0
"""Longest simulated contact, in half oscillations of the undamped spring; a servo that then still
creeps out has exit speed 0"""


def returned(wall: Wall, s: Buffer, z: Buffer, stiffness: float, kick: float) -> float:
    """Return log(exit speed / entry speed) at the worst phase; above 0 the servo returns faster.

    The servo moves freely and enters with the speed that the spring alone would stop within
    ``kick``. It starts outside, early enough for the velocity estimate. The exit speed is the
    greatest one outside, until the last commanded torque has ended. With a load it includes the
    vibration: it is that of a rigid servo of the same energy.

    Args:
        wall: A one-sided wall.
        s: The simulation's buffer.
        z: The state of ``two_masses``.
        stiffness: K > 0 [N·m/rad].
        kick: Penetration at which the undamped spring would stop the servo, > 0 [rad]; it must not
            saturate the torque.

    Returns:
        The greatest value over the instants of entry between two samples; among the first instants
        where that says enough. -1 if every exit speed is 0.
    """
    speed = kick * math.sqrt(stiffness / wall.moved)
    middle, reach, worst = 0.5, 0.5, -math.inf
    for points in _PHASES:
        best = middle
        for i in range(points):
            phase = middle + reach * (2.0 * i / (points - 1) - 1.0)
            phase = min(max(phase, _JUST), 1.0 - _JUST)
            leaving = contact(wall, s, z, stiffness, speed, phase)
            found = math.log(leaving / speed) if leaving > 0.0 else -1.0
            if found > worst:
                worst, best = found, phase
            if worst > 0.0:
                break
        if worst > 0.0 or worst < _HOPELESS:
            break
        middle = best
        reach *= 2.0 / (points - 1)
    return worst


def contact(
    wall: Wall, s: Buffer, z: Buffer, stiffness: float, speed: float, phase: float
) -> float:
    """Return the exit speed after an entry with this speed [rad/s], at this phase of a period."""
    lead = wall.samples + 1.0 + phase
    period, lag, m = wall.period, wall.lag, wall.moved
    decay, braked = wall.body.forth / m, wall.body.coulomb / m
    h1, h, back, _ = response(decay, 0.0, -lead * period)
    begin(wall, s, z, stiffness, h * speed - back * braked, h1 * speed - h * braked)
    late, held = keep(wall, lag), keep(wall, period - lag)
    half = math.pi * math.sqrt(m / stiffness) / period
    length = _CONTACTS * (half + wall.whole) + lead
    entered, leaving, outside, k = False, 0.0, 0, 0
    while k < length and outside <= wall.whole + 2:
        command(wall, s, k)
        if lag > 0.0:
            before, came = s[POSITION], s[VELOCITY]
            act(wall, s, z, late, k, wall.whole + 1, 0.0, lag)
            entered = entered or s[POSITION] > 0.0
            if entered:
                leaving = _look(wall, s, z, leaving, before, came, lag)
        before, came = s[POSITION], s[VELOCITY]
        act(wall, s, z, held, k, wall.whole, 0.0, period - lag)
        entered = entered or s[POSITION] > 0.0
        k += 1
        if entered:
            leaving = _look(wall, s, z, leaving, before, came, period - lag)
            outside = outside + 1 if s[POSITION] <= 0.0 else 0
    return leaving


def _look(
    wall: Wall,
    s: Buffer,
    z: Buffer,
    leaving: float,
    before: float,
    came: float,
    since: float,
) -> float:
    """Return the greatest outward speed since the wall was left, once it was entered; 0 inside.

    Args:
        wall: The wall.
        s: The simulation's buffer.
        z: The state of ``two_masses``.
        leaving: The greatest speed at the last look [rad/s].
        before: Position at the last look [rad].
        came: Velocity at the last look [rad/s].
        since: Time since then, under one held torque [s].
    """
    x, v = s[POSITION], s[VELOCITY]
    if x > 0.0:
        return 0.0
    body = wall.body
    if body.behind > 0.0:
        energy = body.inertia * z[0] * z[0]
        energy += body.behind * z[2] * z[2]
        energy += body.joint * z[1] * z[1]
        return max(leaving, math.sqrt(energy / wall.moved))
    leaving = max(leaving, -v)
    if before > 0.0:
        # In the step in which it left it may have been faster than at the end. The push outwards
        # follows from momentum, the speed at the wall from energy, with friction at the mean of the
        # speeds at both ends.
        decay = body.forth / body.inertia
        push = (came - v + decay * (before - x)) / since
        lost = -decay * x
        square = lost * lost + 4.0 * (v * v + 2.0 * push * x - lost * v)
        leaving = max(leaving, 0.5 * (lost + math.sqrt(max(square, 0.0))))
    return leaving
