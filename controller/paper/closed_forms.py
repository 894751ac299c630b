"""The paper's closed forms of the exact boundary, without delay and with one period of it.

Dimensionless, with ``eps = exp(-delta)``. (13) circulates misprinted; this is the form that agrees
with the poles. Both lose digits in double precision for light damping: use ``critical_stiffness``.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike

from haptic_wall.controller.theory.checks import FloatArray, broadcast, number, positive


def no_delay_limit(delta: ArrayLike, beta: ArrayLike) -> FloatArray:
    """Return the exact limit without delay, in closed form: equation (1).

    It loses digits in double precision, with a relative error of up to 1e-14 / delta²: accurate to
    1e-9 from delta = 0.01 on, to 1e-6 at 1e-4, and useless below 1e-7.

    Args:
        delta: Viscous damping > 0.
        beta: Virtual damping between -delta and the ceiling; outside it the value is no limit.

    Raises:
        ValueError: An argument is outside of its domain; the message names it.

    Source: Gil et al., ICRA 2007, eq. (1).
    """
    small, virtual = broadcast(delta=positive("delta", delta), beta=number("beta", beta))
    eps = np.exp(-small)
    shared = virtual * eps - virtual + small**2
    limit: FloatArray = (
        small
        * (small + virtual)
        * (1 - eps)
        * (shared + virtual * small * eps)
        / ((1 - eps - small * eps) * (shared + virtual * small))
    )[()]
    return limit


def one_sample_limit(delta: ArrayLike, beta: ArrayLike) -> FloatArray:
    """Return the exact limit for a delay of one period: equation (13) solved for alpha.

    The determinant is a cubic in alpha; the limit is its least positive root. Like (1) it cancels:
    relative error up to 1e-14 / delta².

    Args:
        delta: Viscous damping > 0.
        beta: Virtual damping.

    Returns:
        The limit of alpha in the broadcast shape; 0 where no stiffness is stable.

    Raises:
        ValueError: An argument is outside of its domain; the message names it.

    Source: Gil et al., ICRA 2007, eq. (13), corrected.
    """
    small, virtual = broadcast(delta=positive("delta", delta), beta=number("beta", beta))
    result = np.zeros(small.shape)
    for index in np.ndindex(small.shape):
        a0, a1, a2, a3, a4 = (
            Polynomial([float(constant), float(slope)])
            for constant, slope in _routh_coefficients(small[index], virtual[index])
        )
        cubic = a1 * a2 * a3 - a4 * a1 * a1 - a0 * a3 * a3
        if virtual[index] <= -small[index] or cubic(0.0) <= 0:
            continue
        roots = cubic.roots()
        rising = roots.real[(np.abs(roots.imag) < 1e-9 * np.abs(roots)) & (roots.real > 0)]
        result[index] = np.min(rising, initial=np.inf)
    limit: FloatArray = np.where(np.isfinite(result), result, 0.0)[()]
    return limit


def _routh_coefficients(
    delta: FloatArray, beta: FloatArray
) -> tuple[tuple[FloatArray, FloatArray], ...]:
    """Return a0 to a4 of (13), each as its value at alpha = 0 and its slope over alpha."""
    eps = np.exp(-delta)
    lost = 1 - eps
    return (
        (0.0 * delta, lost * delta / 2),
        (lost * (delta * beta + delta**2), eps * delta - lost),
        (
            -2 * lost * beta + delta * (3 * delta - eps * delta + 3 * beta * eps - beta),
            lost - delta,
        ),
        (
            4 * lost * beta + delta * (3 * delta + eps * delta - 3 * beta * eps - beta),
            lost - delta * eps,
        ),
        (-2 * lost * beta + delta * (1 + eps) * (beta + delta), -lost + delta / 2 * (1 + eps)),
    )
