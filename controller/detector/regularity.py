"""Judges whether amplitudes grow, or stay, more regularly than a hand can make them.

Amplitudes are natural logarithms, one per half-cycle, in order. The functions are called only at
the end of a streak of half-cycles, so that most ticks do not need them.
"""

from __future__ import annotations

import math
from collections import deque
from itertools import islice
from typing import NamedTuple

_NONE = 5e-4
"""Negligible loss per half-cycle."""
_BOUNCES, _BOUNCED, _BACK = 12, 0.25, 0.01
"""Half-cycles of bouncing, the growth over them, and the tolerated loss from one bounce to the next
"""


class Line(NamedTuple):
    """A straight line through equidistant values."""

    slope: float
    """Change from one value to the next"""
    scatter: float
    """Root mean square of the residuals"""
    error: float
    """Standard error of the slope"""


def line(values: deque[float], n: int) -> Line:
    """Fit a straight line to the last n >= 3 values."""
    last = list(islice(values, len(values) - n, None))
    middle, mean = 0.5 * (n - 1), sum(last) / n
    spread = n * (n * n - 1.0) / 12.0
    slope = sum((i - middle) * value for i, value in enumerate(last)) / spread
    left = sum((value - mean - slope * (i - middle)) ** 2 for i, value in enumerate(last))
    return Line(slope, math.sqrt(left / n), math.sqrt(left / (n * spread)))


def grows_evenly(
    sizes: deque[float],
    rules: tuple[tuple[int, float], ...],
    streak: int,
    least: float,
    allowed: float,
) -> bool:
    """Whether the amplitude grows along a straight line.

    Args:
        sizes: Amplitudes.
        rules: Numbers of half-cycles, ascending, and the growth over so many that is enough.
        streak: HalfCycleSums that may be looked at.
        least: Smallest amplitude from which growth is told.
        allowed: Largest scatter.
    """
    for half_cycles, growth in rules:
        if streak < half_cycles:
            return False
        if sizes[-half_cycles] > least:
            found = line(sizes, half_cycles)
            if found.slope * half_cycles > growth and found.scatter < allowed:
                return True
    return False


def goes_on(sizes: deque[float], allowed: float) -> bool:
    """Whether all the amplitudes are equal, or grow; ``allowed``: largest scatter."""
    found = line(sizes, len(sizes))
    return found.slope > -2.0 * found.error - _NONE and found.scatter < allowed


def bounces_grow(sizes: deque[float], streak: int) -> bool:
    """Whether each bounce off a wall that never pulls is higher than the one before, or as high.

    Every other half-cycle is compared, because the way out of the wall equals the way back. The
    contact begins at another phase of the period each time, so that the growth is not as even as
    that of an oscillation.
    """
    if streak < _BOUNCES or len(sizes) <= _BOUNCES:
        return False
    last = list(islice(sizes, len(sizes) - _BOUNCES - 1, None))
    pairs = zip(last, last[2:], strict=False)
    return last[-1] - last[0] > _BOUNCED and all(then - now > -_BACK for now, then in pairs)
