"""Arithmetic of many polynomials at once: arrays of polynomials × coefficients of rising powers."""

from __future__ import annotations

import math
from typing import TypeVar

import numpy as np

from haptic_wall.controller.theory.checks import ComplexArray, FloatArray, IntArray

_Rows = TypeVar("_Rows", FloatArray, ComplexArray)


def in_s(rising: FloatArray) -> FloatArray:
    """Return p(delta) (1 - s)^n in powers of s, for delta = 2 s / (1 - s) and p of degree n."""
    n = rising.shape[1] - 1
    powers = np.zeros((n + 1, n + 1))
    for k in range(n + 1):
        powers[k, k:] = 2.0**k * power(-1, n - k)
    found: FloatArray = rising @ powers
    return found


def power(sign: int, n: int) -> FloatArray:
    """Return the coefficients of (1 + sign s)^n, rising."""
    return np.array([math.comb(n, k) * float(sign) ** k for k in range(n + 1)])


def circle(n: int) -> FloatArray:
    """Return the coefficients of (1 + v)^n, rising."""
    return power(1, n)[None]


def even(rising: FloatArray) -> FloatArray:
    """Return the real part of p(j t) in powers of v = t²."""
    part = rising[:, ::2]
    return part * (-1.0) ** np.arange(part.shape[1])


def odd(rising: FloatArray) -> FloatArray:
    """Return the imaginary part of p(j t), over t, in powers of v = t²."""
    part = rising[:, 1::2]
    return part * (-1.0) ** np.arange(part.shape[1])


def times(a: _Rows, b: _Rows) -> _Rows:
    """Return the products of polynomials, row by row; one row stands for all."""
    if len(b) > 1:
        a, b = b, a
    size = a.shape[1] + b.shape[1] - 1
    if len(b) == 1 < len(a):
        shifted = np.zeros((a.shape[1], size), dtype=b.dtype)
        for i in range(a.shape[1]):
            shifted[i, i : i + b.shape[1]] = b[0]
        product: _Rows = a @ shifted
        return product
    found = np.zeros((len(a), size), dtype=a.dtype)
    for i in range(a.shape[1]):
        found[:, i : i + b.shape[1]] += a[:, i, None] * b
    return found


def plus(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the sums of polynomials of unlike degree."""
    a, b = np.atleast_2d(a), np.atleast_2d(b)
    found = np.zeros((max(len(a), len(b)), max(a.shape[1], b.shape[1])))
    found[:, : a.shape[1]] += a
    found[:, : b.shape[1]] += b
    return found


def right_roots(rising: FloatArray) -> IntArray:
    """Return how many roots of polynomials have a positive real part.

    Where some lie on the imaginary axis the count is arbitrary.

    Source: Routh's array.
    """
    above, row = rising[:, ::-2], rising[:, -2::-2]
    count = np.zeros(len(rising), dtype=np.int64)
    while row.shape[1]:
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = above[:, :1] / row[:, :1]
        count += (above[:, 0] < 0) != (row[:, 0] < 0)
        next_row = above[:, 1:].copy()
        next_row[:, : row.shape[1] - 1] -= ratio * row[:, 1:]
        above, row = row, next_row
    return count
