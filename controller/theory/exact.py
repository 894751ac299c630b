"""Computes the exact limits of one mass in SI units: critical stiffness and damping ceiling."""

from __future__ import annotations

from numpy.typing import ArrayLike

from haptic_wall.controller.theory.boundary import chain_boundary, chain_ceiling
from haptic_wall.controller.theory.chain import one_mass
from haptic_wall.controller.theory.checks import FloatArray


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
    loop = (virtual_damping, period, delay, velocity_samples)
    return chain_boundary(*one_mass(inertia, damping), *loop).stiffness


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
