"""Where, and by how much, the linear condition errs: the points of the paper's Fig. 10."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from haptic_wall.controller.theory.boundary import critical, max_beta
from haptic_wall.controller.theory.checks import (
    FloatArray,
    broadcast,
    not_negative,
    number,
    positive,
    scalar,
)
from haptic_wall.controller.theory.roots import zeros

_POINTS = 1024
_START = 1e-6  # share of the boundary's damping range from which on it is looked at


class ErrorPoint(NamedTuple):
    """Where on a boundary the linear condition errs by a given part."""

    beta: float
    """B T / m"""
    alpha: float
    """K T² / m, on the exact boundary"""
    error: float
    """The exact limit over the line's, minus one: below 0 the line is unsafe"""


def linear_error(delta: ArrayLike, beta: ArrayLike, delay: ArrayLike) -> FloatArray:
    """The exact limit over that of the linear condition, minus one.

    Below 0 the line promises too much; -1 where no stiffness is stable although the line names one.

    Args:
        delta: Viscous damping b T / m >= 0.
        beta: Virtual damping B T / m > -delta.
        delay: d >= 0 [periods].

    Returns:
        The error, not in percent, in the broadcast shape.

    Raises:
        ValueError: An argument is outside of its domain; the message names it.

    Source: Gil et al., ICRA 2007, Fig. 10.
    """
    small, virtual, d = broadcast(
        delta=not_negative("delta", delta),
        beta=number("beta", beta),
        delay=not_negative("delay", delay),
    )
    if not np.all(virtual > -small):
        raise ValueError("beta must be above -delta: below it the line names no stiffness")
    flat = np.ravel(virtual)
    error = _error(np.ravel(small), flat, np.ravel(d))
    result: FloatArray = error.reshape(virtual.shape)[()]
    return result


def error_points(delta: float, delay: float, error: float) -> tuple[ErrorPoint, ...]:
    """All the points of one boundary where the linear condition errs by ``error``, either way.

    With light damping there is one, with the exact limit below the line. With more damping and
    delay the boundary starts above the line, and the error can pass ``+error`` first and ``-error``
    after it; or it never is as little as that at the start.

    Args:
        delta: Viscous damping b T / m >= 0.
        delay: d >= 0 [periods].
        error: The error looked for, > 0, not in percent: 0.02 for 2 %.

    Returns:
        The points by rising beta, each with the sign of its error.

    Raises:
        ValueError: An argument is outside of its domain; the message names it.

    Source: Gil et al., ICRA 2007, Fig. 10.
    """
    size = scalar(positive, "error", error)
    small = np.array([scalar(not_negative, "delta", delta)])
    d = np.array([scalar(not_negative, "delay", delay)])
    width = max_beta(small, d, np.ones(1)) + small

    def excess(share: FloatArray, level: FloatArray | float) -> FloatArray:
        ones = np.ones_like(share)
        return _error(small * ones, width * share - small, d * ones) - level

    # denser towards the start, where the error changes as the damping does
    share = np.linspace(np.sqrt(_START), 1.0, _POINTS) ** 2
    points = []
    for level in (-size, size):
        found = zeros(lambda s, level=level: excess(s, level), share[:-1])  # type: ignore[misc]
        beta = width * found - small
        alpha, _ = critical(
            np.repeat(small, beta.size), beta, np.repeat(d, beta.size), np.ones_like(beta)
        )
        points += [
            ErrorPoint(*pair, level) for pair in zip(beta.tolist(), alpha.tolist(), strict=True)
        ]
    return tuple(sorted(points))


def start_error(delta: float, delay: float) -> float:
    """The error where the boundary starts, next to beta = -delta.

    Args:
        delta: Viscous damping b T / m >= 0.
        delay: d >= 0 [periods].

    Raises:
        ValueError: An argument is outside of its domain; the message names it.
    """
    small = np.array([scalar(not_negative, "delta", delta)])
    d = np.array([scalar(not_negative, "delay", delay)])
    width = max_beta(small, d, np.ones(1)) + small
    return float(_error(small, _START * width - small, d)[0])


def _error(delta: FloatArray, beta: FloatArray, delay: FloatArray) -> FloatArray:
    alpha, _ = critical(delta, beta, delay, np.ones_like(beta))
    error: FloatArray = alpha * (1.0 + 2.0 * delay) / (2.0 * (delta + beta)) - 1.0
    return error
