"""The paper's closed forms, characteristic polynomials and gain margin, as printed there.

Dimensionless, with ``eps = exp(-delta)``. Equations (12) and (13) circulate misprinted; this module
has the forms that agree with the poles. (1), (12) and (13) lose digits in double precision for
light damping, as each docstring says: use ``critical_stiffness`` for computation.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike, NDArray

from haptic_wall.controller.theory.checks import (
    FloatArray,
    broadcast,
    not_negative,
    number,
    positive,
    scalar,
    whole_number,
)
from haptic_wall.controller.theory.loop import HeldLoop
from haptic_wall.controller.theory.response import held_response
from haptic_wall.controller.theory.roots import zeros

_MARGIN_POINTS = 64  # per turn of the delayed plant
_LOWEST_W = 1e-7


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


def no_delay_condition(delta: ArrayLike, alpha: ArrayLike, beta: ArrayLike) -> NDArray[np.bool_]:
    """Whether 0 < alpha < ``no_delay_limit``: equation (1) as a condition.

    Args:
        delta: Viscous damping > 0.
        alpha: Stiffness.
        beta: Virtual damping, between -delta and the ceiling.

    Source: Gil et al., ICRA 2007, eq. (1).
    """
    stiffness = number("alpha", alpha)
    holds: NDArray[np.bool_] = (stiffness > 0) & (stiffness < no_delay_limit(delta, beta))
    return holds


def characteristic_polynomial(delta: float, alpha: float, beta: float, delay: int) -> FloatArray:
    """Return equation (11) multiplied out: 1 + z^-d G (alpha + beta (1 - 1/z)) = 0, whole delays.

    With ``p = 1 - eps - delta`` and ``q = 1 - eps - delta eps`` the paper's form is::

        delta² (z - eps) (z - 1) z^(d+1) - p (alpha + beta) z²
            + [q (alpha + beta) + p beta] z - q beta = 0

    The result is divided by delta², without cancellation in its coefficients: accurate for any
    delta, also for 0.

    Args:
        delta: Viscous damping >= 0.
        alpha: Stiffness.
        beta: Virtual damping.
        delay: d, a whole number >= 0; a fraction is not covered.

    Returns:
        d + 4 coefficients, the highest power first; the first one is 1.

    Raises:
        ValueError: An argument is outside of its domain; the message names it.

    Source: Gil et al., ICRA 2007, eq. (11).
    """
    d = whole_number("delay", delay)
    full = held_response(np.array(scalar(not_negative, "delta", delta)), 1.0)
    a, virtual = scalar(number, "alpha", alpha), scalar(number, "beta", beta)
    phi, eps = float(full.position_per_speed), float(full.speed_per_speed)
    forward = float(full.position_per_torque)  # -p / delta²
    backward = phi * phi - eps * forward  # q / delta²
    result = np.zeros(d + 4)
    result[:3] = 1.0, -(1.0 + eps), eps
    result[-3:] += forward * (a + virtual), backward * (a + virtual), 0.0
    result[-2:] -= forward * virtual, backward * virtual
    return result


def one_sample_polynomial(delta: float, alpha: float, beta: float) -> FloatArray:
    """Return the characteristic polynomial for a delay of one period: equation (12) as printed.

    The z³ coefficient is -(1 + eps) delta²; misprints read +(1 - eps) delta².

    Args:
        delta: Viscous damping > 0. The coefficients cancel to about 1e-16 / delta².
        alpha: Stiffness.
        beta: Virtual damping.

    Returns:
        Five coefficients, the highest power first.

    Raises:
        ValueError: An argument is outside of its domain; the message names it.

    Source: Gil et al., ICRA 2007, eq. (12), corrected.
    """
    small = scalar(positive, "delta", delta)
    a, virtual = scalar(number, "alpha", alpha), scalar(number, "beta", beta)
    eps = float(np.exp(-small))
    p, q = 1 - eps - small, 1 - eps - small * eps
    return np.array(
        [
            small**2,
            -(1 + eps) * small**2,
            eps * small**2 - p * (a + virtual),
            q * (a + virtual) + p * virtual,
            -q * virtual,
        ]
    )


def one_sample_determinant(delta: ArrayLike, alpha: ArrayLike, beta: ArrayLike) -> FloatArray:
    """Return (13), a1 a2 a3 - a4 a1² - a0 a3²: positive where one period of delay is stable.

    The last term is misprinted as a3 a0² elsewhere. The a_i are the coefficients of (12) after the
    bilinear transform, divided by a constant; the condition is Routh's.

    Args:
        delta: Viscous damping > 0.
        alpha: Stiffness.
        beta: Virtual damping.

    Raises:
        ValueError: An argument is outside of its domain; the message names it.

    Source: Gil et al., ICRA 2007, eq. (13), corrected.
    """
    small, a, virtual = broadcast(
        delta=positive("delta", delta), alpha=number("alpha", alpha), beta=number("beta", beta)
    )
    a0, a1, a2, a3, a4 = (
        constant + slope * a for constant, slope in _routh_coefficients(small, virtual)
    )
    determinant: FloatArray = (a1 * a2 * a3 - a4 * a1**2 - a0 * a3**2)[()]
    return determinant


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


def gain_margin(delta: float, beta: float, delay: float) -> float:
    """Return equation (15), Gm[1 / (1 / (z^-d G) + beta (z - 1) / z)]: the least of all crossings.

    Gain margin solvers that return the crossing nearest to a gain of 1 give a wrong limit here: at
    d = 3, beta = 0.01, delta = 1e-4 the margin nearest to 1 is 3.91, the least one .00284.

    Args:
        delta: Viscous damping >= 0.
        beta: Virtual damping between -delta and the ceiling; outside of it no gain is stable, and
            the margin has no meaning.
        delay: d >= 0 [periods], fractions too.

    Raises:
        ValueError: An argument is outside of its domain; the message names it.

    Source: Gil et al., ICRA 2007, eq. (15).
    """
    small, d = scalar(not_negative, "delta", delta), scalar(not_negative, "delay", delay)
    virtual = scalar(number, "beta", beta)
    loop = HeldLoop.of(np.array(small), np.array(d), np.ones(()))

    def inverse(w: FloatArray) -> NDArray[np.complex128]:
        """Return the inverse of the transfer function whose margin is computed."""
        inverted: NDArray[np.complex128] = virtual * loop.difference(w) - loop.inverse_plant(w)
        return inverted

    # the phase crosses -180 degrees where the imaginary part vanishes and the real one is < 0
    turns = np.linspace(0.0, np.pi, _MARGIN_POINTS * (int(d) + 2) + 1)[1:]
    w = np.append(np.geomspace(_LOWEST_W, turns[0], 200)[:-1], turns)
    crossings = zeros(lambda w: inverse(w).imag, w)
    gain = -inverse(np.append(crossings, np.pi)).real
    return float(np.min(gain, where=gain > 0, initial=np.inf))
