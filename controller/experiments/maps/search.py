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

_FIRST: Final = 0.55
"""First stiffness that is tried, in units of the guess"""
_STEP: Final = 1.16
"""Ratio of stiffnesses that are tried until the motion grows at one and not at its neighbour"""
_SOFTEST: Final = 1e-4
"""Ends of the search in units of m/T²: an oscillation of 600 samples, and more than any wall
without friction can have"""
_STIFFEST: Final = 20.0
_CYCLES: Final = 20.0
"""Oscillations to which the growth is fitted"""
_NEAR: Final = 0.45
"""Distance of a tried stiffness from the interpolated limit, in units of the tolerance"""
_SHARE: Final = 0.9
"""Fraction of the torque limit for the spring alone: its damper needs some too. With half of it
friction stops motion that a run shows to grow"""
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


def grown(wall: Wall, s: Buffer, z: Buffer, stiffness: float, kick: float) -> float:
    """Return the growth at a stiffness; > 0: the motion grows."""
    start = unsaturated(wall, stiffness, kick)
    if wall.one_sided:
        return returned(wall, s, z, stiffness, start)
    return growth(wall, s, z, stiffness, start, _CYCLES)


def onset(wall: Wall, s: Buffer, z: Buffer, kick: float, guess: float, tolerance: float) -> float:
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
    k, tries = _FIRST * max(guess, softest), 0
    while high > low * (1.0 + tolerance):
        now = grown(wall, s, z, k, kick)
        if now > 0.0:
            high, at_high = k, now
        else:
            low, at_low = k, now
        if high == math.inf:
            if low >= stiffest:
                return math.inf
            k = low * _STEP
        elif low == 0.0:
            if high <= softest:
                return 0.0
            k = high / _STEP
        else:  # on one side of the interpolated limit, on the other, and in the middle
            k = between(low, high, at_low, at_high) * (
                1.0 + _NEAR * tolerance * (2 * (tries % 2) - 1)
            )
            if tries % 3 == 2 or not low < k < high:
                k = math.sqrt(low * high)
            tries += 1
    return between(low, high, at_low, at_high)


def between(low: float, high: float, at_low: float, at_high: float) -> float:
    """Return the stiffness with zero interpolated growth."""
    at_low = min(at_low, 0.0)
    return low + (high - low) * -at_low / (at_high - at_low)
