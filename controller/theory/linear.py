"""The linear condition: critical stiffness = sum of damping / sum of delay. Not a safe bound.

It is the tangent of the exact boundary at the origin. The exact limit lies just below it for most
settings, far below it for much virtual damping, and above it for little.
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
