"""Moves rigid bodies in lanes; as ``haptic_wall.hw.plant.bodies``."""

from __future__ import annotations

import math
from typing import Final

from haptic_wall.controller.experiments.maps.lane_rest import through_rest
from haptic_wall.controller.experiments.maps.lane_rows import (
    ACTING,
    COULOMB,
    DECAY,
    FLAG,
    FOLLOWED,
    FRICTION,
    HALF,
    INERTIA,
    LANES,
    POSITION,
    VELOCITY,
)
from haptic_wall.controller.theory.checks import FloatArray

_CLEARLY: Final = 1e-9
"""As ``haptic_wall.hw.plant.bodies``"""


def slide(w: FloatArray, over: FloatArray) -> None:
    """Move bodies without Coulomb friction."""
    for i in range(LANES):
        velocity = w[VELOCITY * LANES + i]
        push = w[ACTING * LANES + i] / w[INERTIA * LANES + i]
        h1, h, s = over[i], over[LANES + i], over[2 * LANES + i]
        w[POSITION * LANES + i] = (w[POSITION * LANES + i] + velocity * h) + push * s
        w[VELOCITY * LANES + i] = velocity * h1 + push * h


def slide_or_stick(w: FloatArray, over: FloatArray) -> int:
    """Move bodies with Coulomb friction; flag those that come to rest, and return their number."""
    few = 0
    for i in range(LANES):
        position, velocity = w[POSITION * LANES + i], w[VELOCITY * LANES + i]
        torque, coulomb = w[ACTING * LANES + i], w[COULOMB * LANES + i]
        h1, h, s = over[i], over[LANES + i], over[2 * LANES + i]
        direction = torque if velocity == 0.0 else velocity
        stuck = (velocity == 0.0) & (abs(torque) <= coulomb)
        push = (torque - math.copysign(coulomb, direction)) / w[INERTIA * LANES + i]
        moved = (position + velocity * h) + push * s
        end = velocity * h1 + push * h
        # Without a spring the velocity is monotone: if it keeps its sign it was never zero.
        kept = (end * direction > 0.0) | (coulomb == 0.0)
        few += 0 if kept | stuck else 1
        w[FLAG * LANES + i] = 0.0 if kept | stuck else 1.0
        w[POSITION * LANES + i] = moved if kept & (not stuck) else position
        w[VELOCITY * LANES + i] = 0.0 if stuck else (end if kept else velocity)
    return few


def slide_turning(w: FloatArray, over: FloatArray) -> int:
    """Move bodies behind backlash; flag those that come to rest, and return their number."""
    few = 0
    for i in range(LANES):
        position, velocity = w[POSITION * LANES + i], w[VELOCITY * LANES + i]
        inertia, friction = w[INERTIA * LANES + i], w[FRICTION * LANES + i]
        h1, h, s = over[i], over[LANES + i], over[2 * LANES + i]
        pull = w[ACTING * LANES + i] / inertia
        moves = (velocity != 0.0) | (abs(pull) > friction)
        direction = math.copysign(1.0, velocity if velocity != 0.0 else pull)
        push = pull - direction * friction
        end = velocity * h1 + push * h
        distance = velocity * h + push * s
        turns = (velocity != 0.0) & ((velocity > 0.0) != (push > 0.0))
        turns = turns & (end * direction <= _CLEARLY * abs(velocity))
        few += 1 if turns else 0
        w[FLAG * LANES + i] = 1.0 if turns else 0.0
        w[POSITION * LANES + i] = position + distance if moves & (not turns) else position
        goes = moves & (end * direction > 0.0)
        w[VELOCITY * LANES + i] = velocity if turns else (end if goes else 0.0)
    return few


def rest(w: FloatArray, over: FloatArray, play: bool) -> None:
    """Move the flagged bodies, one by one."""
    for i in range(LANES):
        if w[FLAG * LANES + i] != 0.0:
            position, velocity, turned, turn = through_rest(
                w[POSITION * LANES + i],
                w[VELOCITY * LANES + i],
                w[ACTING * LANES + i],
                w[INERTIA * LANES + i],
                w[COULOMB * LANES + i],
                w[DECAY * LANES + i],
                over[i],
                over[LANES + i],
                over[2 * LANES + i],
                over[3 * LANES + i],
            )
            w[POSITION * LANES + i], w[VELOCITY * LANES + i] = position, velocity
            if turned & play:
                half, followed = w[HALF * LANES + i], w[FOLLOWED * LANES + i]
                followed = turn - half if turn - half > followed else followed
                w[FOLLOWED * LANES + i] = min(followed, turn + half)


def follow(w: FloatArray) -> None:
    """Move the encoders behind the bodies' backlash."""
    for i in range(LANES):
        position, half = w[POSITION * LANES + i], w[HALF * LANES + i]
        followed = w[FOLLOWED * LANES + i]
        low, high = position - half, position + half
        followed = followed if followed >= low else low
        w[FOLLOWED * LANES + i] = followed if followed <= high else high
