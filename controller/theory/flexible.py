"""Computes the exact limits on a flexible servo: two masses, with a lagging current loop or not."""

from __future__ import annotations

from numpy.typing import ArrayLike

from haptic_wall.controller.theory.boundary import CriticalPoint, chain_boundary, chain_ceiling
from haptic_wall.controller.theory.chain import two_masses
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.controller.theory.velocity_filter import VelocityFilter


def flexible_boundary(
    inertia: ArrayLike,
    damping: ArrayLike,
    load_inertia: ArrayLike,
    transmission_stiffness: ArrayLike,
    transmission_damping: ArrayLike,
    virtual_damping: ArrayLike,
    period: ArrayLike,
    delay: ArrayLike,
    velocity_samples: ArrayLike = 1,
    *,
    encoder: str = "output",
    bandwidth: ArrayLike | None = None,
    velocity_filter: VelocityFilter | None = None,
) -> CriticalPoint:
    """Return the stiffness below which a two-sided wall is stable on two masses, and the frequency.

    Exact for linear masses, a held torque and any delay.

    Args:
        inertia: Inertia of the motor's side, > 0 [kg·m²].
        damping: Viscous friction of the motor's side >= 0 [N·m·s/rad].
        load_inertia: Behind the transmission, > 0 [kg·m²].
        transmission_stiffness: > 0 [N·m/rad].
        transmission_damping: >= 0 [N·m·s/rad].
        virtual_damping: B [N·m·s/rad].
        period: T > 0 [s].
        delay: t_d >= 0, from the sample to its torque acting, without the current loop's lag [s].
        velocity_samples: N of the velocity difference, >= 1.
        encoder: The side that is measured: ``output`` or ``motor``.
        bandwidth: Bandwidth of the current loop, whose torque lags by the first order > 0 [Hz];
            None: none.
        velocity_filter: Filter of the velocity that damps; None: none.

    Returns:
        The boundary in the broadcast shape: the end of the stable interval that begins at 0.

    Raises:
        ValueError: An argument is outside of its domain; the message names it.
    """
    chain, shape = two_masses(
        inertia,
        damping,
        load_inertia,
        transmission_stiffness,
        transmission_damping,
        encoder=encoder,
        bandwidth=bandwidth,
    )
    return chain_boundary(
        chain, shape, virtual_damping, period, delay, velocity_samples, velocity_filter
    )


def flexible_ceiling(
    inertia: ArrayLike,
    damping: ArrayLike,
    load_inertia: ArrayLike,
    transmission_stiffness: ArrayLike,
    transmission_damping: ArrayLike,
    period: ArrayLike,
    delay: ArrayLike,
    velocity_samples: ArrayLike = 1,
    *,
    encoder: str = "output",
    bandwidth: ArrayLike | None = None,
    velocity_filter: VelocityFilter | None = None,
) -> FloatArray:
    """Return the virtual damping up to which some stiffness from 0 on is stable on two masses.

    Arguments and errors are those of ``flexible_boundary``.

    Returns:
        The end of the stable interval of B that begins at 0 [N·m·s/rad], in the broadcast shape.
    """
    chain, shape = two_masses(
        inertia,
        damping,
        load_inertia,
        transmission_stiffness,
        transmission_damping,
        encoder=encoder,
        bandwidth=bandwidth,
    )
    return chain_ceiling(chain, shape, period, delay, velocity_samples, velocity_filter)
