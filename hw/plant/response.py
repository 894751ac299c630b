"""Computes a damped oscillator's response and its time until rest, in closed form.

Everything is per unit inertia: ``h'' + decay h' + spring h = 0`` with ``h(0) = 0, h'(0) = 1``.
A body that starts with velocity v, pushed by ``push + ramp t``, then has ::

    velocity(t) = v h' + push h + ramp s          s = integral of h
    position(t) = x + v h + push s + ramp r       r = integral of s

where push is the acceleration that the body would have at rest at x.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple


class Response(NamedTuple):
    """The response to a unit impulse, its derivative and its first two integrals."""

    h1: float
    """Derivative of the impulse response [1]"""
    h: float
    """Impulse response [s]"""
    s: float
    """Integral of h: response to a unit step [s²]"""
    r: float
    """Integral of s: response to a unit ramp [s³]"""


def response(decay: float, spring: float, time: float) -> Response:
    """Return the response after ``time`` [s], exact to rounding in every regime.

    Args:
        decay: Damping over inertia [1/s], >= 0.
        spring: Stiffness over inertia [1/s²], >= 0.
        time: [s], >= 0.
    """
    if decay * time <= 1.0 and spring * time * time <= 1.0:
        return _series(decay, spring, time)
    half = 0.5 * decay
    discriminant = half * half - spring
    if discriminant > 0.25 * half * half:
        return _two_rates(half, discriminant, spring, time)
    # Near critical damping, or below it: the two rates would cancel, but the spring is large enough
    # to divide by.
    if discriminant < 0.0:
        frequency = math.sqrt(-discriminant)
        envelope = math.exp(-half * time)
        h = envelope * math.sin(frequency * time) / frequency
        cosine = envelope * math.cos(frequency * time)
    elif discriminant > 0.0:
        rate = math.sqrt(discriminant)
        slow = math.exp(-(half - rate) * time)
        h = slow * -math.expm1(-2.0 * rate * time) / (2.0 * rate)
        cosine = 0.5 * (slow + math.exp(-(half + rate) * time))
    else:
        cosine = math.exp(-half * time)
        h = time * cosine
    h1 = cosine - half * h
    s = (1.0 - h1 - decay * h) / spring
    return Response(h1, h, s, (time - h - decay * s) / spring)


cached_response = lru_cache(maxsize=1024)(response)
"""``response``, cached for step lengths that repeat."""


def _series(decay: float, spring: float, time: float) -> Response:
    """Sum the Taylor series until its terms vanish; closed forms cancel for short times."""
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
    return Response(1.0 - decay * h - spring * s, h, s, r * time**3)


def _two_rates(half: float, discriminant: float, spring: float, time: float) -> Response:
    """Return the response if it is clearly overdamped: a sum of two exponentials."""
    root = math.sqrt(discriminant)
    fast, gap = half + root, 2.0 * root
    slow = spring / fast
    fast_end, slow_end = math.exp(-fast * time), math.exp(-slow * time)
    fast_s, fast_r = _integrals(fast, time)
    slow_s, slow_r = _integrals(slow, time)
    return Response(
        (fast * fast_end - slow * slow_end) / gap,
        (slow_end - fast_end) / gap,
        (slow_s - fast_s) / gap,
        (slow_r - fast_r) / gap,
    )


def _integrals(rate: float, time: float) -> tuple[float, float]:
    """Return the first and second integral of exp(-rate t) [s, s²]."""
    y = rate * time
    if y < 0.5:
        once, twice, term, n = 0.0, 0.0, 1.0, 0
        while abs(term) > 1e-19:
            n += 1
            once += term / n
            twice += term / (n * (n + 1))
            term *= -y / n
        return once * time, twice * time * time
    once = -math.expm1(-y) / rate
    return once, (time - once) / rate


class Slide(NamedTuple):
    """Initial velocity and acting torques of a motion, per unit inertia."""

    velocity: float
    """Velocity at the start [rad/s]"""
    push: float
    """Acceleration that the body would have at rest at the start [rad/s²]"""
    ramp: float
    """Growth of the push [rad/s³]; 0 where the spring is 0"""
    decay: float
    """Damping over inertia [1/s], >= 0"""
    spring: float
    """Stiffness over inertia [1/s²], >= 0"""

    def moved(self, over: Response) -> tuple[float, float]:
        """Return distance [rad] and velocity [rad/s] at the instant of the response ``over``."""
        velocity, push, ramp, _, _ = self
        h1, h, s, r = over
        return velocity * h + push * s + ramp * r, velocity * h1 + push * h + ramp * s


def time_to_rest(slide: Slide, limit: float) -> float | None:
    """Return the time [s] at which the velocity first reaches zero; None if not before ``limit``.

    For a body that starts at rest, time 0 does not count.
    """
    velocity, push, ramp, decay, spring = slide
    if spring == 0.0:
        return _time_to_rest_without_spring(velocity, push, decay, limit)
    direction = math.copysign(1.0, velocity or push or ramp)
    # Between two zeros of the acceleration the velocity is monotone, so its sign at the end
    # decides.
    start = 0.0
    for turn in _acceleration_zeros(slide, limit):
        if turn > start:
            _, end = slide.moved(cached_response(decay, spring, turn))
            if direction * end < 0.0:
                return _root(slide, start, turn)
            start = turn
    return None


def _time_to_rest_without_spring(
    velocity: float, push: float, decay: float, limit: float
) -> float | None:
    """Return the time at which the velocity reaches zero, for a spring of 0."""
    # Signs, not a product: that would underflow, and a body almost at rest would never stop.
    if velocity == 0.0 or push == 0.0 or (velocity > 0.0) == (push > 0.0):
        return None
    coasting = -velocity / push
    y = decay * coasting
    time = coasting * (math.log1p(y) / y if y > 1e-12 else 1.0)
    return time if time < limit else None


def _acceleration_zeros(slide: Slide, limit: float) -> list[float]:
    """Return the instants in (0, limit) with zero acceleration, and ``limit`` itself [s].

    The acceleration is ``a h' + j h`` with a and j its value and its derivative at the start.
    """
    velocity, push, ramp, decay, spring = slide
    acceleration = push - decay * velocity
    half = 0.5 * decay
    slope = half * acceleration - (ramp - spring * velocity)
    discriminant = half * half - spring
    zeros: list[float] = []
    if discriminant < 0.0:
        frequency = math.sqrt(-discriminant)
        spacing = math.pi / frequency
        zero = (math.atan2(acceleration * frequency, slope) % math.pi) / frequency
        while zero < limit:
            zeros.append(zero)
            zero += spacing
    elif acceleration != 0.0 and slope != 0.0 and (acceleration > 0.0) == (slope > 0.0):
        ratio = acceleration / slope
        y = math.sqrt(discriminant) * ratio
        if y < 1.0:
            zero = ratio * (math.atanh(y) / y if y > 1e-9 else 1.0)
            if zero < limit:
                zeros.append(zero)
    zeros.append(limit)
    return zeros


def _root(slide: Slide, low: float, high: float) -> float:
    """Find the velocity's zero in a monotone bracket: Newton's method, kept inside by halving."""
    velocity, push, ramp, decay, spring = slide
    acceleration = push - decay * velocity
    jerk = ramp - spring * velocity
    sign_high = math.copysign(1.0, slide.moved(response(decay, spring, high))[1])
    # A slow body stops almost at once: begin with the tangent at the start.
    time = -velocity / acceleration if low == 0.0 and acceleration != 0.0 else high
    if not low < time < high:
        time = 0.5 * (low + high)
    for _ in range(200):
        now = response(decay, spring, time)
        speed = slide.moved(now)[1]
        if speed * sign_high > 0.0:
            high = time
        else:
            low = time
        change = acceleration * now.h1 + jerk * now.h
        correction = speed / change if change != 0.0 else math.inf
        if min(abs(correction), high - low) <= 1e-15 * time:
            break
        time -= correction
        if not low < time < high:
            time = 0.5 * (low + high)
    return time
