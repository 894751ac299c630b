"""Finds the positive roots of many polynomials at once: isolated by Bernstein coefficients.

With v = u / (1 - u) a polynomial in v > 0 is one in 0 < u < 1, whose Bernstein coefficients are
those of v over the binomial coefficients. Their changes of sign bound the number of roots in an
interval (Descartes): none or one are certain, and an interval with more is halved.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from haptic_wall.controller.theory.checks import FloatArray, IntArray

_HALVINGS = 40
"""Intervals of u are not halved more often: two roots as close are none"""
_ROUNDS = 60
"""Most steps of Newton's method, kept in its bracket by halving"""
_CLOSE = 1e-9
"""Relative step at which a root is found"""
_DONE = 0.3
"""Share of found roots from which on only the others go on"""


class Roots(NamedTuple):
    """Roots of all polynomials, one behind the other."""

    row: IntArray
    """Index of the polynomial"""
    at: FloatArray
    """The root, > 0"""


def positive_roots(rising: FloatArray) -> Roots:
    """Return the positive roots at which a polynomial changes its sign.

    Args:
        rising: Coefficients of rising powers, polynomials × powers; degree >= 1.

    Source: Descartes' rule of signs in Bernstein's basis (Lane and Riesenfeld 1981).
    """
    degree = rising.shape[1] - 1
    binomial = np.array([float(math.comb(degree, k)) for k in range(degree + 1)])
    # the variable is scaled so that first and last coefficient are alike
    first, last = np.abs(rising[:, 0]), np.abs(rising[:, -1])
    usable = (first > 0) & (last > 0)
    scale = np.where(usable, first / np.where(usable, last, 1.0), 1.0) ** (1.0 / degree)
    b = (rising * scale[:, None] ** np.arange(degree + 1) / binomial).T.copy()
    row, low, high = np.arange(len(rising)), np.zeros(len(rising)), np.ones(len(rising))
    found: list[tuple[IntArray, FloatArray, FloatArray, FloatArray]] = []
    for halving in range(_HALVINGS + 1):
        negative = b < 0.0
        changes = (negative[1:] != negative[:-1]).sum(axis=0)
        one = changes == 1 if halving < _HALVINGS else changes % 2 == 1
        if one.any():
            found.append((row[one], low[one], high[one], b[:, one]))
        more = np.flatnonzero(changes > 1)
        if more.size == 0 or halving == _HALVINGS:
            break
        left, right = _halves(b[:, more])
        row, low, high = row[more], low[more], high[more]
        middle = 0.5 * (low + high)
        b = np.concatenate([left, right], axis=1)
        row = np.concatenate([row, row])
        low, high = np.concatenate([low, middle]), np.concatenate([middle, high])
    if not found:
        return Roots(np.empty(0, dtype=np.int64), np.empty(0))
    row, low, high, b = (np.concatenate(part, axis=-1) for part in zip(*found, strict=True))
    share = _root(b * binomial[:, None], _guess(b))
    above = (1.0 - high) + (high - low) / (1.0 + share)
    below = low + (high - low) * (share / (1.0 + share))
    return Roots(row, below / above * scale[row])


def _halves(b: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the coefficients of both halves of the interval, coefficients × polynomials.

    Source: de Casteljau's algorithm.
    """
    left, right = np.empty_like(b), b.copy()
    left[0] = right[0]
    for k in range(1, len(b)):
        right[:-k] = 0.5 * (right[:-k] + right[1 : len(b) - k + 1])
        left[k] = right[0]
    return left, right


def _guess(b: FloatArray) -> FloatArray:
    """Return u / (1 - u) where the coefficients, joined by lines over u from 0 to 1, are 0."""
    after = np.argmax((b[1:] < 0.0) != (b[:-1] < 0.0), axis=0)
    every = np.arange(b.shape[1])
    left, right = b[after, every], b[after + 1, every]
    share = (after + left / (left - right)) / (len(b) - 1)
    found: FloatArray = np.clip(share, 1e-12, None) / np.clip(1.0 - share, 1e-12, None)
    return found


def _root(rising: FloatArray, at: FloatArray) -> FloatArray:
    """Return the one positive root of polynomials whose coefficients change sign once.

    Args:
        rising: Coefficients of rising powers, powers × polynomials.
        at: A guess for each, > 0.
    """
    degree, count = len(rising) - 1, rising.shape[1]
    found, index = np.ones(count), np.arange(count)
    low, high = np.zeros(count), np.full(count, np.inf)
    begin = rising[0] < 0.0
    for _ in range(_ROUNDS):
        value, slope = rising[degree], np.zeros_like(at)
        with np.errstate(over="ignore", invalid="ignore"):
            for k in range(degree - 1, -1, -1):
                slope = slope * at + value
                value = value * at + rising[k]
        before = (value < 0.0) == begin
        low, high = np.where(before, at, low), np.where(before, high, at)
        with np.errstate(divide="ignore", invalid="ignore"):
            then = at - value / slope
        done = np.abs(then - at) <= _CLOSE * at
        inside = (then > low) & (then < high)
        middle = np.where(np.isinf(high), 4.0 * at, np.sqrt(low * high))
        at = np.where(inside | done, then, np.where(middle > 0.0, middle, 0.25 * high))
        if done.sum() > _DONE * done.size:
            found[index] = at
            left = ~done
            index, at, low, high = index[left], at[left], low[left], high[left]
            rising, begin = rising[:, left], begin[left]
            if index.size == 0:
                break
    found[index] = at
    return found
