"""Computes the response of an inertia with viscous damping to a held torque: exact, any damping.

Dimensionless: period 1, inertia 1, viscous damping ``delta``.
"""

from __future__ import annotations

from math import factorial
from typing import NamedTuple

import numpy as np

from haptic_wall.controller.theory.checks import FloatArray

# Below it the closed form of the position loses digits to cancellation (a relative error of
# 1e-16/x), and 15 terms of the series are exact in double precision.
_SERIES_BELOW = 0.5
_SERIES = [(-1.0) ** k / factorial(k + 2) for k in range(15)]


class HeldResponse(NamedTuple):
    """Position and speed after a time ``t``, per unit speed at the start and per unit torque."""

    position_per_speed: FloatArray
    """phi(t) = (1 - exp(-delta t)) / delta; also the speed per unit torque."""
    position_per_torque: FloatArray
    """(t - phi(t)) / delta"""
    speed_per_speed: FloatArray
    """exp(-delta t)"""


def held_response(delta: FloatArray, t: FloatArray | float) -> HeldResponse:
    """Return the exact response to a torque held for a time ``t`` [periods].

    Args:
        delta: Dimensionless viscous damping, >= 0.
        t: Time [periods]; negative gives the free motion before.
    """
    x = delta * t
    exponential = np.expm1(-x)
    tiny = x == 0
    divisor = np.where(tiny, 1.0, x)
    small = np.abs(x) < _SERIES_BELOW
    argument = np.where(small, x, 0.0)
    series = np.zeros_like(argument)
    for coefficient in reversed(_SERIES):
        series *= argument  # in place: identification spends a good part of its time here
        series += coefficient
    if not np.all(small):
        series = np.where(small, series, (x + exponential) / np.where(small, 1.0, divisor) ** 2)
    return HeldResponse(
        position_per_speed=t * np.where(tiny, 1.0, -exponential / divisor),
        position_per_torque=t * t * series,
        speed_per_speed=np.exp(-x),
    )
