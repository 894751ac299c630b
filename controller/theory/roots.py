"""Finds roots in brackets: of many functions at once, and all of one function along a grid."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from haptic_wall.controller.theory.checks import FloatArray

_MOST, _NEAR = 60, 4.5e-16
_GOLDEN, _GOLDEN_STEPS = 0.5 * (5**0.5 - 1.0), 34
_SHALLOW = 0.25
"""Part of the least value by which a parabola must fall below it to be looked into"""


def refined(
    function: Callable[[FloatArray], FloatArray], low: FloatArray, high: FloatArray
) -> FloatArray:
    """Find the zeros between ``low`` and ``high``, where each function becomes positive.

    The method is inverse quadratic interpolation, with bisection where that is not safe.

    Source: Chandrupatla, Advances in Engineering Software 28 (1997).

    Args:
        function: Takes and gives arrays of the shape of ``low``.
        low: Lower ends.
        high: Upper ends.
    """
    one, two = low, high
    at_one, at_two = function(one), function(two)
    share: FloatArray = np.full_like(low, 0.5)
    point = low
    for _ in range(_MOST):
        point = one + share * (two - one)
        value = function(point)
        same = (value > 0) == (at_one > 0)
        three, at_three = np.where(same, one, two), np.where(same, at_one, at_two)
        two, at_two = np.where(same, two, one), np.where(same, at_two, at_one)
        one, at_one = point, value
        closest = np.where(np.abs(at_two) < np.abs(at_one), two, one)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            least = _NEAR * np.abs(closest) / np.abs(two - one)
            if np.all((least > 0.5) | (value == 0)):
                break
            ease, lift = (one - two) / (three - two), (at_one - at_two) / (at_three - at_two)
            curved = (lift**2 < ease) & ((1.0 - lift) ** 2 < 1.0 - ease)
            inverse = at_one / (at_two - at_one) * at_three / (at_two - at_three) + (
                three - one
            ) / (two - one) * at_one / (at_three - at_one) * at_two / (at_three - at_two)
        share = np.where(curved & np.isfinite(inverse), inverse, 0.5)
        least = np.minimum(least, 0.5)
        share = np.where(value == 0, 0.0, np.clip(share, least, 1.0 - least))
    return point


def zeros(function: Callable[[FloatArray], FloatArray], grid: FloatArray) -> FloatArray:
    """Find where one function changes its sign between neighbours of a grid.

    Args:
        function: Takes and gives arrays of one axis; NaN where unknown, which is no sign change.
        grid: Rising.
    """
    value = function(grid)
    known = np.isfinite(value[1:]) & np.isfinite(value[:-1])
    cell = np.flatnonzero(known & ((value[1:] > 0) != (value[:-1] > 0)))
    sign = np.where(value[cell + 1] > 0, 1.0, -1.0)
    return refined(lambda x: sign * function(x), grid[cell], grid[cell + 1])


def dips(
    function: Callable[[FloatArray], FloatArray], grid: FloatArray, value: FloatArray
) -> FloatArray:
    """Find where magnitudes are least between points of equal sign: two zeros may lie beside it.

    Added to the grid, such a point separates them. Where the parabola through three points stays
    well away from zero, none is looked for.

    Args:
        function: Takes and gives arrays of settings × points.
        grid: Rising, settings × points.
        value: The function's values on the grid.

    Returns:
        Points, settings × the largest number of points; a setting with fewer repeats its first.
    """
    size, sign = np.abs(value), value > 0
    same = (sign[:, 1:-1] == sign[:, :-2]) & (sign[:, 1:-1] == sign[:, 2:])
    dip = same & (size[:, 1:-1] < size[:, :-2]) & (size[:, 1:-1] <= size[:, 2:])
    row, at = np.nonzero(dip)
    left, middle, right = grid[row, at], grid[row, at + 1], grid[row, at + 2]
    a, b, c = size[row, at], size[row, at + 1], size[row, at + 2]
    before, after = middle - left, right - middle
    with np.errstate(divide="ignore", invalid="ignore"):
        falls, rises = (b - a) / before, (c - b) / after
        bend = (rises - falls) / (before + after)
        slope = falls + bend * before
        deep = slope**2 > 4.0 * _SHALLOW * b * bend
    dip[row[~deep], at[~deep]] = False
    most = int(np.max(np.count_nonzero(dip, axis=1), initial=0))
    at = 1 + np.argsort(~dip, axis=1, kind="stable")[:, :most]
    rows = np.arange(grid.shape[0])[:, None]
    at = np.where(dip[rows, at - 1], at, at[:, :1])
    low, high, side = grid[rows, at - 1], grid[rows, at + 1], np.sign(value[rows, at])
    return golden(lambda w: -side * function(w), low, high, _GOLDEN_STEPS) if most else low


def golden(
    function: Callable[[FloatArray], FloatArray], low: FloatArray, high: FloatArray, steps: int
) -> FloatArray:
    """Return where functions of one maximum have it, by golden sections.

    Args:
        function: Takes and gives arrays of the shape of ``low``.
        low: Lower ends.
        high: Upper ends.
        steps: Evaluations; each divides the brackets by 1.618.
    """
    left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    at_left, at_right = function(left), function(right)
    for _ in range(steps):
        lower = at_left > at_right
        low, high = np.where(lower, low, left), np.where(lower, right, high)
        point = np.where(lower, high - _GOLDEN * (high - low), low + _GOLDEN * (high - low))
        value = function(point)
        left, right = np.where(lower, point, right), np.where(lower, left, point)
        at_left, at_right = np.where(lower, value, at_right), np.where(lower, at_left, value)
    result: FloatArray = 0.5 * (low + high)
    return result
