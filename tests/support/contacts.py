"""Simulated contacts with a wall that never pulls, to check limits by exit over entry speed."""

import numpy as np
from numpy.typing import ArrayLike

from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.controller.theory.contact import Contacts, exit_speed


def restitution(
    inertia: ArrayLike,
    damping: ArrayLike,
    stiffness: ArrayLike,
    virtual_damping: ArrayLike,
    period: ArrayLike,
    delay: ArrayLike,
    phases: int = 33,
    velocity_samples: ArrayLike = 1,
) -> FloatArray:
    """Return exit over entry speed of each contact at the worst phase of entry, 0.02 at least.

    Args:
        inertia: m [kg·m²].
        damping: Viscous damping b [N·m·s/rad].
        stiffness: K [N·m/rad].
        virtual_damping: B [N·m·s/rad].
        period: T [s].
        delay: t_d [s].
        phases: Number of phases, the ends of the period included.
        velocity_samples: N of the velocity difference.
    """
    given = (inertia, damping, stiffness, virtual_damping, period, delay, velocity_samples)
    m, b, k, big_b, t, t_d, n = np.broadcast_arrays(*given)
    numbers = (b * t / m, k * t * t / m, big_b * t / m, t_d / t)
    delta, alpha, beta, late = (np.repeat(each.ravel(), phases) for each in numbers)
    samples = np.repeat(n.ravel().astype(np.int64), phases)
    phase = np.tile(np.linspace(0.0, 1.0, phases), m.size)
    contacts = Contacts(delta, alpha, beta, late, samples, phase)
    found: FloatArray = exit_speed(contacts, 0.02).reshape(*m.shape, phases).max(axis=-1)
    return found
