"""The closed loop's poles in extended precision; nothing here uses ``haptic_wall``.

Dimensionless (period and inertia 1). The motion over a held torque is written down from the
exponential, in so many digits that its cancellations do not matter. Two independent questions can
be asked of the characteristic polynomial: where the pole next to a given point is (Newton), and
whether *all* of its zeros are inside of the unit circle (Schur and Cohn).
"""

from __future__ import annotations

from typing import Any, NamedTuple, TypeAlias

import mpmath
import numpy as np

DIGITS = 60
BITS = 640
"""Of the fixed-point numbers of the Schur-Cohn test: of two poles at 1 - 1e-15 and degree 64 the
recursion loses about 130."""

ExactNumber: TypeAlias = Any
"""An ``mpmath.mpf``"""


class Wall(NamedTuple):
    """Dimensionless settings, exactly the given doubles."""

    delta: float
    beta: float
    delay: float
    samples: int = 1


def characteristic(wall: Wall, alpha: ExactNumber) -> list[ExactNumber]:
    """Coefficients of the closed loop's characteristic polynomial, lowest power first.

    (z - 1)(z - eps) z^(n+1+N)
    + [position(z) (z - eps) + phi speed(z)] [(alpha + beta/N) z^N - beta/N] = 0

    with the response to the torques of n and n + 1 periods ago in position(z) and speed(z).
    """
    delta, beta, delay = (mpmath.mpf(x) for x in wall[:3])
    whole = int(mpmath.floor(delay))
    rest = 1 - (delay - whole)
    eps = mpmath.exp(-delta)

    def speed(t: ExactNumber) -> ExactNumber:
        return (1 - mpmath.exp(-delta * t)) / delta

    def position(t: ExactNumber) -> ExactNumber:
        return (t - speed(t)) / delta

    new = position(rest), speed(rest)
    old = position(mpmath.mpf(1)) - new[0], speed(mpmath.mpf(1)) - new[1]
    phi = speed(mpmath.mpf(1))
    numerator = [
        phi * old[1] - eps * old[0],
        old[0] + phi * new[1] - eps * new[0],
        new[0],
    ]
    n = wall.samples
    result = [mpmath.mpf(0)] * (whole + 4 + n)
    for power, coefficient in enumerate(numerator):
        result[power] -= coefficient * beta / n
        result[power + n] += coefficient * (alpha + beta / n)
    for power, coefficient in enumerate([eps, -1 - eps, mpmath.mpf(1)]):
        result[whole + 1 + n + power] += coefficient
    return result


def pole_near(coefficients: list[ExactNumber], start: complex) -> mpmath.mpc:
    """The zero that Newton's method reaches from ``start``."""
    z = mpmath.mpc(start)
    terms = [(power, c) for power, c in enumerate(coefficients) if c]
    for _ in range(50):
        powers = [(power, c * z ** (power - 1)) for power, c in terms]
        step = z * sum(x for _, x in powers) / sum(power * x for power, x in powers)
        z -= step
        if abs(step) < mpmath.mpf(10) ** (-DIGITS // 2):
            return z  # the step after this one is below the last digit
    raise AssertionError(f"no pole found near {start}")


def all_inside(coefficients: list[ExactNumber], bits: int = BITS) -> bool:
    """Whether every zero is inside of the unit circle, by the Schur-Cohn recursion.

    A polynomial with last coefficient a0 and leading coefficient an has all zeros inside iff
    |a0| < |an| and the polynomial (p - (a0/an) p*) / z has, p* the reversed one. In fixed-point
    whole numbers, which Python keeps to any length.
    """
    one = 1 << bits
    scaled = [int(mpmath.nint(mpmath.ldexp(c, bits))) for c in coefficients]
    a = np.array(scaled, dtype=object)
    while len(a) > 1:
        if abs(a[0]) >= abs(a[-1]):
            return False
        ratio = (a[0] << bits) // a[-1]
        a = ((a * one - ratio * a[::-1]) >> bits)[1:]
    return True
