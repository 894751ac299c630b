"""Simulated critical stiffness of arrays of servos, by the one of single walls."""

import numpy as np
from numpy.typing import ArrayLike

from haptic_wall.controller.experiments.maps.walls import critical, wall_of
from haptic_wall.controller.theory import critical_stiffness
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.hw.truth import TrueServo


def simulated_critical_stiffness(
    inertia: ArrayLike,
    damping: ArrayLike,
    virtual_damping: ArrayLike,
    period: ArrayLike,
    delay: ArrayLike,
    *,
    coulomb: ArrayLike = 0.0,
    position_step: ArrayLike = 0.0,
    torque_limit: ArrayLike = np.inf,
    one_sided: bool = False,
    velocity_samples: ArrayLike = 1,
    kick: ArrayLike = 0.01,
    tolerance: float = 1e-4,
) -> FloatArray:
    """The stiffness above which the motion after a kick grows, in the broadcast shape."""
    loops = (inertia, damping, virtual_damping, period, delay)
    guess = critical_stiffness(*loops, velocity_samples)
    effects = (coulomb, position_step, torque_limit, velocity_samples, kick)
    arrays = np.broadcast_arrays(*loops, *effects, guess)
    found = []
    for m, b, virtual, t, t_d, c, q, limit, n, size, first in zip(
        *(array.ravel().tolist() for array in arrays), strict=True
    ):
        servo = TrueServo(m, b, c, counts_per_rev=0, torque_limit=limit)
        how = {"period": t, "delay": t_d, "virtual_damping": virtual, "one_sided": one_sided}
        wall = wall_of(servo, **how, velocity_samples=int(n))
        wall = wall._replace(counts=1.0 / q if q > 0.0 else 0.0)
        found.append(critical(wall, size, first, tolerance))
    result: FloatArray = np.array(found).reshape(arrays[0].shape)[()]
    return result
