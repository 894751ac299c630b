"""Computes from turning points whether a two-sided wall's motion grows after a kick.

The growth is fitted to the amplitudes of many oscillations, so that its sign is known long before
the motion has become large or small. The functions are plain: see ``loop``.
"""

from __future__ import annotations

import math
from typing import Final

from haptic_wall.controller.experiments.maps.loop import (
    POSITION,
    SUMS,
    TORQUE,
    VELOCITY,
    Wall,
    act,
    begin,
    command,
    keep,
    motor_position,
    motor_velocity,
)
from haptic_wall.hw.plant.two_masses import Buffer

_LEAST_PERIODS: Final = 1000
_MOST_PERIODS: Final = 200_000
_SURE: Final = 3.0
"""Standard errors by which growth must differ from zero where counts or backlash make it irregular.
"""
_CHANGES: Final = 0.05
"""Largest late change of an amplitude's logarithm in steady motion"""
_SOON: Final = 2.0
"""Number of late parts of a run within which a motion must return to its kick"""
_SEGMENT: Final = 256
"""Periods between two checks whether the wall is decided"""
_DECIDED: Final = 3.0
"""Factor of growth after which a motion is no longer simulated, and of decay with friction. Without
friction another, faster oscillation may still appear."""
_FAR: Final = 1e6
"""The same factor for a motion that does not turn"""
_DEAD: Final = 1e-12
"""Factor of decay after which a motion counts as dead."""
_LATE: Final = 0.4
"""Fraction of the time after which the growth without friction is fitted: fast modes have decayed.
With friction the growth depends on the amplitude, and the kick's own counts; with counts or
backlash the late amplitude itself is compared with that at the start."""
_STILL: Final = 1e-12
"""Rounding of the position of a motor that stands still before a load that moves [rad]"""
_FADING: Final = 0.01
"""A saturating motion that loses less than this fraction per oscillation late in its run persists.
"""
_SETTLING: Final = 2
"""Turning points omitted at the start: the release excites other modes too."""
_TINY: Final = 2.2250738585072014e-308
_WHOLE: Final = SUMS
"""Places of the sums of lines: through all turning points, and the late ones"""
_SINCE: Final = SUMS + 6


def growth(  # noqa: PLR0912, PLR0915 - one simulation
    wall: Wall, s: Buffer, z: Buffer, stiffness: float, start: float, cycles: float
) -> float:
    """Return the growth per oscillation after a kick; > 0: the motion grows.

    The servo is released at rest after being held for long: at a turning point, with zero estimated
    velocity. Motion that saturates the torque cannot grow: it decays to what the torque limit
    sustains, if anything. So the kick must not saturate it, and motion that still saturates late
    without fading counts as growing.

    Args:
        wall: A two-sided wall.
        s: The simulation's buffer.
        z: The state of ``two_masses``.
        stiffness: K > 0 [N·m/rad].
        start: Displacement at the start, > 0 [rad].
        cycles: Least number of fitted oscillations (of the undamped spring).

    Returns:
        Logarithm of the ratio of amplitudes one oscillation apart; only its sign has a meaning for
        motion that ends within a few turning points, or that friction has stopped.
    """
    begin(wall, s, z, stiffness, start, 0.0)
    period, lag = wall.period, wall.lag
    late, held = keep(wall, lag), keep(wall, period - lag)
    cycle = 2.0 * math.pi * math.sqrt(wall.moved / stiffness) / period
    length = min(cycles * cycle + _LEAST_PERIODS + wall.whole + wall.samples, _MOST_PERIODS)
    since = int(_LATE * length)
    frictional = wall.body.coulomb > 0.0
    floor = start * (1.0 / _DECIDED if frictional else _DEAD)
    full = wall.limit - wall.step  # from here on the limit has acted
    least, greatest, before, position = math.inf, 0.0, 0.0, start
    resting, count, k = math.inf, 0, 0
    up = down = stuck = limited = saturating = False
    still = 0.0 if wall.body.behind == 0.0 else _STILL
    while k < length and not (up or down or stuck):
        limited = False
        for _ in range(_SEGMENT):
            command(wall, s, k)
            if lag > 0.0:
                act(wall, s, z, late, k, wall.whole + 1, 0.0, lag)
            act(wall, s, z, held, k, wall.whole, 0.0, period - lag)
            k += 1
            velocity = s[VELOCITY]
            limited = limited or abs(s[TORQUE]) >= full
            if before * velocity < 0.0:
                count += 1
                if count > _SETTLING:
                    # Exact for a light body under one held torque.
                    moved = 0.5 * period * before * before / (before - velocity)
                    amplitude = max(abs(position + moved), _TINY)
                    least, greatest = min(least, amplitude), max(greatest, amplitude)
                    y = math.log(amplitude)
                    _add(s, _WHOLE, k, y)
                    if k >= since:
                        _add(s, _SINCE, k, y)
            if velocity != 0.0:  # a body at rest between two moves keeps the sign of its last one
                before = velocity
            position = s[POSITION]
            if greatest > _DECIDED * start or abs(position) > _FAR * start:
                up = True
                break
        down = least < floor
        # No motion since the last check, longer than the delay: stuck for ever. A load may still
        # swing behind its transmission, and only fades.
        there = motor_position(wall, s, z)
        rests = motor_velocity(wall, s, z) == 0.0 and abs(there - resting) <= still
        stuck = rests and k > 2 * _SEGMENT
        resting, saturating = there, limited
    slope = _slope(s, _WHOLE if frictional else _SINCE) * cycle
    if wall.counts > 0.0 or wall.body.half > 0.0:
        slope = _uneven(s, start, cycle, k)
    if saturating and not slope < -_FADING:
        slope = max(abs(slope), _FADING)
    if math.isnan(slope):  # motion without turning points creeps: away from the wall, or toward it
        slope = 1.0 if abs(there) > start else -1.0
    if up:
        return slope if slope > 0.0 else 1.0
    if down or stuck:
        return slope if slope < 0.0 else -1.0
    return slope


def _uneven(s: Buffer, start: float, cycle: float, periods: int) -> float:
    """Return the growth per oscillation where counts or backlash can sustain a motion.

    Such a motion grows from a smaller kick and decays from a larger one, and soon settles. So late
    amplitudes are compared with the kick, unless they are on their way to its other side.
    """
    slope, window = _slope(s, _SINCE), (1.0 - _LATE) * periods
    number = s[_SINCE]
    if number == 0.0:
        return math.nan
    from_kick = s[_SINCE + 3] / number - math.log(start)
    # Steady motion beats a little: a motion that would not return soon counts as settled.
    back = max(abs(from_kick) / _SOON, _CHANGES) / window
    sure = abs(slope) > _SURE * _slope_error(s, _SINCE)
    if from_kick * slope < 0.0 and abs(slope) > back and sure:
        return slope * cycle
    return from_kick / periods * cycle


def _add(s: Buffer, line: int, t: float, y: float) -> None:
    """Add a point to a straight line of logarithms of amplitudes over periods."""
    s[line] += 1.0
    s[line + 1] += t
    s[line + 2] += t * t
    s[line + 3] += y
    s[line + 4] += t * y
    s[line + 5] += y * y


def _slope(s: Buffer, line: int) -> float:
    """Return the growth of the logarithm per period; NaN with fewer than 3 points."""
    n, t, tt = s[line], s[line + 1], s[line + 2]
    spread = n * tt - t * t
    if n < 3.0 or spread <= 0.0:
        return math.nan
    return (n * s[line + 4] - t * s[line + 3]) / spread


def _slope_error(s: Buffer, line: int) -> float:
    """Return the standard error of the slope; 0 where there is none."""
    n, t, tt, y, yy = s[line], s[line + 1], s[line + 2], s[line + 3], s[line + 5]
    spread = n * tt - t * t
    if n < 3.0 or spread <= 0.0:
        return 0.0
    slope = _slope(s, line)
    left = (n * yy - y * y) / spread - slope * slope
    return math.sqrt(max(left, 0.0) / (n - 2.0))
