"""Judges whether amplitudes grow, or stay, more regularly than a hand can make them.

Amplitudes are natural logarithms, one per half-cycle, in order. The functions are called only at
the end of a streak of half-cycles, so that most ticks do not need them.
"""

from __future__ import annotations

import math
from collections import deque
from itertools import islice
from typing import NamedTuple

from haptic_wall.controller.detector.tuning import BeliefTuning, Rules


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
    rules: Rules,
    streak: int,
    least: float,
    allowed: float,
) -> bool:
    """Whether the amplitude grows along a straight line.

    Args:
        sizes: Amplitudes.
        rules: Numbers of half-cycles, ascending, and the growth over so many that is enough.
        streak: HalfCycleSums that may be looked at.
        least: Smallest amplitude at which growth is judged.
        allowed: Largest scatter.
    """
    for count, growth in rules:
        if streak < count:
            return False
        if sizes[-count] > least:
            found = line(sizes, count)
            if found.slope * count > growth and found.scatter < allowed:
                return True
    return False


def goes_on(sizes: deque[float], allowed: float, tuning: BeliefTuning) -> bool:
    """Whether all the amplitudes are equal, or grow; ``allowed``: largest scatter."""
    found = line(sizes, len(sizes))
    return found.slope > -2.0 * found.error - tuning.no_loss and found.scatter < allowed


def bounces_grow(sizes: deque[float], streak: int, tuning: BeliefTuning) -> bool:
    """Whether each bounce off a wall that never pulls is higher than the one before, or as high.

    Every other half-cycle is compared, because the way out of the wall equals the way back. The
    contact begins at another phase of the period each time, so that the growth is not as even as
    that of an oscillation.
    """
    count = tuning.bounces
    if streak < count or len(sizes) <= count:
        return False
    last = list(islice(sizes, len(sizes) - count - 1, None))
    pairs = zip(last, last[2:], strict=False)
    least = -tuning.bounces_back
    return last[-1] - last[0] > tuning.bounces_grown and all(b - a > least for a, b in pairs)
