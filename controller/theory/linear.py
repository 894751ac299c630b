"""The linear condition: critical stiffness = sum of damping / sum of delay. Not a safe bound.

It is the tangent of the exact boundary at the origin. The exact limit lies just below it for most
settings, far below it for much virtual damping, and above it for little (see ``exact``, and
``linear_error`` for the difference). The module has it in SI units and as the paper prints it, and
the paper's passivity condition without delay.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from haptic_wall.controller.theory.checks import (
    FloatArray,
    broadcast,
    not_negative,
    number,
    positive,
    samples,
)


def linear_limit(
    damping: ArrayLike,
    virtual_damping: ArrayLike,
    period: ArrayLike,
    delay: ArrayLike,
    velocity_samples: ArrayLike = 1,
) -> FloatArray:
    """Return the critical stiffness of the linear condition, K = (b + B) / (T/2 + t_d).

    It does not depend on the inertia, nor, to this order, on the velocity's N.

    Args:
        damping: Viscous damping b >= 0 [N·m·s/rad].
        virtual_damping: B [N·m·s/rad].
        period: T > 0 [s].
        delay: t_d >= 0, from the sample to its torque acting [s].
        velocity_samples: N of the velocity difference, >= 1; it has no effect here.

    Returns:
        Stiffness [N·m/rad] in the broadcast shape; 0 where b + B <= 0.

    Raises:
        ValueError: An argument is outside of its domain; the message names it.

    Source: Gil et al., ICRA 2007, eqs. (7)-(10).
    """
    b, big_b, t, t_d, _ = broadcast(
        damping=not_negative("damping", damping),
        virtual_damping=number("virtual_damping", virtual_damping),
        period=positive("period", period),
        delay=not_negative("delay", delay),
        velocity_samples=samples("velocity_samples", velocity_samples),
    )
    with np.errstate(over="ignore"):
        result: FloatArray = np.maximum((b + big_b) / (t / 2 + t_d), 0.0)
    if not np.all(np.isfinite(result)):
        raise ValueError("period is too small: (b + B) / (T/2 + t_d) must be a finite number")
    return result


def linear(delta: ArrayLike, beta: ArrayLike, delay: ArrayLike) -> FloatArray:
    """Return the linear limit of alpha for any delay: equations (7)-(10) and (16).

    It is alpha < 2 (delta + beta) / (1 + 2 d); in SI units ``linear_limit``: K < (b + B) / (T/2 +
    t_d). (16) are its lines in Fig. 6. It is the tangent of the exact boundary where both dampings
    vanish, not a safe bound.

    Args:
        delta: Viscous damping >= 0.
        beta: Virtual damping.
        delay: d >= 0 [periods].

    Returns:
        The limit of alpha in the broadcast shape; 0 where beta <= -delta.

    Raises:
        ValueError: An argument is outside of its domain; the message names it.

    Source: Gil et al., ICRA 2007, eqs. (7)-(10), (16).
    """
    small, virtual, d = broadcast(
        delta=not_negative("delta", delta),
        beta=number("beta", beta),
        delay=not_negative("delay", delay),
    )
    limit: FloatArray = np.maximum(2.0 * (small + virtual) / (1.0 + 2.0 * d), 0.0)[()]
    return limit


def linear_no_delay(delta: ArrayLike, beta: ArrayLike) -> FloatArray:
    """Return the linear limit without delay, alpha < 2 (delta + beta): equation (4).

    Args:
        delta: Viscous damping >= 0.
        beta: Virtual damping.

    Source: Gil et al., ICRA 2007, eq. (4).
    """
    return linear(delta, beta, 0.0)


def linear_one_sample(delta: ArrayLike, beta: ArrayLike) -> FloatArray:
    """Return the linear limit for one period of delay, alpha < (2/3) (delta + beta): (5) and (14).

    Args:
        delta: Viscous damping >= 0.
        beta: Virtual damping.

    Source: Gil et al., ICRA 2007, eqs. (5), (14).
    """
    return linear(delta, beta, 1.0)


def passive_no_delay(delta: ArrayLike, beta: ArrayLike) -> FloatArray:
    """Return the passive limit without delay, alpha < 2 (delta - abs(beta)): equation (6).

    It is 0 where no stiffness is passive. ``passive_limit`` is for any delay and in SI units.

    Args:
        delta: Viscous damping >= 0.
        beta: Virtual damping.

    Raises:
        ValueError: An argument is outside of its domain; the message names it.

    Source: Gil et al., ICRA 2007, eq. (6); Colgate and Schenkel, 1997.
    """
    small, virtual = broadcast(delta=not_negative("delta", delta), beta=number("beta", beta))
    limit: FloatArray = np.maximum(2.0 * (small - np.abs(virtual)), 0.0)[()]
    return limit
