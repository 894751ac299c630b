"""Describing functions: the gain of a nonlinearity for a sinusoid of a given amplitude.

It is the gain of the first harmonic, complex where the nonlinearity lags.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from haptic_wall.controller.theory.checks import (
    ComplexArray,
    FloatArray,
    broadcast,
    positive,
)

_MANY = 1000.0  # counts


def saturation_gain(amplitude: ArrayLike, limit: ArrayLike) -> FloatArray:
    """Return the gain of a torque clipped at ``limit``, for a commanded amplitude ``amplitude``.

    Raises:
        ValueError: An argument is not > 0; the message names it.

    Source: Gelb and Vander Velde, Multiple-Input Describing Functions, 1968, sec. 2.3.
    """
    a, top = broadcast(amplitude=positive("amplitude", amplitude), limit=positive("limit", limit))
    share = np.minimum(top / a, 1.0)
    result: FloatArray = 2 / np.pi * (np.arcsin(share) + share * np.sqrt(1 - share**2))
    return result


def quantisation_gain(
    amplitude: ArrayLike, step: ArrayLike, *, at_edge: bool = False
) -> FloatArray:
    """Return the gain of rounding to counts of ``step``, for a position of amplitude ``amplitude``.

    Centred on the middle of a count it is 0 up to half a count, at most 4/pi, and tends to 1;
    centred on an edge it is infinite for small amplitudes. From 1000 counts up the result is 1,
    exact within 3e-5.

    Raises:
        ValueError: An argument is not > 0; the message names it.

    Source: Gelb and Vander Velde, Multiple-Input Describing Functions, 1968, sec. 2.3.
    """
    a, q = broadcast(amplitude=positive("amplitude", amplitude), step=positive("step", step))
    small = a < _MANY * q
    ratio = np.where(small, q / a, 1.0)[..., None]
    count = np.arange(1, int(np.max(np.where(small, a / q, 0.0), initial=0.0)) + 2)
    thresholds = count if at_edge else count - 0.5
    edges = np.sqrt(np.maximum(1 - (thresholds * ratio) ** 2, 0.0)).sum(axis=-1)
    gain = 4 * q / (np.pi * a) * (edges + (0.5 if at_edge else 0.0))
    result: FloatArray = np.where(small, gain, 1.0)[()]
    return result


def backlash_gain(amplitude: ArrayLike, width: ArrayLike) -> ComplexArray:
    """Return the complex gain of a backlash of full width ``width``; 0 for motion within it.

    Raises:
        ValueError: An argument is not > 0; the message names it.

    Source: Gelb and Vander Velde, Multiple-Input Describing Functions, 1968, sec. 2.3.
    """
    a, w = broadcast(amplitude=positive("amplitude", amplitude), width=positive("width", width))
    share = np.minimum(w / (2 * a), 1.0)
    x = 1 - 2 * share
    real = 0.5 + (np.arcsin(x) + x * np.sqrt(1 - x**2)) / np.pi
    result: ComplexArray = real - 4j / np.pi * share * (1 - share)
    return result
