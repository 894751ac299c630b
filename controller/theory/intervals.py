"""Computes guaranteed ranges of complex functions and their derivatives, for many boxes at once.

A ``Jet`` holds, for each of many boxes of a few real variables, a disc that contains every value of
a function over the box, and one disc for each of its first derivatives. The sum of two jets
contains every sum of two such functions, and likewise the product. That includes rounding: each
operation widens its discs by ``SLACK`` of their size, four times the largest rounding error. By the
mean value theorem each function then differs from a linear function by at most the discs' radii,
which shrink with the square of the box. ``exclusion`` bounds sampled loops with jets.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import factorial

import numpy as np

from haptic_wall.controller.theory.checks import ComplexArray, FloatArray

SLACK = 1e-15
"""Fraction of a disc's size that each operation adds to its radius, against rounding"""

_SLACK_OF_SERIES = 1e-13  # fewer than 450 operations on positive terms
_ASYMPTOTE_ABOVE = 60.0  # there the neglected term is 1e-22
_TAYLOR_BELOW = 0.01  # the next term is 1e-16; the closed form loses 1e-14 to cancellation


@dataclass(frozen=True, slots=True)
class Jet:
    """Discs that contain a function's value (row 0) and derivatives (rows 1, ...) over each box.

    Without derivatives there is row 0 only. Shapes: rows × boxes.
    """

    centre: ComplexArray
    radius: FloatArray

    def __add__(self, other: Jet) -> Jet:
        """Return the sum."""
        return _widened(self.centre + other.centre, self.radius + other.radius)

    def __sub__(self, other: Jet) -> Jet:
        """Return the difference."""
        return _widened(self.centre - other.centre, self.radius + other.radius)

    def __mul__(self, other: Jet) -> Jet:
        """Return the product, by the product rule."""
        a, b = self.centre, other.centre
        size_a, size_b = np.abs(a), np.abs(b)
        outer_a, outer_b = size_a + self.radius, size_b + other.radius
        centre = a[:1] * b
        centre[1:] += a[1:] * b[:1]
        largest = outer_a[:1] * outer_b
        largest[1:] += outer_a[1:] * outer_b[:1]
        radius = size_a[:1] * other.radius + self.radius[:1] * outer_b
        radius[1:] += size_a[1:] * other.radius[:1] + self.radius[1:] * outer_b[:1]
        return Jet(centre, radius + 4 * SLACK * largest)

    def plus(self, value: float | FloatArray) -> Jet:
        """Return the sum with a real number, or with a real number for each box."""
        centre = self.centre.copy()
        centre[0] += value
        return _widened(centre, self.radius)

    def scaled(self, factor: complex | FloatArray) -> Jet:
        """Return the product with a complex number, or with a real number for each box."""
        return _widened(self.centre * factor, self.radius * np.abs(factor))

    def conjugate(self) -> Jet:
        """Return the complex conjugate."""
        return Jet(np.conj(self.centre), self.radius)


def variables(centre: FloatArray, half: FloatArray, derivatives: bool) -> list[Jet]:
    """Return a jet for each variable.

    Args:
        centre: Midpoints of the boxes, variables × boxes.
        half: Half of their widths, the same shape.
        derivatives: Whether the jets carry derivatives.
    """
    count, boxes = centre.shape
    jets = []
    for i in range(count):
        rows = 1 + count * derivatives
        middle = np.zeros((rows, boxes), dtype=np.complex128)
        radius = np.zeros((rows, boxes))
        middle[0], radius[0] = centre[i], half[i] + SLACK * np.abs(centre[i])
        if derivatives:
            middle[1 + i] = 1.0
        jets.append(Jet(middle, radius))
    return jets


def turned(angle: Jet, factor: float | FloatArray) -> Jet:
    """Return exp(j factor angle) of a real jet; factor is a number, or one for each box."""
    turn = np.exp(1j * factor * angle.centre[0].real)
    size = np.abs(factor)
    # a chord is no longer than its arc
    reach = size * angle.radius[0] + SLACK * (1.0 + size * np.abs(angle.centre[0]))
    centre = 1j * factor * turn * angle.centre
    radius = size * (np.abs(angle.centre) * reach + angle.radius * (1.0 + reach))
    centre[0], radius[0] = turn, reach
    return _widened(centre, radius)


def turn_mean(angle: Jet) -> Jet:
    """Return the mean of exp(j s angle) over 0 < s < 1, (exp(j angle) - 1) / (j angle).

    The angle is a real jet. The function is entire; its derivatives are at most 1/2 and 1/3 in
    size.
    """
    t = angle.centre[0].real
    value = np.sinc(t / (2 * np.pi)) * np.exp(0.5j * t)
    near = np.abs(t) < _TAYLOR_BELOW
    series = 1j / 2 - t / 3 - 1j * t**2 / 8 + t**3 / 30 + 1j * t**4 / 144 - t**5 / 840
    slope = np.where(near, series, (np.exp(1j * t) - value) / np.where(near, 1.0, t))
    return _composed(angle, value, slope, (1 / 2, 1 / 3))


def decay_moments(x: Jet) -> tuple[Jet, Jet]:
    """Return the integrals over 0 < s < 1 of exp(-x s) and of (1 - s) exp(-x s), for a jet x >= 0.

    They are the position responses of a damped inertia to speed and to torque: entire functions of
    x, whose derivatives are largest in size at x = 0: 1/2 and 1/3, 1/6 and 1/12. The code uses
    slightly larger values, because boxes are slightly widened.
    """
    at = np.maximum(x.centre[0].real, 0.0)
    zeroth, first, second = (_moment(at, j) for j in range(3))
    speed = _composed(x, zeroth, -first, (0.501, 0.334))
    torque = _composed(x, zeroth - first, second - first, (0.167, 0.084))
    return speed, torque


def _composed(
    x: Jet,
    value: FloatArray | ComplexArray,
    slope: FloatArray | ComplexArray,
    largest: tuple[float, float],
) -> Jet:
    """Return the jet of f(x) from f, f' at the centre and bounds of ``|f'|``, ``|f''|``."""
    reach = x.radius[0] * largest[1] + _SLACK_OF_SERIES
    centre = slope * x.centre
    radius = np.abs(x.centre) * reach + x.radius * (np.abs(slope) + reach)
    centre[0], radius[0] = value, x.radius[0] * largest[0] + _SLACK_OF_SERIES
    return _widened(centre, radius)


def _moment(x: FloatArray, power: int) -> FloatArray:
    """Return the integral over 0 < s < 1 of s^power exp(-x s), by a series of positive terms."""
    some = np.minimum(x, _ASYMPTOTE_ABOVE)
    term = np.full_like(x, 1.0 / (power + 1))
    total = term.copy()
    k = power + 1
    while np.any(term > SLACK * total):
        k += 1
        term = term * some / k
        total += term
    far = x > _ASYMPTOTE_ABOVE
    tail = factorial(power) / np.where(far, x, 1.0) ** (power + 1)
    result: FloatArray = np.where(far, tail, total * np.exp(-some))
    return result


def _widened(centre: ComplexArray, radius: FloatArray) -> Jet:
    return Jet(centre, radius + SLACK * (np.abs(centre) + radius))
