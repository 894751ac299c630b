"""Moves one body that comes to rest within a step; as ``haptic_wall.hw.plant.bodies``."""

from __future__ import annotations

import math
from typing import Final

_NOTHING: Final = 1e-17
"""Terms of the series up to this do not change its sums, which are above 0.3"""
_CLEARLY: Final = 1e-9
"""As ``haptic_wall.hw.plant.bodies``"""


def long_response(decay: float, time: float) -> tuple[float, float]:
    """Return h and s of ``haptic_wall.hw.plant.response.response`` for ``decay * time`` above 1."""
    half = 0.5 * decay
    root = math.sqrt(half * half)
    fast, gap = half + root, 2.0 * root
    y = fast * time
    once = -math.expm1(-y) / fast
    return (1.0 - math.exp(-y)) / gap, (time - once) / gap


def responses(decay: float, first: float, second: float) -> tuple[float, float, float, float]:
    """Return h and s after two times [s], without a spring; both series at once are quicker."""
    a, b = decay * first, decay * second
    x, y = 1.0, 1.0
    h, s, h2, s2, n = 1.0, 0.5, 1.0, 0.5, 1
    if a <= 1.0 and b <= 1.0:
        while abs(x) + abs(y) > _NOTHING:
            n += 1
            x, y = -(a * x) / n, -(b * y) / n
            h += x
            s += x / (n + 1)
            h2 += y
            s2 += y / (n + 1)
        return h * first, s * (first * first), h2 * second, s2 * (second * second)
    h, s = response(decay, first)
    h2, s2 = response(decay, second)
    return h, s, h2, s2


def response(decay: float, time: float) -> tuple[float, float]:
    """Return h and s after a time [s], without a spring."""
    a = decay * time
    if a > 1.0:
        return long_response(decay, time)
    x, h, s, n = 1.0, 1.0, 0.5, 1
    while abs(x) > _NOTHING:
        n += 1
        x = -(a * x) / n
        h += x
        s += x / (n + 1)
    return h * time, s * (time * time)


def through_rest(
    position: float,
    velocity: float,
    torque: float,
    inertia: float,
    coulomb: float,
    decay: float,
    h1: float,
    h: float,
    s: float,
    duration: float,
) -> tuple[float, float, bool, float]:
    """Take the general step of ``haptic_wall.hw.plant.bodies``: slide to rest, stay or slide on.

    Returns:
        Position [rad], velocity [rad/s], whether it came to rest on the way, and where [rad].
    """
    pull, friction = torque / inertia, coulomb / inertia
    moves = velocity != 0.0 or abs(pull) > friction
    direction = math.copysign(1.0, velocity if velocity != 0.0 else pull)
    push = pull - direction * friction
    end = velocity * h1 + push * h
    distance = velocity * h + push * s
    after = position + distance if moves else position
    # Rounding may put the end on the other side of zero: it is zero.
    speed = end if moves and end * direction > 0.0 else 0.0
    if velocity == 0.0 or push == 0.0 or (velocity > 0.0) == (push > 0.0):
        return after, speed, False, 0.0
    if not end * direction <= _CLEARLY * abs(velocity):
        return after, speed, False, 0.0
    coasting = -velocity / push
    y = decay * coasting
    rest = coasting * (math.log1p(y) / y if y > 1e-12 else 1.0)
    if not rest < duration:
        return after, speed, False, 0.0
    h, s, h_after, s_after = responses(decay, rest, duration - rest)
    turn = position + (velocity * h + push * s)
    direction = math.copysign(1.0, pull)
    push = pull - direction * friction
    if not abs(pull) > friction:
        return turn, 0.0, True, turn
    end = push * h_after
    return turn + push * s_after, end if end * direction > 0.0 else 0.0, True, turn
