"""Simulates many loops in lanes: the array loop of ``many_walls``, written to be compiled.

The operations and their order are those of ``many_walls`` and ``haptic_wall.hw.plant.bodies``, so
that each wall moves to the last bit as there. A few walls at a time, one in each lane, run through
all periods in a workspace that stays in the first-level cache. Each pass over the lanes has no
branches, so that a compiler makes vector instructions of it; bodies that come to rest within a step
are rare and are solved one by one. One wall at a time would wait for its own last result in every
operation. Threads instead of processes would not help: the search around the loop holds the
interpreter.

The functions are plain Python and give the same results uncompiled, thousands of times slower.
``haptic_wall.controller.experiments.maps.compiled`` compiles them. All are in one file, because the
cache on the disk is renewed when the file of the compiled function changes.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from haptic_wall.controller.theory.checks import FloatArray, IntArray

LANES: Final = 128
"""Walls simulated together: fewer pay more for each pass, more leave the first-level cache"""

# Rows of ``fixed``: what does not change.
INERTIA: Final = 0
DECAY: Final = 1
COULOMB: Final = 2
FRICTION: Final = 3
COUNTS: Final = 4
HALF: Final = 5
LIMIT: Final = 6
STEP: Final = 7
SOFTNESS: Final = 8
"""The stiffness with a minus"""
VIRTUAL: Final = 9
PERIOD: Final = 10
LATE: Final = 11
"""h1, h, s and the duration of the part of a period before the torque changes"""
HELD: Final = 15
"""The same of the rest of a period"""
FULL: Final = 19
"""Torque from which on the limit has acted"""
GONE: Final = 20
"""Periods outside a wall after which a contact is over"""
FIXED: Final = 21

# Rows of ``seen``: what an observer remembers.
BEFORE: Final = 0
"""Turning points: the last velocity other than 0. Contacts: the velocity at the last look"""
CAME: Final = 1
"""Position at the last look"""
LIMITED: Final = 2
"""Turning points: 1 if the limit has acted"""
ENTERED: Final = 2
"""Contacts: 1 if it was inside"""
OUTSIDE: Final = 3
"""Contacts: periods outside since then"""
LEAVING: Final = 4
"""Contacts: greatest speed outwards since then"""
SEEN: Final = 5

# Rows of the workspace beyond those two.
_POSITION: Final = FIXED + SEEN
_VELOCITY: Final = _POSITION + 1
_FOLLOWED: Final = _POSITION + 2
_MEASURED: Final = _POSITION + 3
_EARLIER: Final = _POSITION + 4
_TORQUE: Final = _POSITION + 5
_ACTING: Final = _POSITION + 6
_OVER: Final = _POSITION + 7
_FLAG: Final = _POSITION + 8
_ROWS: Final = _POSITION + 9

# Traits, alike for all walls.
ONE_SIDED: Final = 0
IS_LIMITED: Final = 1
STEPPED: Final = 2
ROUNDED: Final = 3
PLAY: Final = 4
FRICTIONAL: Final = 5
LAGS: Final = 6
SAMPLES: Final = 7
"""N of the velocity difference"""
OBSERVER: Final = 8
TRAITS: Final = 9

# Observers.
NOBODY: Final = 0
TURNINGS: Final = 1
CONTACTS: Final = 2

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


def slide(w: FloatArray, over: FloatArray) -> None:
    """Move bodies without Coulomb friction."""
    for i in range(LANES):
        velocity = w[_VELOCITY * LANES + i]
        push = w[_ACTING * LANES + i] / w[INERTIA * LANES + i]
        h1, h, s = over[i], over[LANES + i], over[2 * LANES + i]
        w[_POSITION * LANES + i] = (w[_POSITION * LANES + i] + velocity * h) + push * s
        w[_VELOCITY * LANES + i] = velocity * h1 + push * h


def slide_or_stick(w: FloatArray, over: FloatArray) -> None:
    """Move bodies with Coulomb friction."""
    few = 0
    for i in range(LANES):
        position, velocity = w[_POSITION * LANES + i], w[_VELOCITY * LANES + i]
        torque, coulomb = w[_ACTING * LANES + i], w[COULOMB * LANES + i]
        h1, h, s = over[i], over[LANES + i], over[2 * LANES + i]
        direction = torque if velocity == 0.0 else velocity
        stuck = (velocity == 0.0) & (abs(torque) <= coulomb)
        push = (torque - math.copysign(coulomb, direction)) / w[INERTIA * LANES + i]
        moved = (position + velocity * h) + push * s
        end = velocity * h1 + push * h
        # Without a spring the velocity is monotone: if it keeps its sign it was never zero.
        kept = (end * direction > 0.0) | (coulomb == 0.0)
        few += 0 if kept | stuck else 1
        w[_FLAG * LANES + i] = 0.0 if kept | stuck else 1.0
        w[_POSITION * LANES + i] = moved if kept & (not stuck) else position
        w[_VELOCITY * LANES + i] = 0.0 if stuck else (end if kept else velocity)
    if few == 0:
        return
    for i in range(LANES):
        if w[_FLAG * LANES + i] != 0.0:
            w[_POSITION * LANES + i], w[_VELOCITY * LANES + i], _, _ = through_rest(
                w[_POSITION * LANES + i],
                w[_VELOCITY * LANES + i],
                w[_ACTING * LANES + i],
                w[INERTIA * LANES + i],
                w[COULOMB * LANES + i],
                w[DECAY * LANES + i],
                over[i],
                over[LANES + i],
                over[2 * LANES + i],
                over[3 * LANES + i],
            )


def slide_turning(w: FloatArray, over: FloatArray) -> None:
    """Move bodies behind backlash, and what follows them."""
    few = 0
    for i in range(LANES):
        position, velocity = w[_POSITION * LANES + i], w[_VELOCITY * LANES + i]
        inertia, friction = w[INERTIA * LANES + i], w[FRICTION * LANES + i]
        h1, h, s = over[i], over[LANES + i], over[2 * LANES + i]
        pull = w[_ACTING * LANES + i] / inertia
        moves = (velocity != 0.0) | (abs(pull) > friction)
        direction = math.copysign(1.0, velocity if velocity != 0.0 else pull)
        push = pull - direction * friction
        end = velocity * h1 + push * h
        distance = velocity * h + push * s
        turns = (velocity != 0.0) & ((velocity > 0.0) != (push > 0.0))
        turns = turns & (end * direction <= _CLEARLY * abs(velocity))
        few += 1 if turns else 0
        w[_FLAG * LANES + i] = 1.0 if turns else 0.0
        w[_POSITION * LANES + i] = position + distance if moves & (not turns) else position
        goes = moves & (end * direction > 0.0)
        w[_VELOCITY * LANES + i] = velocity if turns else (end if goes else 0.0)
    for i in range(LANES if few else 0):
        if w[_FLAG * LANES + i] != 0.0:
            position, velocity, turned, turn = through_rest(
                w[_POSITION * LANES + i],
                w[_VELOCITY * LANES + i],
                w[_ACTING * LANES + i],
                w[INERTIA * LANES + i],
                w[COULOMB * LANES + i],
                w[DECAY * LANES + i],
                over[i],
                over[LANES + i],
                over[2 * LANES + i],
                over[3 * LANES + i],
            )
            w[_POSITION * LANES + i], w[_VELOCITY * LANES + i] = position, velocity
            if turned:
                half, followed = w[HALF * LANES + i], w[_FOLLOWED * LANES + i]
                followed = turn - half if turn - half > followed else followed
                w[_FOLLOWED * LANES + i] = min(followed, turn + half)
    for i in range(LANES):
        position, half = w[_POSITION * LANES + i], w[HALF * LANES + i]
        followed = w[_FOLLOWED * LANES + i]
        low, high = position - half, position + half
        followed = followed if followed >= low else low
        w[_FOLLOWED * LANES + i] = followed if followed <= high else high


def sense(
    w: FloatArray,
    traits: IntArray,
    measured: FloatArray,
    first: int,
    lanes: int,
    now: int,
    back: int,
    since: int,
) -> None:
    """Measure the positions, and fetch those that were measured ``back`` periods ago."""
    if not traits[PLAY]:
        for i in range(LANES):
            w[_FOLLOWED * LANES + i] = w[_POSITION * LANES + i]
    if traits[ROUNDED]:
        for i in range(LANES):
            counts = w[COUNTS * LANES + i]
            w[_MEASURED * LANES + i] = np.rint(w[_FOLLOWED * LANES + i] * counts) / counts
    else:
        for i in range(LANES):
            w[_MEASURED * LANES + i] = w[_FOLLOWED * LANES + i]
    row, earlier = now % measured.shape[0], (now - back) % measured.shape[0]
    for i in range(lanes):
        measured[row, first + i] = w[_MEASURED * LANES + i]
    for i in range(lanes):
        w[_EARLIER * LANES + i] = measured[earlier, first + i]
    if now <= traits[SAMPLES] or now == since:
        for i in range(LANES):
            w[_OVER * LANES + i] = back * w[PERIOD * LANES + i]


def delayed(
    w: FloatArray,
    delays: IntArray,
    torques: FloatArray,
    hands: FloatArray,
    first: int,
    lanes: int,
    now: int,
    since: int,
    least: int,
    most: int,
) -> None:
    """Fetch the torques commanded each wall's whole periods of delay ago, and the operator's."""
    for each in range(least, most):
        row = now - delays[each, 0]
        row += torques.shape[0] if row < 0 else 0
        start, end = max(delays[each, 1] - first, 0), min(delays[each, 2] - first, lanes)
        for i in range(start, end):
            w[_ACTING * LANES + i] = torques[row, first + i]
    if hands.shape[0]:
        row = min(since, hands.shape[0] - 1)
        for i in range(lanes):
            w[_ACTING * LANES + i] = w[_ACTING * LANES + i] + hands[row, first + i]


def command(w: FloatArray, traits: IntArray, back: int) -> None:
    """Compute the walls' torques, limited and rounded, from the measured positions."""
    if back:
        for i in range(LANES):
            measured = w[_MEASURED * LANES + i]
            estimate = (measured - w[_EARLIER * LANES + i]) / w[_OVER * LANES + i]
            torque = w[SOFTNESS * LANES + i] * measured
            w[_TORQUE * LANES + i] = torque - w[VIRTUAL * LANES + i] * estimate
    else:
        for i in range(LANES):
            w[_TORQUE * LANES + i] = w[SOFTNESS * LANES + i] * w[_MEASURED * LANES + i]
    if traits[ONE_SIDED]:
        for i in range(LANES):
            torque = w[_TORQUE * LANES + i]
            torque = 0.0 if torque > 0.0 else torque
            w[_TORQUE * LANES + i] = 0.0 if w[_MEASURED * LANES + i] <= 0.0 else torque
    if traits[IS_LIMITED]:
        for i in range(LANES):
            torque, limit = w[_TORQUE * LANES + i], w[LIMIT * LANES + i]
            torque = -limit if torque < -limit else torque
            w[_TORQUE * LANES + i] = limit if torque > limit else torque
    if traits[STEPPED]:
        for i in range(LANES):
            step = w[STEP * LANES + i]
            steps = np.rint(w[_TORQUE * LANES + i] / step)
            fewer = steps - math.copysign(1.0, steps)
            beyond = abs(steps * step) > w[LIMIT * LANES + i]
            w[_TORQUE * LANES + i] = (fewer if beyond else steps) * step


def move(w: FloatArray, traits: IntArray, over: FloatArray) -> None:
    """Move the servos under the acting torques for a part of a period."""
    if traits[PLAY]:
        slide_turning(w, over)
        return
    if traits[FRICTIONAL]:
        slide_or_stick(w, over)
    else:
        slide(w, over)


def look(w: FloatArray, over: FloatArray) -> None:
    """Record the speeds outside the wall; as ``bounce``."""
    few = 0
    for i in range(LANES):
        position, velocity = w[_POSITION * LANES + i], w[_VELOCITY * LANES + i]
        before, leaving = w[(FIXED + CAME) * LANES + i], w[(FIXED + LEAVING) * LANES + i]
        inside = position > 0.0
        entered = inside | (w[(FIXED + ENTERED) * LANES + i] != 0.0)
        out = (not inside) & entered
        crossed = out & (before > 0.0)
        few += 1 if crossed else 0
        w[_FLAG * LANES + i] = 1.0 if crossed else 0.0
        leaving = -velocity if out & (-velocity > leaving) else leaving
        w[(FIXED + LEAVING) * LANES + i] = 0.0 if inside else leaving
        w[(FIXED + ENTERED) * LANES + i] = 1.0 if entered else 0.0
    for i in range(LANES if few else 0):
        if w[_FLAG * LANES + i] != 0.0:
            position, velocity = w[_POSITION * LANES + i], w[_VELOCITY * LANES + i]
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
    for i in range(LANES):
        w[(FIXED + CAME) * LANES + i] = w[_POSITION * LANES + i]
        w[(FIXED + BEFORE) * LANES + i] = w[_VELOCITY * LANES + i]


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
        few += 1 if w[(FIXED + BEFORE) * LANES + i] * w[_VELOCITY * LANES + i] < 0.0 else 0
    for i in range(lanes if few else 0):
        before, velocity = w[(FIXED + BEFORE) * LANES + i], w[_VELOCITY * LANES + i]
        if before * velocity < 0.0:
            turned[0, count], turned[1, count], turned[2, count] = first + i, k, before
            turned[3, count], turned[4, count] = velocity, w[(FIXED + CAME) * LANES + i]
            count += 1
    if limited:
        for i in range(LANES):
            acted = abs(w[_TORQUE * LANES + i]) >= w[FULL * LANES + i]
            before = w[(FIXED + LIMITED) * LANES + i]
            w[(FIXED + LIMITED) * LANES + i] = 1.0 if acted else before
    for i in range(LANES):
        velocity, before = w[_VELOCITY * LANES + i], w[(FIXED + BEFORE) * LANES + i]
        w[(FIXED + BEFORE) * LANES + i] = velocity if velocity != 0.0 else before
        w[(FIXED + CAME) * LANES + i] = w[_POSITION * LANES + i]
    return count


def load(
    w: FloatArray,
    fixed: FloatArray,
    seen: FloatArray,
    body: FloatArray,
    first: int,
    lanes: int,
) -> None:
    """Copy walls into the workspace; lanes that are left over get the last one."""
    for i in range(LANES):
        wall = first + min(i, lanes - 1)
        for row in range(FIXED):
            w[row * LANES + i] = fixed[row, wall]
        for row in range(SEEN):
            w[(FIXED + row) * LANES + i] = seen[row, wall]
        for row in range(3):
            w[(_POSITION + row) * LANES + i] = body[row, wall]


def store(
    w: FloatArray,
    traits: IntArray,
    seen: FloatArray,
    body: FloatArray,
    first: int,
    lanes: int,
) -> None:
    """Copy walls back from the workspace."""
    following = _FOLLOWED if traits[PLAY] else _POSITION
    for i in range(lanes):
        for row in range(SEEN):
            seen[row, first + i] = w[(FIXED + row) * LANES + i]
        body[0, first + i] = w[_POSITION * LANES + i]
        body[1, first + i] = w[_VELOCITY * LANES + i]
        body[2, first + i] = w[following * LANES + i]


def among(delays: IntArray, first: int, last: int) -> tuple[int, int]:
    """Return the first delay, and the one behind the last, of these walls."""
    least, most = 0, delays.shape[0]
    while delays[least, 2] <= first:
        least += 1
    while delays[most - 1, 1] >= last:
        most -= 1
    return least, most


def gone(w: FloatArray, traits: IntArray) -> bool:
    """Whether every contact is over, and nothing can change what is known of it."""
    if traits[OBSERVER] != CONTACTS or traits[PLAY]:
        return False
    still = 0
    for i in range(LANES):
        still += 0 if w[(FIXED + OUTSIDE) * LANES + i] > w[GONE * LANES + i] else 1
    return still == 0


def run(
    k: int,
    periods: int,
    traits: IntArray,
    delays: IntArray,
    fixed: FloatArray,
    hands: FloatArray,
    seen: FloatArray,
    body: FloatArray,
    measured: FloatArray,
    torques: FloatArray,
    turned: FloatArray,
    course: FloatArray,
) -> int:
    """Simulate all walls for some periods, in place.

    Args:
        k: Periods before.
        periods: Number of periods.
        traits: What the walls are, all alike; see ``ONE_SIDED`` and the following.
        delays: Whole periods, first and last wall of each delay, rising, shape (delays, 3).
        fixed: What does not change, shape (FIXED, n).
        hands: Torques of an operator [N·m], a row for each period, of which the last one stays;
            shape (rows, n); without rows: none.
        seen: What the observer remembers, shape (SEEN, n).
        body: Position, velocity and followed position, shape (3, n).
        measured: Measured positions [rad], a ring buffer with a row per period, shape (rows, n).
        torques: Commanded torques [N·m], the same.
        turned: Wall, period, velocities before and after, and position before of each turning
            point; shape (5, room).
        course: Gets the positions after each period [rad], shape (periods, n), or has no rows.

    Returns:
        The number of turning points.
    """
    w, late, held = np.zeros(_ROWS * LANES), np.zeros(4 * LANES), np.zeros(4 * LANES)
    walls = fixed.shape[1]
    count = 0
    for first in range(0, walls, LANES):
        lanes = min(LANES, walls - first)
        load(w, fixed, seen, body, first, lanes)
        if gone(w, traits):
            continue
        for i in range(4 * LANES):
            late[i], held[i] = w[LATE * LANES + i], w[HELD * LANES + i]
        least, most = among(delays, first, first + lanes)
        for now in range(k, k + periods):
            back = min(now, traits[SAMPLES])
            sense(w, traits, measured, first, lanes, now, back, k)
            command(w, traits, back)
            row = now % torques.shape[0]
            for i in range(lanes):
                torques[row, first + i] = w[_TORQUE * LANES + i]
            if traits[LAGS]:
                before = row - 1 if row else torques.shape[0] - 1
                delayed(w, delays, torques, hands, first, lanes, before, now - k, least, most)
                move(w, traits, late)
                if traits[OBSERVER] == CONTACTS:
                    look(w, late)
            delayed(w, delays, torques, hands, first, lanes, row, now - k, least, most)
            move(w, traits, held)
            if traits[OBSERVER] == CONTACTS:
                look(w, held)
                stay(w)
            elif traits[OBSERVER] == TURNINGS:
                count = turn(w, first, lanes, now + 1, traits[IS_LIMITED] != 0, turned, count)
            for i in range(lanes if course.shape[0] else 0):
                course[now - k, first + i] = w[_POSITION * LANES + i]
        store(w, traits, seen, body, first, lanes)
    return count
