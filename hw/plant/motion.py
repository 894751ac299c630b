"""Computes the motion of a damped oscillator, and its time until rest.

Everything is per unit inertia: ``h'' + decay h' + spring h = 0`` with ``h(0) = 0, h'(0) = 1``.
A body that starts with velocity v, pushed by ``push + ramp t``, then has ::

    velocity(t) = v h' + push h + ramp s          s = integral of h
    position(t) = x + v h + push s + ramp r       r = integral of s

where push is the acceleration that the body would have at rest at x. The functions are plain, so
that Numba compiles them as they are.
"""

from __future__ import annotations

import math

Four = tuple[float, float, float, float]


def response(decay: float, spring: float, time: float) -> Four:
    """Return h', h, s and r after ``time`` [s], exact to rounding in every regime.

    Args:
        decay: Damping over inertia [1/s], >= 0.
        spring: Stiffness over inertia [1/s²], >= 0.
        time: [s], >= 0.
    """
    doublings = 0
    while decay * time > 1.0 or spring * time * time > 1.0:
        time *= 0.5
        doublings += 1
    h1, h, s, r = _series(decay, spring, time)
    for _ in range(doublings):  # the same motion goes on from where each of the four has ended
        h1, h, s, r = (
            h1 * h1 - spring * h * h,
            h + h1 * h - spring * h * s,
            s + h * h + (1.0 - spring * s) * s,
            r + s * h + (time - spring * r) * s + r,
        )
        time *= 2.0
    return h1, h, s, r


def _series(decay: float, spring: float, time: float) -> Four:
    """Sum the Taylor series until its terms vanish: exact for short times."""
    a = decay * time
    c = spring * time * time
    before, term = 0.0, 1.0
    h, s, r = 1.0, 0.5, 1.0 / 6.0
    n = 1
    while abs(term) + abs(before) > 1e-19:
        n += 1
        before, term = term, -(a * term + c * before / (n - 1)) / n
        h += term
        s += term / (n + 1)
        r += term / ((n + 1) * (n + 2))
    s *= time * time
    h *= time
    return 1.0 - decay * h - spring * s, h, s, r * time * time * time


def time_to_rest(
    velocity: float, push: float, ramp: float, decay: float, spring: float, limit: float
) -> float:
    """Return the time [s] at which the velocity first reaches zero; inf if not before ``limit``.

    For a body that starts at rest, time 0 does not count.
    """
    if spring == 0.0:
        # Signs, not a product: that would underflow, and a body almost at rest would never stop.
        if velocity == 0.0 or push == 0.0 or (velocity > 0.0) == (push > 0.0):
            return math.inf
        coasting = -velocity / push
        y = decay * coasting
        time = coasting * (math.log1p(y) / y if y > 1e-12 else 1.0)
        return time if time < limit else math.inf
    first = velocity
    if first == 0.0:
        first = push if push != 0.0 else ramp
    direction = math.copysign(1.0, first)
    # Between two zeros of the acceleration the velocity is monotone, so its sign at the end
    # decides.
    turn, spacing = _acceleration_zeros(velocity, push, ramp, decay, spring)
    start = 0.0
    while start < limit:
        end = turn if turn < limit else limit
        if end > start:
            h1, h, s, _ = response(decay, spring, end)
            if direction * (velocity * h1 + push * h + ramp * s) < 0.0:
                return _root(velocity, push, ramp, decay, spring, start, end)
            start = end
        turn += spacing
    return math.inf


def _acceleration_zeros(
    velocity: float, push: float, ramp: float, decay: float, spring: float
) -> tuple[float, float]:
    """Return the first instant with zero acceleration and the time between two of them [s].

    The acceleration is ``a h' + j h`` with a and j its value and its derivative at the start.
    """
    acceleration = push - decay * velocity
    half = 0.5 * decay
    slope = half * acceleration - (ramp - spring * velocity)
    discriminant = half * half - spring
    if discriminant < 0.0:
        frequency = math.sqrt(-discriminant)
        turn = (math.atan2(acceleration * frequency, slope) % math.pi) / frequency
        return turn, math.pi / frequency
    if acceleration != 0.0 and slope != 0.0 and (acceleration > 0.0) == (slope > 0.0):
        ratio = acceleration / slope
        y = math.sqrt(discriminant) * ratio
        if y < 1.0:
            return ratio * (math.atanh(y) / y if y > 1e-9 else 1.0), math.inf
    return math.inf, math.inf


def _root(
    velocity: float, push: float, ramp: float, decay: float, spring: float, low: float, high: float
) -> float:
    """Find the velocity's zero in a monotone bracket: Newton's method, kept inside by halving."""
    acceleration = push - decay * velocity
    jerk = ramp - spring * velocity
    h1, h, s, _ = response(decay, spring, high)
    sign_high = math.copysign(1.0, velocity * h1 + push * h + ramp * s)
    # A slow body stops almost at once: begin with the tangent at the start.
    time = -velocity / acceleration if low == 0.0 and acceleration != 0.0 else high
    if not low < time < high:
        time = 0.5 * (low + high)
    for _ in range(200):
        h1, h, s, _ = response(decay, spring, time)
        speed = velocity * h1 + push * h + ramp * s
        if speed * sign_high > 0.0:
            high = time
        else:
            low = time
        change = acceleration * h1 + jerk * h
        correction = speed / change if change != 0.0 else math.inf
        if min(abs(correction), high - low) <= 1e-15 * time:
            break
        time -= correction
        if not low < time < high:
            time = 0.5 * (low + high)
    return time
