"""Watches walls in lanes: turning points, and speeds outside a wall."""

from __future__ import annotations

import math

from haptic_wall.controller.experiments.maps.lane_rows import (
    BEFORE,
    CAME,
    CONTACTS,
    DECAY,
    ENTERED,
    FIXED,
    FLAG,
    FULL,
    GONE,
    INERTIA,
    LANES,
    LEAVING,
    LIMITED,
    LOAD,
    MOTOR,
    OBSERVER,
    OUTPUT,
    OUTSIDE,
    PLAY,
    POSITION,
    SPRING,
    TORQUE,
    TWIST,
    VELOCITY,
)
from haptic_wall.controller.theory.checks import FloatArray, IntArray


def look(w: FloatArray, over: FloatArray) -> None:
    """Record the speeds outside the wall; as ``bounce``."""
    few = 0
    for i in range(LANES):
        position, velocity = w[POSITION * LANES + i], w[VELOCITY * LANES + i]
        before, leaving = w[(FIXED + CAME) * LANES + i], w[(FIXED + LEAVING) * LANES + i]
        inside = position > 0.0
        entered = inside | (w[(FIXED + ENTERED) * LANES + i] != 0.0)
        out = (not inside) & entered
        crossed = out & (before > 0.0)
        few += 1 if crossed else 0
        w[FLAG * LANES + i] = 1.0 if crossed else 0.0
        leaving = -velocity if out & (-velocity > leaving) else leaving
        w[(FIXED + LEAVING) * LANES + i] = 0.0 if inside else leaving
        w[(FIXED + ENTERED) * LANES + i] = 1.0 if entered else 0.0
    for i in range(LANES if few else 0):
        if w[FLAG * LANES + i] != 0.0:
            position, velocity = w[POSITION * LANES + i], w[VELOCITY * LANES + i]
            before, came = w[(FIXED + CAME) * LANES + i], w[(FIXED + BEFORE) * LANES + i]
            decay = w[DECAY * LANES + i]
            push = (came - velocity + decay * (before - position)) / over[3 * LANES + i]
            lost = -decay * position
            square = lost * lost + 4.0 * (
                velocity * velocity + 2.0 * push * position - lost * velocity
            )
            at_wall = 0.5 * (lost + math.sqrt(max(square, 0.0)))
            leaving = w[(FIXED + LEAVING) * LANES + i]
            w[(FIXED + LEAVING) * LANES + i] = at_wall if at_wall > leaving else leaving
    remember(w)


def look_at_loads(w: FloatArray, loads: FloatArray) -> None:
    """Record the speeds of rigid servos with the same energy outside the wall; as ``bounce``."""
    for i in range(LANES):
        twist, motor = loads[TWIST * LANES + i], loads[MOTOR * LANES + i]
        output = loads[OUTPUT * LANES + i]
        inertia, load = w[INERTIA * LANES + i], loads[LOAD * LANES + i]
        energy = inertia * motor * motor + load * output * output
        energy = energy + loads[SPRING * LANES + i] * twist * twist
        speed = math.sqrt(energy / (inertia + load))
        inside = w[POSITION * LANES + i] > 0.0
        entered = inside | (w[(FIXED + ENTERED) * LANES + i] != 0.0)
        leaving = w[(FIXED + LEAVING) * LANES + i]
        leaving = speed if speed > leaving else leaving
        w[(FIXED + LEAVING) * LANES + i] = leaving if entered & (not inside) else 0.0
        w[(FIXED + ENTERED) * LANES + i] = 1.0 if entered else 0.0
    remember(w)


def remember(w: FloatArray) -> None:
    """Keep positions and velocities for the next look."""
    for i in range(LANES):
        w[(FIXED + CAME) * LANES + i] = w[POSITION * LANES + i]
        w[(FIXED + BEFORE) * LANES + i] = w[VELOCITY * LANES + i]


def stay(w: FloatArray) -> None:
    """Count the periods outside the wall."""
    for i in range(LANES):
        outside = w[(FIXED + OUTSIDE) * LANES + i] + 1.0
        inside = (w[(FIXED + ENTERED) * LANES + i] == 0.0) | (w[(FIXED + CAME) * LANES + i] > 0.0)
        w[(FIXED + OUTSIDE) * LANES + i] = 0.0 if inside else outside


def turn(
    w: FloatArray, first: int, lanes: int, k: int, limited: bool, turned: FloatArray, count: int
) -> int:
    """Record turning points; as ``turning``. Return the number of them all."""
    few = 0
    for i in range(LANES):
        few += 1 if w[(FIXED + BEFORE) * LANES + i] * w[VELOCITY * LANES + i] < 0.0 else 0
    for i in range(lanes if few else 0):
        before, velocity = w[(FIXED + BEFORE) * LANES + i], w[VELOCITY * LANES + i]
        if before * velocity < 0.0:
            turned[0, count], turned[1, count], turned[2, count] = first + i, k, before
            turned[3, count], turned[4, count] = velocity, w[(FIXED + CAME) * LANES + i]
            count += 1
    if limited:
        for i in range(LANES):
            acted = abs(w[TORQUE * LANES + i]) >= w[FULL * LANES + i]
            before = w[(FIXED + LIMITED) * LANES + i]
            w[(FIXED + LIMITED) * LANES + i] = 1.0 if acted else before
    for i in range(LANES):
        velocity, before = w[VELOCITY * LANES + i], w[(FIXED + BEFORE) * LANES + i]
        w[(FIXED + BEFORE) * LANES + i] = velocity if velocity != 0.0 else before
        w[(FIXED + CAME) * LANES + i] = w[POSITION * LANES + i]
    return count


def gone(w: FloatArray, traits: IntArray) -> bool:
    """Whether every contact is over, and nothing can change what is known of it."""
    if traits[OBSERVER] != CONTACTS or traits[PLAY]:
        return False
    still = 0
    for i in range(LANES):
        still += 0 if w[(FIXED + OUTSIDE) * LANES + i] > w[GONE * LANES + i] else 1
    return still == 0
