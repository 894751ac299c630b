"""What the theory accepts: finite numbers in their domain, broadcast; errors name the argument."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


def number(name: str, value: ArrayLike) -> FloatArray:
    """``value`` as an array of finite floats.

    Raises:
        ValueError: It is not a number, or not finite.
    """
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be a number, got {value!r}") from None
    _require(name, array, np.isfinite(array), "finite")
    return array


def positive(name: str, value: ArrayLike) -> FloatArray:
    """``value`` as an array of finite floats, each > 0.

    Raises:
        ValueError: One is not.
    """
    array = number(name, value)
    _require(name, array, array > 0, "> 0")
    return array


def not_negative(name: str, value: ArrayLike) -> FloatArray:
    """``value`` as an array of finite floats, each >= 0.

    Raises:
        ValueError: One is not.
    """
    array = number(name, value)
    _require(name, array, array >= 0, ">= 0")
    return array


def samples(name: str, value: ArrayLike) -> FloatArray:
    """``value`` as an array of whole numbers, each >= 1 (kept as floats for the arithmetic).

    Raises:
        ValueError: One is not.
    """
    array = number(name, value)
    _require(name, array, (array >= 1) & (array == np.floor(array)), "a whole number >= 1")
    return array


def whole_number(name: str, value: ArrayLike) -> int:
    """``value`` as one whole number >= 0.

    Raises:
        ValueError: It is not.
    """
    array = number(name, value)
    _require(name, array, (array >= 0) & (array == np.floor(array)), "a whole number >= 0")
    return int(array)


def broadcast(**arrays: FloatArray) -> list[FloatArray]:
    """All arrays in their common shape.

    Raises:
        ValueError: They have none; the message names every shape.
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
