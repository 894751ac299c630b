"""Computes the exact limits in SI units: critical stiffness, damping ceiling, peak."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from haptic_wall.controller.theory.boundary import (
    CriticalPoint,
    chain_boundary,
    chain_ceiling,
    chain_peak,
)
from haptic_wall.controller.theory.chain import one_mass
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.controller.theory.dimensionless import settings


def critical_stiffness(
    inertia: ArrayLike,
    damping: ArrayLike,
    virtual_damping: ArrayLike,
    period: ArrayLike,
    delay: ArrayLike,
    velocity_samples: ArrayLike = 1,
) -> FloatArray:
    """Return the stiffness below which a two-sided wall on a free device is stable.

    Exact for an inertia with viscous damping, a held torque, and any delay, fractions of a period
    included. It does not cover a wall that never pulls, nor a hand on the device.

    Args:
        inertia: m > 0 [kg·m²].
        damping: Viscous damping b >= 0 [N·m·s/rad].
        virtual_damping: B [N·m·s/rad].
        period: T > 0 [s].
        delay: t_d >= 0, from the sample to its torque acting [s].
        velocity_samples: N of the velocity difference (x_k - x_{k-N}) / (N T), >= 1.

    Returns:
        Stiffness [N·m/rad] in the broadcast shape; 0 where none is stable.

    Raises:
        ValueError: An argument is outside of its domain; the message names it.

    Source: Gil et al., ICRA 2007, eq. (11), solved on the unit circle for K and B.
    """
    return critical_point(
        inertia, damping, virtual_damping, period, delay, velocity_samples
    ).stiffness


def critical_point(
    inertia: ArrayLike,
    damping: ArrayLike,
    virtual_damping: ArrayLike,
    period: ArrayLike,
    delay: ArrayLike,
    velocity_samples: ArrayLike = 1,
) -> CriticalPoint:
    """Return the critical stiffness and the frequency of the oscillation at it.

    Args:
        inertia: m > 0 [kg·m²].
        damping: Viscous damping b >= 0 [N·m·s/rad].
        virtual_damping: B [N·m·s/rad].
        period: T > 0 [s].
        delay: t_d >= 0 [s].
        velocity_samples: N of the velocity difference, >= 1.

    Raises:
        ValueError: An argument is outside of its domain; the message names it.
    """
    chain, shape = one_mass(inertia, damping)
    return chain_boundary(chain, shape, virtual_damping, period, delay, velocity_samples)


def max_virtual_damping(
    inertia: ArrayLike,
    damping: ArrayLike,
    period: ArrayLike,
    delay: ArrayLike,
    velocity_samples: ArrayLike = 1,
) -> FloatArray:
    """Return the ceiling of the virtual damping: above it no stiffness, however small, is stable.

    With N > 1 and delta = b T / m above about 1, a loop just above the ceiling can be unstable at
    the lowest stiffness and stable at a higher one. This is ignored: a limit ends the stable
    interval that begins at 0.

    For whole delays of d periods and b -> 0 it is (2 m / T) tan(pi / (4 (d + 1))).

    Args:
        inertia: m > 0 [kg·m²].
        damping: Viscous damping b >= 0 [N·m·s/rad].
        period: T > 0 [s].
        delay: t_d >= 0 [s].
        velocity_samples: N of the velocity difference, >= 1.

    Returns:
        Virtual damping [N·m·s/rad] in the broadcast shape.

    Raises:
        ValueError: An argument is outside of its domain; the message names it.

    Source: Gil et al., ICRA 2007, eq. (11) with K = 0, solved on the unit circle.
    """
    return chain_ceiling(*one_mass(inertia, damping), period, delay, velocity_samples)


def peak(
    inertia: ArrayLike,
    damping: ArrayLike,
    period: ArrayLike,
    delay: ArrayLike,
    velocity_samples: ArrayLike = 1,
) -> CriticalPoint:
    """Return the highest critical stiffness over all virtual dampings, and that damping.

    Args:
        inertia: m > 0 [kg·m²].
        damping: Viscous damping b >= 0 [N·m·s/rad].
        period: T > 0 [s].
        delay: t_d >= 0 [s].
        velocity_samples: N of the velocity difference, >= 1.

    Raises:
        ValueError: An argument is outside of its domain; the message names it.
    """
    s = settings(inertia, damping, 0.0, period, delay, velocity_samples)
    top = chain_peak(one_mass(np.ones_like(s.delta), s.delta)[0], 1.0, s.delay, s.samples)
    return CriticalPoint(
        stiffness=s.shaped(top.stiffness * s.stiffness_unit),
        virtual_damping=s.shaped(top.virtual_damping * s.damping_unit),
        frequency=s.shaped(top.frequency / s.period),
    )
