"""Computes the response of an inertia with viscous damping to held torques: exact, any damping.

Dimensionless: period 1, inertia 1, viscous damping ``delta``.
"""

from __future__ import annotations

from math import factorial
from typing import NamedTuple

import numpy as np

from haptic_wall.controller.theory.checks import ComplexArray, FloatArray

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


def inverse_plant(delta: FloatArray, delay: FloatArray | float, w: FloatArray) -> ComplexArray:
    """Return -1 / G(exp(j w)), G from a commanded, held torque to the sampled position.

    The plant has the pulse transfer ``z^-(n+1) (b2 z² + b1 z + b0) / ((z - 1) (z - eps))``; a
    fraction of a period of delay splits the hold (modified z-transform). No term is a small
    difference of large numbers.

    Args:
        delta: Dimensionless viscous damping, >= 0.
        delay: d = n + f [periods].
        w: Frequencies [rad/sample].
    """
    whole = np.floor(delay)
    full, late = held_response(delta, 1.0), held_response(delta, 1.0 - (delay - whole))
    phi = full.position_per_speed
    # the period starts with the torque of n + 1 periods ago and ends with that of n periods ago
    b2 = late.position_per_torque
    b0 = phi * (phi - late.position_per_speed)
    b0 = b0 - full.speed_per_speed * (full.position_per_torque - b2)
    sine, cosine, decay = 2.0 * np.sin(0.5 * w), np.cos(0.5 * w), delta * phi
    real, imaginary = phi - 0.5 * (b2 + b0) * sine * sine, (b2 - b0) * sine * cosine
    turned = np.exp(1j * (whole + 1.0) * w) * (real - 1j * imaginary)
    numerator = sine * ((1.0 - 0.5 * decay) * sine - 1j * decay * cosine)
    found: ComplexArray = numerator * turned / (real * real + imaginary * imaginary)
    return found


def difference(samples: FloatArray | float, w: FloatArray) -> ComplexArray:
    """Return (1 - exp(-j N w)) / N of a difference over N ``samples`` at frequencies ``w``."""
    half = 0.5 * samples * w
    found: ComplexArray = 2j * np.sin(half) * np.exp(-1j * half) / samples
    return found
