"""Moves one servo with masses behind a transmission over a step, friction on the motor's side.

The motion solves, with the motor's position x, the output's y and the transmitted torque F ::

    J_m x'' = u - A sin(N x + phase) - b x' - F - friction(x', u, -F)
    J_l y'' = F - G sin(y - angle) + k_h (r - y) + b_h (r' - y')
    F       = k (x - y) + c (x' - y')

Further masses follow the output on linear joints; operator and weight are then at the last one.

With backlash between motor and output F is counted from the end of the backlash, only pushes, and
is 0 within it. While the motor keeps its direction, or sticks, and the transmission its contact,
the equations are linear: their power series is exact to rounding. It also gives the instant of an
event (the motor stops or breaks away, a contact begins or ends). Events are looked for at the ends
of substeps, so one that is undone within a substep is missed. Weight, cogging and friction
that depends on speed or load are held over a substep at the values of its middle.

The functions are plain, so that Numba compiles them as they are. The state is a buffer (a list, or
an array where it is compiled): the motor's speed, then for each further mass the twist of the joint
before it and its speed, and the stretch of the operator's spring. Behind that is room for the terms
of a series, and for their sum.
"""

from __future__ import annotations

import math
from collections.abc import MutableSequence

from haptic_wall.hw.plant.mechanics import (
    Links,
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
REACH = 2.0
"""Largest rate times length of a series"""
SMALL = 1e-17
"""Terms of this size, relative to the largest one, no longer count"""
CLOSE = 1e-13
"""Fraction of a substep to which an event is found"""
LEAST_S = 1e-9
"""An event ends no substep earlier than this [s]"""

Buffer = MutableSequence[float]


def room(masses: int) -> int:
    """Return the length of the state's buffer for so many masses behind the motor."""
    return (TERMS + 2) * (2 * masses + 2)


def swing(  # noqa: PLR0915 - in one piece for speed: every period of such a servo takes it
    p: Mechanics,
    links: Links,
    hand: Hand,
    z: Buffer,
    end: float,
    torque: float,
    braking: float,
    duration: float,
) -> float:
    """Return the last mass's position after a step, and change the state.

    Args:
        p: The servo.
        links: The masses behind the motor.
        hand: The operator, at the last mass; ``NOBODY``: no operator.
        z: The state, of ``room``; the stretch is not read.
        end: Position of the last mass [rad].
        torque: Torque of the motor at rest, held over the whole step [N·m].
        braking: Loss of the motor's torque with the velocity [N·m·s/rad].
        duration: Length of the step [s], >= 0, of any size.
    """
    stiffness, grip, reference, slope = hand
    count = p.masses
    size = 2 * count + 2
    top = (TERMS + 1) * size
    if stiffness == 0.0 and grip == 0.0:
        reference, slope = end, 0.0
    z[size - 1] = reference - end
    last = links[3 * count - 3]
    rate = p.rate + braking / p.inertia + math.sqrt(stiffness / last) + 2.0 * grip / last
    grain = min(p.grain, REACH / rate)
    joint, loss = links[1], links[2]
    left = duration
    while left > 0.0:
        length = grain if left > grain * (1.0 + 1e-9) else left
        v, twist, w = z[0], z[1], z[2]
        side = _contact(p, links, twist, v - w)
        ahead = side * p.half * joint if side != 0.0 else 0.0
        passed = joint * twist - ahead + loss * (v - w) if side != 0.0 else 0.0
        x = end
        for i in range(count):
            x += z[2 * i + 1]
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
                *(p, links, z, side, stuck, viscous, stiffness, grip),
                *(kick + ahead, -ahead, weight, slope, length),
            )
            pace, bent, fast = _at(z, n, size, 0.5)
            there = end + 0.5 * slope * length + z[size - 1]
            x = there = there - _one(z, n, size, size - 1, 0.5)
            for i in range(count):
                x += _one(z, n, size, 2 * i + 1, 0.5)
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
            *(p, links, z, side, stuck, viscous, stiffness, grip),
            *(kick + ahead, -ahead, weight, slope, length),
        )
        share = 1.0
        if not p.smooth:
            v, twist, w = z[top], z[top + 1], z[top + 2]
            margin = _margin(p, links, v, twist, w, direction, side, push, made)
            if margin <= 0.0:
                share = _until(p, links, z, n, size, direction, side, push, made, margin)
                share = max(share, min(1.0, LEAST_S / length))
        stretch = z[size - 1]
        for i in range(size):
            z[i] = z[top + i] if share == 1.0 else _one(z, n, size, i, share)
        took = share * length
        end += slope * took + stretch - z[size - 1]
        if not p.smooth and not direction * z[0] > 0.0:
            z[0] = 0.0
        left = left - took if left > took * (1.0 + 1e-9) else 0.0
    return end


def _contact(p: Mechanics, links: Links, twist: float, rate: float) -> float:
    """Return the side on which the transmission pushes; 0: it is within its backlash."""
    if p.half == 0.0:
        return 1.0
    side = 1.0 if twist > 0.0 else -1.0
    deep = side * twist - p.half
    pushes = deep > 0.0 and links[1] * deep + links[2] * side * rate > 0.0
    return side if pushes else 0.0


def _series(
    p: Mechanics,
    links: Links,
    z: Buffer,
    side: float,
    stuck: bool,
    viscous: float,
    stiffness: float,
    grip: float,
    on_motor: float,
    on_output: float,
    on_end: float,
    slope: float,
    length: float,
) -> int:
    """Compute the motion as powers of the share of ``length`` that has passed.

    Args:
        p: The servo.
        links: The masses behind the motor.
        z: The state at the start; behind it this puts the terms.
        side: Where the transmission pushes; 0: it does not.
        stuck: The motor's side stands still.
        viscous: Friction of the motor [N·m·s/rad].
        stiffness: Of the operator [N·m/rad].
        grip: Damping of the operator [N·m·s/rad].
        on_motor: Held torque [N·m]; the others on output and last mass.
        on_output: See above.
        on_end: See above.
        slope: Speed of the reference [rad/s].
        length: [s].

    Returns:
        The number of terms.
    """
    count = p.masses
    size = 2 * count + 2
    for i in range(size):
        z[size + i] = z[i]
    joint, loss = (links[1], links[2]) if side != 0.0 else (0.0, 0.0)
    inertia, behind = p.inertia, 3 * count - 3
    if count == 1:
        return _series_of_two(
            *(z, joint, loss, inertia, links[0], stuck, viscous, stiffness, grip),
            *(on_motor, on_output + on_end, slope, length),
        )
    greatest = SMALL
    for k in range(1, TERMS):
        old, new = k * size, (k + 1) * size
        factor = length / k
        v, w = z[old], z[old + 2]
        passed = joint * z[old + 1] + loss * (v - w)
        change = 0.0 if stuck else factor * (on_motor - passed - viscous * v) / inertia
        z[new] = change
        largest = abs(change)
        base = 0
        while base < behind:  # joints between two further masses
            i = old + 2 * (base // 3) + 1
            next_passed = links[base + 4] * z[i + 2] + links[base + 5] * (w - z[i + 3])
            z[i + size] = factor * (v - w)
            change = factor * (passed - next_passed + on_output) / links[base]
            z[i + size + 1] = change
            largest += abs(change)
            on_output = 0.0
            passed, v, w = next_passed, w, z[i + 3]
            base += 3
        i = new + size - 3
        z[i] = factor * (v - w)
        pulled = stiffness * z[old + size - 1] + grip * (slope - w) + on_output + on_end
        change = factor * (passed + pulled) / links[base]
        z[i + 1] = change
        z[i + 2] = factor * (slope - w)
        largest += abs(change) + abs(z[i]) + abs(z[i + 2])
        on_motor = on_output = on_end = slope = 0.0
        if largest > greatest:
            greatest = largest
        elif largest <= SMALL * greatest:
            break
    for i in range(size):
        z[(TERMS + 1) * size + i] = _one(z, k + 1, size, i, 1.0)
    return k + 1


def _series_of_two(
    z: Buffer,
    joint: float,
    loss: float,
    inertia: float,
    load: float,
    stuck: bool,
    viscous: float,
    stiffness: float,
    grip: float,
    on_motor: float,
    on_end: float,
    slope: float,
    length: float,
) -> int:
    """Do the same for one mass behind the motor; in Python that saves a third of a period."""
    v, twist, w, stretch = z[0], z[1], z[2], z[3]
    v_sum, twist_sum, w_sum, stretch_sum = v, twist, w, stretch
    greatest, at = SMALL, 4
    for k in range(1, TERMS):
        factor, at = length / k, at + 4
        passed, apart = joint * twist + loss * (v - w), factor * (v - w)
        pulled = passed + on_end + stiffness * stretch + grip * (slope - w)
        v = 0.0 if stuck else factor * (on_motor - passed - viscous * v) / inertia
        stretch = factor * (slope - w)
        w = factor * pulled / load
        twist = apart
        z[at], z[at + 1], z[at + 2], z[at + 3] = v, twist, w, stretch
        v_sum += v
        twist_sum += twist
        w_sum += w
        stretch_sum += stretch
        on_motor = on_end = slope = 0.0
        largest = abs(v) + abs(twist) + abs(w) + abs(stretch)
        if largest > greatest:
            greatest = largest
        elif largest <= SMALL * greatest:
            break
    top = 4 * (TERMS + 1)
    z[top], z[top + 1], z[top + 2], z[top + 3] = v_sum, twist_sum, w_sum, stretch_sum
    return k + 1


def _one(z: Buffer, n: int, size: int, i: int, share: float) -> float:
    """Return one variable at a share of the series' length."""
    value = 0.0
    for k in range(n - 1, -1, -1):
        value = value * share + z[(k + 1) * size + i]
    return value


def _at(z: Buffer, n: int, size: int, share: float) -> tuple[float, float, float]:
    """Return the motor's speed, the first twist and the output's speed."""
    v = twist = w = 0.0
    for k in range(n * size, 0, -size):
        v = v * share + z[k]
        twist = twist * share + z[k + 1]
        w = w * share + z[k + 2]
    return v, twist, w


def _margin(
    p: Mechanics,
    links: Links,
    v: float,
    twist: float,
    w: float,
    direction: float,
    side: float,
    push: float,
    made: float,
) -> float:
    """Return a value that is positive while the present motion lasts."""
    joint, loss, half = links[1], links[2], p.half
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
    links: Links,
    z: Buffer,
    n: int,
    size: int,
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
        v, twist, w = _at(z, n, size, middle)
        now = _margin(p, links, v, twist, w, direction, side, push, made)
        if now > 0.0:
            low, at_low = middle, now
        else:
            high, at_high = middle, now
        if high - low <= CLOSE:
            break
    return high
