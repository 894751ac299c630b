"""The array form of ``haptic_wall.hw.plant.response``, without a spring."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from haptic_wall.hw.plant.response import response

Floats = NDArray[np.float64]


def times_to_rest(velocity: Floats, push: Floats, decay: Floats) -> Floats:
    """Return when decelerated velocities reach zero [s].

    See ``haptic_wall.hw.plant.response.time_to_rest``.
    """
    coasting = -velocity / push
    y = decay * coasting
    shorter = np.ones_like(y)
    damped = np.flatnonzero(y > 1e-12)
    if damped.size:
        some = y[damped]
        shorter[damped] = np.array([math.log1p(value) for value in some.tolist()]) / some
    return coasting * shorter


def responses(decay: Floats, time: Floats) -> Floats:
    """Return ``h`` and ``s`` of ``response.response`` without a spring; shape (2, n).

    Equal to them to the last bit.
    """
    a = decay * time
    h, s = result = np.empty((2, a.size))
    largest = float(a.max())
    if largest > 1.0:  # bodies that lose their speed within a step are rare: one by one
        for i, (rate, t) in enumerate(zip(decay.tolist(), time.tolist(), strict=True)):
            whole = response(rate, 0.0, t)
            h[i], s[i] = whole.h, whole.s
        return result
    h[:], s[:] = 1.0, 0.5
    term, work = np.ones_like(a), np.empty_like(a)
    n, bound = 1, 1.0
    # The series ends for all together: terms below 1e-19 do not change the sums.
    while bound > 1e-19:
        n += 1
        bound *= largest / n
        np.multiply(a, term, term)
        np.divide(term, -n, term)
        np.add(h, term, h)
        np.divide(term, n + 1, work)
        np.add(s, work, s)
    np.multiply(h, time, h)
    np.multiply(time, time, work)
    np.multiply(s, work, s)
    return result
