"""Finds points of the boundary where the linear condition errs by a given amount (Fig. 10)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from haptic_wall.controller.theory import critical_stiffness, max_virtual_damping
from haptic_wall.controller.theory.checks import FloatArray, not_negative, positive, scalar
from haptic_wall.controller.theory.roots import zeros

_POINTS = 1024
_START = 1e-6  # fraction of the boundary's damping range at which the search starts


class ErrorPoint(NamedTuple):
    """Point on a boundary where the linear condition has a given error."""

    beta: float
    """B T / m"""
    alpha: float
    """K T² / m, on the exact boundary"""
    error: float
    """The exact limit over the linear one, minus one: below 0 the linear one is unsafe"""


def error_points(delta: float, delay: float, error: float) -> tuple[ErrorPoint, ...]:
    """Return all points of one boundary where the linear condition errs by ``error``, either way.

    With light damping there is one, with the exact limit below the linear one. With more damping
    and delay the boundary starts above it, and the error can pass ``+error`` first and ``-error``
    later; or it is greater than ``error`` from the start.

    Args:
        delta: Viscous damping b T / m >= 0.
        delay: d >= 0 [periods].
        error: The error to find, > 0, not in percent: 0.02 for 2 %.

    Returns:
        The points by rising beta, each with the sign of its error.

    Raises:
        ValueError: An argument is outside of its domain; the message names it.

    Source: Gil et al., ICRA 2007, Fig. 10.
    """
    size = scalar(positive, "error", error)
    small = np.array([scalar(not_negative, "delta", delta)])
    d = np.array([scalar(not_negative, "delay", delay)])
    width = max_virtual_damping(1.0, small, 1.0, d) + small

    def excess(share: FloatArray, level: FloatArray | float) -> FloatArray:
        ones = np.ones_like(share)
        return _error(small * ones, width * share - small, d * ones) - level

    # denser towards the start, where the error changes as the damping does
    share = np.linspace(np.sqrt(_START), 1.0, _POINTS) ** 2
    points = []
    for level in (-size, size):
        found = zeros(lambda s, level=level: excess(s, level), share[:-1])  # type: ignore[misc]
        beta = width * found - small
        alpha = critical_stiffness(1.0, small, beta, 1.0, d)
        points += [
            ErrorPoint(*pair, level) for pair in zip(beta.tolist(), alpha.tolist(), strict=True)
        ]
    return tuple(sorted(points))


def _error(delta: FloatArray, beta: FloatArray, delay: FloatArray) -> FloatArray:
    alpha = critical_stiffness(1.0, delta, beta, 1.0, delay)
    error: FloatArray = alpha * (1.0 + 2.0 * delay) / (2.0 * (delta + beta)) - 1.0
    return error
