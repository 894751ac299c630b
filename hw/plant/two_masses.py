"""Moves one servo with a load behind a transmission over a step, friction on the motor's side.

The motion solves, with the motor's position x, the output's y and the transmitted torque F ::

    J_m x'' = u - A sin(N x + phase) - b x' - F - friction(x', u, -F)
    J_l y'' = F - G sin(y - angle) + k_h (r - y) + b_h (r' - y')
    F       = k (x - y) + c (x' - y')

With backlash between motor and output F is counted from the end of the backlash, only pushes, and
is 0 within it. While the motor keeps its direction, or sticks, and the transmission its contact,
the equations are linear: their power series is exact to rounding. It also gives the instant of an
event (the motor stops or breaks away, a contact begins or ends). Events are looked for at the ends
of substeps, so one that is undone within a substep is missed. Weight, cogging and friction
that depends on speed or load are held over a substep at the values of its middle.

The functions are plain, so that Numba compiles them as they are. The state is a buffer of ``ROOM``
(a list, or an array where it is compiled): the motor's speed, the twist of the joint, the output's
speed, and the stretch of the operator's spring. Behind that is room for the terms of a series, and
for their sum.
"""

from __future__ import annotations

import math
from collections.abc import MutableSequence

from haptic_wall.hw.plant.mechanics import (
    Mechanics,
    cogging_at,
    friction_at,
    longest,
    most_friction,
    weight_at,
)
from haptic_wall.hw.plant.step import Hand

TERMS = 48
"""Most terms of a series"""
SIZE = 4
"""Variables of the state"""
TOP = (TERMS + 1) * SIZE
"""Place of the sum of the terms"""
ROOM = TOP + SIZE
"""Length of the state's buffer"""
REACH = 2.0
"""Largest rate times length of a series"""
SMALL = 1e-17
"""Terms of this size, relative to the largest one, no longer count"""
CLOSE = 1e-13
"""Fraction of a substep to which an event is found"""
LEAST_S = 1e-9
"""An event ends no substep earlier than this [s]"""

Buffer = MutableSequence[float]


def swing(  # noqa: PLR0915 - in one piece for speed: every period of such a servo takes it
    p: Mechanics,
    hand: Hand,
    z: Buffer,
    end: float,
    torque: float,
    braking: float,
    duration: float,
) -> float:
    """Return the output's position after a step, and change the state.

    Args:
        p: The servo.
        hand: The operator, on the output; ``NOBODY``: no operator.
        z: The state, of ``ROOM``; the stretch is not read.
        end: Position of the output [rad].
        torque: Torque of the motor at rest, held over the whole step [N·m].
        braking: Loss of the motor's torque with the velocity [N·m·s/rad].
        duration: Length of the step [s], >= 0, of any size.
    """
    stiffness, grip, reference, slope = hand
    if stiffness == 0.0 and grip == 0.0:
        reference, slope = end, 0.0
    z[3] = reference - end
    behind = p.behind
    rate = p.rate + braking / p.inertia + math.sqrt(stiffness / behind) + 2.0 * grip / behind
    grain = min(p.grain, REACH / rate)
    joint, loss = p.joint, p.loss
    left = duration
    while left > 0.0:
        length = grain if left > grain * (1.0 + 1e-9) else left
        v, twist, w = z[0], z[1], z[2]
        side = _contact(p, twist, v - w)
        ahead = side * p.half * joint if side != 0.0 else 0.0
        passed = joint * twist - ahead + loss * (v - w) if side != 0.0 else 0.0
        x = end + z[1]
        made = torque - braking * v
        push = torque + cogging_at(p, x)
        weight = weight_at(p, end)
        most = most_friction(p, made, -passed)
        stuck = v == 0.0 and abs(push - passed) <= most and not p.smooth
        direction = 0.0
        if not stuck and not p.smooth:
            direction = math.copysign(1.0, v if v != 0.0 else push - passed)
        viscous = (p.forth if direction >= 0.0 else p.back) + braking
        friction = friction_at(p, abs(v), made, -passed)
        kick = push - direction * friction
        if p.uneven:
            gain = (kick - passed - viscous * v) / p.inertia
            length = min(length, longest(p, length, abs(v), gain))
            n = _series(
                *(p, z, side, stuck, viscous, stiffness, grip),
                *(kick + ahead, weight - ahead, slope, length),
            )
            pace, bent, fast = _at(z, n, 0.5)
            there = end + 0.5 * slope * length + z[3]
            there = there - _one(z, n, 3, 0.5)
            x = there + _one(z, n, 1, 0.5)
            if side != 0.0:
                passed = joint * bent - ahead + loss * (pace - fast)
            made = torque - braking * pace
            push = torque + cogging_at(p, x)
            weight = weight_at(p, there)
            friction = friction_at(p, abs(pace), made, -passed)
            kick = push - direction * friction
            if v == 0.0 and direction * (kick - passed) < 0.0:
                kick = passed  # it breaks away just now
        n = _series(
            *(p, z, side, stuck, viscous, stiffness, grip),
            *(kick + ahead, weight - ahead, slope, length),
        )
        share = 1.0
        if not p.smooth:
            v, twist, w = z[TOP], z[TOP + 1], z[TOP + 2]
            margin = _margin(p, v, twist, w, direction, side, push, made)
            if margin <= 0.0:
                share = _until(p, z, n, direction, side, push, made, margin)
                share = max(share, min(1.0, LEAST_S / length))
        stretch = z[3]
        for i in range(SIZE):
            z[i] = z[TOP + i] if share == 1.0 else _one(z, n, i, share)
        took = share * length
        end += slope * took + stretch - z[3]
        if not p.smooth and not direction * z[0] > 0.0:
            z[0] = 0.0
        left = left - took if left > took * (1.0 + 1e-9) else 0.0
    return end


def _contact(p: Mechanics, twist: float, rate: float) -> float:
    """Return the side on which the transmission pushes; 0: it is within its backlash."""
    if p.half == 0.0:
        return 1.0
    side = 1.0 if twist > 0.0 else -1.0
    deep = side * twist - p.half
    pushes = deep > 0.0 and p.joint * deep + p.loss * side * rate > 0.0
    return side if pushes else 0.0


def _series(
    p: Mechanics,
    z: Buffer,
    side: float,
    stuck: bool,
    viscous: float,
    stiffness: float,
    grip: float,
    on_motor: float,
    on_output: float,
    slope: float,
    length: float,
) -> int:
    """Compute the motion as powers of the share of ``length`` that has passed.

    The terms are put behind the state in ``z``. The torques on motor and output are held.

    Returns:
        The number of terms.
    """
    joint, loss = (p.joint, p.loss) if side != 0.0 else (0.0, 0.0)
    inertia, behind = p.inertia, p.behind
    v, twist, w, stretch = z[0], z[1], z[2], z[3]
    z[4], z[5], z[6], z[7] = v, twist, w, stretch
    v_sum, twist_sum, w_sum, stretch_sum = v, twist, w, stretch
    greatest, at = SMALL, SIZE
    for k in range(1, TERMS):
        factor, at = length / k, at + SIZE
        passed, apart = joint * twist + loss * (v - w), factor * (v - w)
        pulled = passed + on_output + stiffness * stretch + grip * (slope - w)
        v = 0.0 if stuck else factor * (on_motor - passed - viscous * v) / inertia
        stretch = factor * (slope - w)
        w = factor * pulled / behind
        twist = apart
        z[at], z[at + 1], z[at + 2], z[at + 3] = v, twist, w, stretch
        v_sum += v
        twist_sum += twist
        w_sum += w
        stretch_sum += stretch
        on_motor = on_output = slope = 0.0
        largest = abs(v) + abs(twist) + abs(w) + abs(stretch)
        if largest > greatest:
            greatest = largest
        elif largest <= SMALL * greatest:
            break
    z[TOP], z[TOP + 1], z[TOP + 2], z[TOP + 3] = v_sum, twist_sum, w_sum, stretch_sum
    return k + 1


def _one(z: Buffer, n: int, i: int, share: float) -> float:
    """Return one variable at a share of the series' length."""
    value = 0.0
    for k in range(n - 1, -1, -1):
        value = value * share + z[(k + 1) * SIZE + i]
    return value


def _at(z: Buffer, n: int, share: float) -> tuple[float, float, float]:
    """Return the motor's speed, the twist and the output's speed."""
    v = twist = w = 0.0
    for k in range(n * SIZE, 0, -SIZE):
        v = v * share + z[k]
        twist = twist * share + z[k + 1]
        w = w * share + z[k + 2]
    return v, twist, w


def _margin(
    p: Mechanics,
    v: float,
    twist: float,
    w: float,
    direction: float,
    side: float,
    push: float,
    made: float,
) -> float:
    """Return a value that is positive while the present motion lasts."""
    joint, loss, half = p.joint, p.loss, p.half
    passed, margin = 0.0, math.inf
    if side != 0.0:
        passed = joint * (twist - side * half) + loss * (v - w)
        if half > 0.0:
            margin = side * passed
    else:
        touched = 1.0 if twist > 0.0 else -1.0
        deep = touched * twist - half
        margin = joint * max(-deep, -deep - loss / joint * touched * (v - w))
    if direction != 0.0:
        return min(margin, direction * v)
    return min(margin, most_friction(p, made, -passed) - abs(push - passed))


def _until(
    p: Mechanics,
    z: Buffer,
    n: int,
    direction: float,
    side: float,
    push: float,
    made: float,
    margin: float,
) -> float:
    """Return the share at which the present motion has just ended: by false position."""
    low, high, at_low, at_high = 0.0, 1.0, 0.0, margin
    for k in range(60):
        middle = 0.5 * (low + high)
        if at_low > 0.0 and k % 4 != 3:
            middle = (low * at_high - high * at_low) / (at_high - at_low)
            # A little to the far side, so that both ends close in.
            middle = min(middle + 0.1 * CLOSE, 0.5 * (middle + high))
        v, twist, w = _at(z, n, middle)
        now = _margin(p, v, twist, w, direction, side, push, made)
        if now > 0.0:
            low, at_low = middle, now
        else:
            high, at_high = middle, now
        if high - low <= CLOSE:
            break
    return high
