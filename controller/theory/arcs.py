"""Finds the least extent of an admittance 1 / (R + j X) in a direction, over ranges of R and X.

The admittance stays in a region between four circular arcs, one for each bound. The extent is a
harmonic function there, so its least value lies on the boundary: where an arc touches a line across
the direction, or at a corner.
"""

from __future__ import annotations

import numpy as np

from haptic_wall.controller.theory.checks import ComplexArray, FloatArray


def least_reach(
    a: ComplexArray, r: tuple[float, float], low: FloatArray, high: FloatArray
) -> FloatArray:
    """Return the least Re(a / (R + j X)) over R in ``r`` and X from low to high.

    Args:
        a: The direction, times the length that one unit of admittance stands for.
        r: Least and greatest R, > 0.
        low: Least X.
        high: Greatest X.
    """
    size = np.abs(a)
    least = np.full(np.broadcast_shapes(a.shape, low.shape), np.inf)
    for resistance in r:
        for x in (low, high):
            least = np.minimum(least, np.real(a / (resistance + 1j * x)))
        at = -resistance * _cotangent(a)
        touched = (low < at) & (at < high)
        least = np.where(touched, np.minimum(least, (np.real(a) - size) / (2 * resistance)), least)
    for x in (low, high):
        sign = np.where(x < 0, -1.0, 1.0)
        turned = -1j * sign * a
        divisor = np.maximum(np.abs(x), 1e-300)
        at = sign * divisor * _cotangent(turned)
        touched = (r[0] < at) & (at < r[1])
        least = np.where(
            touched, np.minimum(least, (np.real(turned) - size) / (2 * divisor)), least
        )
    return least


def _cotangent(a: ComplexArray) -> FloatArray:
    """Return cot(arg(a) / 2) = (|a| + Re a) / Im a."""
    half = np.tan(np.angle(a) / 2)
    result: FloatArray = 1 / np.where(half == 0, 1e-300, half)
    return result
