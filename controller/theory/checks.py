"""Checks the theory's arguments: finite, in their domain, broadcastable; errors name them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
IntArray = NDArray[np.int64]

_MOST_SAMPLES = 10_000


def number(name: str, value: ArrayLike) -> FloatArray:
    """Return ``value`` as an array of finite floats.

    Raises:
        ValueError: It is not a number, or not finite.
    """
    try:
        given = np.asarray(value)
        # NumPy would accept text, dates and the real part of complex numbers
        array = given.astype(np.float64, copy=False) if given.dtype.kind in "biufO" else None
    except (TypeError, ValueError, OverflowError):
        array = None
    if array is None:
        raise ValueError(f"{name} must be a number, got {value!r}")
    _require(name, array, np.isfinite(array), "finite")
    return array


def positive(name: str, value: ArrayLike) -> FloatArray:
    """Return ``value`` as an array of finite floats, each > 0.

    Raises:
        ValueError: A value is not.
    """
    array = number(name, value)
    _require(name, array, array > 0, "> 0")
    return array


def not_negative(name: str, value: ArrayLike) -> FloatArray:
    """Return ``value`` as an array of finite floats, each >= 0.

    Raises:
        ValueError: A value is not.
    """
    array = number(name, value)
    _require(name, array, array >= 0, ">= 0")
    return array


def samples(name: str, value: ArrayLike) -> FloatArray:
    """Return ``value`` as an array of whole numbers from 1 to 10 000 (floats, for the arithmetic).

    Raises:
        ValueError: A value is not.
    """
    array = number(name, value)
    _require(name, array, (array >= 1) & (array == np.floor(array)), "a whole number >= 1")
    _require(name, array, array <= _MOST_SAMPLES, f"at most {_MOST_SAMPLES}")
    return array


def scalar(check: Callable[[str, ArrayLike], FloatArray], name: str, value: ArrayLike) -> float:
    """Return ``value`` as one number that passes a check.

    Args:
        check: ``number``, ``positive``, ``not_negative`` or ``samples``.
        name: Name for the message.
        value: The number.

    Raises:
        ValueError: It is an array, or does not pass.
    """
    array = check(name, value)
    if array.ndim:
        raise ValueError(f"{name} must be one number, got {array.size}")
    return float(array)


def broadcast(**arrays: FloatArray) -> list[FloatArray]:
    """Return all arrays in their common shape.

    Raises:
        ValueError: The shapes do not broadcast; the message names each of them.
    """
    try:
        return list(np.broadcast_arrays(*arrays.values()))
    except ValueError:
        shapes = ", ".join(f"{name} {array.shape}" for name, array in arrays.items())
        raise ValueError(f"the shapes must broadcast, got {shapes}") from None


def _require(name: str, array: FloatArray, good: NDArray[np.bool_], wanted: str) -> None:
    if not np.all(good):
        found = array[~good].flat[0] if array.ndim else array
        raise ValueError(f"{name} must be {wanted}, got {float(found):g}")
