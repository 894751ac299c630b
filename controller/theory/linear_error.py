"""Computes the error of the linear condition along the boundary: points of the paper's Fig. 10."""

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
_START = 1e-6  # fraction of the boundary's damping range at which the search starts


class ErrorPoint(NamedTuple):
    """Point on a boundary where the linear condition has a given error."""

    beta: float
    """B T / m"""
    alpha: float
    """K T² / m, on the exact boundary"""
    error: float
    """The exact limit over the linear one, minus one: below 0 the linear one is unsafe"""


def linear_error(delta: ArrayLike, beta: ArrayLike, delay: ArrayLike) -> FloatArray:
    """Return the exact limit over the linear one, minus one.

    Below 0 the linear limit is too high; it is -1 where no stiffness is stable although the linear
    limit is positive.

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
    """Return the error where the boundary starts, next to beta = -delta.

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
