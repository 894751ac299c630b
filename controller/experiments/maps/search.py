"""Searches the critical stiffness of one wall: above it the motion after a kick grows.

Growth means the amplitude of a two-sided wall's oscillation (``turning``), or the speed that one
contact with a one-sided wall returns (``bounce``). The search repeats between the stiffest that
does not grow and the softest that does, until they are close enough. The functions are plain: see
``loop``.
"""

from __future__ import annotations

import math
from typing import Final

from haptic_wall.controller.experiments.maps.bounce import returned
from haptic_wall.controller.experiments.maps.loop import Wall
from haptic_wall.controller.experiments.maps.turning import growth
from haptic_wall.hw.plant.two_masses import Buffer

_FIRST: Final = (0.55, 2.1, 10)
"""First stiffnesses that are tried, from and to in units of the guess, and their number"""
_REACH: Final = 4.0
"""Factor between searched ranges while no limit is found"""
_SPREAD: Final = 5
"""Number of stiffnesses tried in such a range, and between the first two known ones"""
_SOFTEST: Final = 1e-4
"""Ends of the search in units of m/T²: an oscillation of 600 samples, and more than any wall
without friction can have"""
_STIFFEST: Final = 20.0
_CYCLES_COARSE: Final = 8.0
_CYCLES: Final = 20.0
_COARSE: Final = 1.3
"""Ratio of the two stiffnesses below which the growth is fitted precisely"""
_NEAR: Final = 0.45
"""Distance of a tried stiffness from the interpolated limit, in units of the tolerance"""
_SHARE: Final = 0.5
"""Fraction of the torque limit for the spring alone: its damper needs some too"""
_COUNTS: Final = 4.0
"""Smallest motion that the encoder resolves [counts]"""


def unsaturated(wall: Wall, stiffness: float, kick: float) -> float:
    """Return the kick, or the largest one at which the spring does not saturate [rad].

    A torque limit makes a wall softer to large motion, so that such motion decays to where the
    limit hardly matters; the question is whether it grows from there. The result is at least four
    counts of the encoder and the backlash.
    """
    least = 2.0 * wall.body.half
    if wall.counts > 0.0:
        least += _COUNTS / wall.counts
    return min(kick, max(_SHARE * wall.limit / stiffness, least))


def grown(wall: Wall, s: Buffer, z: Buffer, stiffness: float, kick: float, cycles: float) -> float:
    """Return the growth at a stiffness; > 0: the motion grows."""
    start = unsaturated(wall, stiffness, kick)
    if wall.one_sided:
        return returned(wall, s, z, stiffness, start)
    return growth(wall, s, z, stiffness, start, cycles)


def onset(  # noqa: PLR0912 - one search
    wall: Wall, s: Buffer, z: Buffer, kick: float, guess: float, tolerance: float
) -> float:
    """Return the stiffness above which the motion grows [N·m/rad].

    Args:
        wall: The wall.
        s: The simulation's buffer.
        z: The state of ``two_masses``.
        kick: > 0 [rad].
        guess: Where to look first [N·m/rad]; 0: there is no guess.
        tolerance: Wanted relative accuracy.

    Returns:
        0 if it grows at the softest wall tried, inf if it does not at the stiffest.
    """
    unit = wall.moved / (wall.period * wall.period)
    softest, stiffest = _SOFTEST * unit, _STIFFEST * unit
    if guess > 0.0:
        softest = min(softest, 0.5 * guess)
    low, high, at_low, at_high = 0.0, math.inf, -1.0, 1.0
    first, last, count = _FIRST
    begin, end = first * max(guess, softest), last * max(guess, softest)
    while True:
        for i in range(count):
            k = begin * math.pow(end / begin, i / (count - 1.0))
            now = grown(wall, s, z, k, kick, _CYCLES)
            if now > 0.0:
                high, at_high = k, now
                break
            low, at_low = k, now
        if high == math.inf and low < stiffest:
            begin, end = low * math.pow(_REACH, 1.0 / _SPREAD), low * _REACH
        elif low == 0.0 and high > softest:
            begin, end = high / _REACH, high / math.pow(_REACH, 1.0 / _SPREAD)
        else:
            break
        count = _SPREAD
    if high == math.inf or low == 0.0:
        return high if low > 0.0 else 0.0
    if wall.counts > 0.0 or not wall.body.smooth:  # then the growth may rise and fall with K
        begin, end = low, high
        for i in range(_SPREAD):
            k = begin * math.pow(end / begin, (i + 1.0) / (_SPREAD + 1.0))
            now = grown(wall, s, z, k, kick, _CYCLES)
            if now > 0.0:
                high, at_high = k, now
                break
            low, at_low = k, now
    while high > low * (1.0 + tolerance):
        ratio = high / low
        cycles = _CYCLES_COARSE if ratio > _COARSE else _CYCLES
        middle = between(low, high, at_low, at_high)
        for i in range(3):
            k = middle * (1.0 + _NEAR * tolerance * (2 * i - 1))
            if i == 2:  # the limit was not near the interpolated one
                k = math.sqrt(low * high)
                if high / low < math.sqrt(ratio):
                    break
            if low < k < high:
                now = grown(wall, s, z, k, kick, cycles)
                if now > 0.0:
                    high, at_high = k, now
                else:
                    low, at_low = k, now
            if high <= low * (1.0 + tolerance):
                break
    return between(low, high, at_low, at_high)


def between(low: float, high: float, at_low: float, at_high: float) -> float:
    """Return the stiffness with zero interpolated growth."""
    at_low = min(at_low, 0.0)
    return low + (high - low) * -at_low / (at_high - at_low)
