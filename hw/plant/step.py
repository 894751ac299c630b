"""Moves one rigid servo over a step: the only step, for a servo alone and for maps.

With friction that does not change the motion is exact to rounding: while the velocity keeps its
sign the equation is linear, and ``motion`` solves it. The step is divided at the instants
where the velocity reaches zero and where a stuck body breaks away; it solves for each of them. At
rest the body is exactly at rest.

Torques that change with position, speed or load are held over a substep at the values that they
have in its middle: the error falls with the square of the substep's length. For torques of the
position alone this is the Störmer-Verlet method, which neither feeds nor drains an oscillation.

Near the stability boundary a loop grows by 1e-7 per sample. The damping of a fixed-step integrator
would be as large. The functions are plain, so that Numba compiles them as they are.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from haptic_wall.hw.plant.mechanics import (
    Mechanics,
    cogging_at,
    friction_at,
    longest,
    most_friction,
    weight_at,
)
from haptic_wall.hw.plant.motion import response, time_to_rest

ONE_TURN = 9.0
"""Square of a phase below pi: two zeros of an oscillator's acceleration are at least pi apart"""
MOST_RESTS = 16
"""Times at rest in one substep, beside those of a swing in the hand's spring, after which it stays:
rounding makes events coincide"""


class Hand(NamedTuple):
    """The operator's spring and damper toward a moving reference, during one step."""

    stiffness: float = 0.0
    """[N·m/rad], >= 0"""
    damping: float = 0.0
    """[N·m·s/rad], >= 0"""
    reference: float = 0.0
    """Reference position at the start of the step [rad]"""
    slope: float = 0.0
    """Speed of the reference during the step [rad/s]"""


class Kept(NamedTuple):
    """A response that is at hand, so that steps of equal length do not compute it again."""

    decay: float
    """Arguments of ``motion.response``, and its values"""
    spring: float
    length: float
    h1: float
    h: float
    s: float
    r: float


NOBODY = Hand()


def kept_for(p: Mechanics, hand: Hand, braking: float, duration: float) -> Kept:
    """Return the response that a servo's steps of this length [s] need mostly.

    Args:
        p: The servo.
        hand: The operator.
        braking: Loss of the motor's torque with the velocity [N·m·s/rad].
        duration: [s].
    """
    length = duration / max(1.0, math.ceil(duration / p.grain - 1e-9)) if p.uneven else duration
    decay = (p.forth + braking + hand.damping) / p.inertia
    spring = hand.stiffness / p.inertia
    h1, h, s, r = response(decay, spring, length)
    return Kept(decay, spring, length, h1, h, s, r)


def move(  # noqa: PLR0912, PLR0915 - in one piece for speed: every period takes it
    p: Mechanics,
    kept: Kept,
    hand: Hand,
    x: float,
    v: float,
    followed: float,
    torque: float,
    braking: float,
    duration: float,
) -> tuple[float, float, float]:
    """Return position, velocity and the encoder's side of the backlash after a step.

    Args:
        p: The servo.
        kept: A response that may serve.
        hand: The operator; ``NOBODY``: no operator.
        x: Position [rad].
        v: Velocity [rad/s].
        followed: Position of the encoder's side of the backlash [rad].
        torque: Torque of the motor at rest, held over the whole step [N·m].
        braking: Loss of the motor's torque with the velocity [N·m·s/rad].
        duration: Length of the step [s], >= 0, of any size.
    """
    stiffness, grip, reference, slope = hand
    kept_decay, kept_spring, kept_length, h1_kept, h_kept, s_kept, r_kept = kept
    inertia, uneven, half = p.inertia, p.uneven, p.half
    if not uneven and v != 0.0 and stiffness == kept_spring == grip == 0.0:
        # Nearly every period of a servo without an operator takes this way: one slide.
        direction = 1.0 if v > 0.0 else -1.0
        viscous = (p.forth if v > 0.0 else p.back) + braking
        if duration == kept_length and viscous / inertia == kept_decay:
            push = (torque - direction * p.coulomb) / inertia
            end = v * h1_kept + push * h_kept
            if end * direction > 0.0 or p.smooth:
                x = x + v * h_kept + push * s_kept
                return x, end, min(max(followed, x - half), x + half) if half > 0.0 else x
    spring = stiffness / inertia
    ramp = spring * slope
    left = grain = duration
    if uneven:
        grain = duration / max(1.0, math.ceil(duration / p.grain - 1e-9))
    rests = 0
    while left > 0.0:
        outside = 0.0
        if stiffness != 0.0 or grip != 0.0:
            outside = stiffness * (reference - x) + grip * slope
        if v > 0.0:
            direction = 1.0
        elif v < 0.0:
            direction = -1.0
        else:
            direction, wait = _leaves(p, x, torque, outside, stiffness * slope, left, grain)
            if rests > MOST_RESTS + 4.0 * grain * math.sqrt(spring):
                direction, wait, rests = 0.0, min(grain, left), 0
            if wait > 0.0:
                left -= wait
                reference += slope * wait
                outside += stiffness * slope * wait
            if direction == 0.0:
                continue
        length = min(left, grain)
        viscous = (p.forth if direction > 0.0 else p.back) + braking
        if uneven:
            motor, operator = (torque, braking, viscous), (stiffness, grip, slope)
            push, length = _held(p, x, v, direction, motor, operator, outside, length)
            push /= inertia
        else:
            push = (torque + outside - direction * p.coulomb) / inertia
            if v == 0.0 and direction * push < 0.0:
                push = 0.0
        decay = (viscous + grip) / inertia
        if length == kept_length and decay == kept_decay and spring == kept_spring:
            h1, h, s, r = h1_kept, h_kept, s_kept, r_kept
        else:
            h1, h, s, r = response(decay, spring, length)
        took = length
        if spring == 0.0:  # the velocity is monotone
            there, end = x + v * h + push * s, v * h1 + push * h
            moving = direction * end > 0.0
        else:
            distance, end = v * h + push * s + ramp * r, v * h1 + push * h + ramp * s
            there = x + distance
            moving = direction * end > 0.0
            if moving:
                # In so short a step the acceleration is zero at most once: the speed fell and grew
                # again, or it did not.
                fell = (push - decay * v) * direction < 0.0
                grows = push + ramp * length - spring * distance - decay * end
                moving = spring * length * length < ONE_TURN and not (
                    fell and grows * direction > 0.0
                )
        if moving or p.smooth:
            x = there
            v = end
            rests = 0
        elif v == 0.0 and push == 0.0 and direction * ramp <= 0.0:
            rests += 1
        else:
            rest = time_to_rest(v, push, ramp, decay, spring, length)
            if rest < length:
                took = rest
                h1, h, s, r = response(decay, spring, rest)
                x += v * h + push * s + ramp * r
                v = 0.0
                rests += 1
            else:
                x = there
                # Rounding may put the end on the other side of zero: it is zero.
                v = end if direction * end > 0.0 else 0.0
        reference += slope * took
        left = left - took if left > took * (1.0 + 1e-9) else 0.0
        if half > 0.0:
            followed = min(max(followed, x - half), x + half)
    return x, v, followed if half > 0.0 else x


def _leaves(
    p: Mechanics, x: float, torque: float, outside: float, ramp: float, left: float, grain: float
) -> tuple[float, float]:
    """Return in which direction a body at rest breaks away, and when [s]; 0: it stays so long.

    The operator's torque ``outside`` grows by ``ramp`` [N·m/s] for the rest of the step.
    """
    push = torque + outside
    external = outside
    if p.uneven:
        external += weight_at(p, x)
        push = torque + external + cogging_at(p, x)
    most = most_friction(p, torque, external)
    if abs(push) > most:
        return math.copysign(1.0, push), 0.0
    if ramp == 0.0:
        return 0.0, left
    if p.load == 0.0:
        direction = math.copysign(1.0, ramp)
        wait = max(most - direction * push, 0.0) / abs(ramp)
        return (direction, wait) if wait < left else (0.0, left)
    low, high = 0.0, min(left, grain)
    after = push + ramp * high
    if abs(after) <= most_friction(p, torque, external + ramp * high):
        return 0.0, high
    for _ in range(50):
        middle = 0.5 * (low + high)
        if abs(push + ramp * middle) > most_friction(p, torque, external + ramp * middle):
            high = middle
        else:
            low = middle
    return math.copysign(1.0, after), high


def _held(
    p: Mechanics,
    x: float,
    v: float,
    direction: float,
    motor: tuple[float, float, float],
    operator: tuple[float, float, float],
    outside: float,
    most: float,
) -> tuple[float, float]:
    """Return the torque to hold over a substep, beside the linear ones [N·m], and its length [s].

    The torque is at the start, for the operator's part; friction and the others as in the middle.
    """
    torque, braking, viscous = motor
    stiffness, grip, slope = operator
    weight, cogs = weight_at(p, x), cogging_at(p, x)
    friction = friction_at(p, abs(v), torque - braking * v, outside - grip * v + weight)
    push = torque + outside + weight + cogs - direction * friction
    gain = (push - (viscous + grip) * v) / p.inertia
    length = min(most, longest(p, most, abs(v), gain))

    half = 0.5 * length
    middle, pace = x + half * v, v + half * gain
    if pace * direction < 0.0:
        pace = 0.0
    weight, cogs = weight_at(p, middle), cogging_at(p, middle)
    there = outside + stiffness * (slope * half + x - middle) - grip * pace
    friction = friction_at(p, abs(pace), torque - braking * pace, there + weight)
    push = torque + outside + weight + cogs - direction * friction
    if v == 0.0 and direction * push < 0.0:
        push = 0.0  # it breaks away just now: what holds it grows faster than what pushes
    return push, length
