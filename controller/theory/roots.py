"""Bracketed roots of many functions at once: bisection, then false position (Illinois)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from controller.theory.checks import FloatArray

_HALVINGS = 127
_BISECTIONS, _STEPS = 12, 28  # false position converges in five or six, once it is near


def refined(
    function: Callable[[FloatArray], FloatArray], low: FloatArray, high: FloatArray
) -> FloatArray:
    """The zeros between ``low`` and ``high``, where each function turns from negative to positive.

    Where a bracket begins at 0 the function may vanish there too, and the zero can be of any size:
    the power of two is found first.

    Args:
        function: Takes and gives arrays of the shape of ``low``.
        low: Lower ends, >= 0.
        high: Upper ends.
    """
    if np.any(low == 0):
        low, high = _from_zero(function, low, high)
    at_low, at_high = np.zeros_like(low), np.zeros_like(low)
    last = np.zeros_like(low)  # which end moved last: -1 low, 1 high
    point = low
    for step in range(_STEPS):
        point = 0.5 * (low + high)
        if step > _BISECTIONS:
            slope = at_high - at_low
            usable = (low > 0) & (slope > 0)
            cut = low - at_low * (high - low) / np.where(usable, slope, 1.0)
            point = np.where(usable, np.clip(cut, low, high), point)
        value = function(point)
        beyond = value > 0
        moved = np.where(beyond, 1.0, -1.0)
        again = moved == last
        at_low = np.where(beyond, np.where(again, 0.5 * at_low, at_low), value)
        at_high = np.where(beyond, value, np.where(again, 0.5 * at_high, at_high))
        low, high = np.where(beyond, low, point), np.where(beyond, point, high)
        last = moved
    return point


def _from_zero(
    function: Callable[[FloatArray], FloatArray], low: FloatArray, high: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Brackets that begin at 0 cut to a factor of two around the zero; the others as they are."""
    above, below = np.zeros(low.shape), np.full(low.shape, float(_HALVINGS))
    for _ in range(_HALVINGS.bit_length()):
        middle = np.floor(0.5 * (above + below))
        beyond = function(np.where(low == 0, high * 0.5**middle, high)) > 0
        above, below = np.where(beyond, middle, above), np.where(beyond, below, middle)
    return np.where(low == 0, high * 0.5**below, low), np.where(low == 0, high * 0.5**above, high)
