"""Computes the stiffness above which the simulated motion after a kick grows, of many walls."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from haptic_wall.controller.experiments.maps import search
from haptic_wall.controller.experiments.maps.compiled import compiled
from haptic_wall.controller.experiments.maps.limits import first_guess
from haptic_wall.controller.experiments.maps.loop import Wall
from haptic_wall.controller.experiments.maps.walls import buffers, noise_of, wall_of
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.hw.truth import TrueServo

_NOISY = 16_384
"""Periods after which the encoder's noise repeats"""


def simulated_critical_stiffness(
    inertia: ArrayLike,
    damping: ArrayLike,
    virtual_damping: ArrayLike,
    period: ArrayLike,
    delay: ArrayLike,
    *,
    coulomb: ArrayLike = 0.0,
    position_step: ArrayLike = 0.0,
    backlash: ArrayLike = 0.0,
    torque_limit: ArrayLike = np.inf,
    one_sided: bool = False,
    velocity_samples: ArrayLike = 1,
    kick: ArrayLike = 0.01,
    tolerance: float = 1e-4,
) -> FloatArray:
    """Return the stiffness above which the simulated motion after a kick grows.

    Two-sided: the servo is let go at rest, ``kick`` from the wall, where it was held for long: it
    starts at a turning point with v = 0 and the velocity estimate sees no jump; the amplitude of
    the oscillation grows. One-sided: the servo comes freely with the speed that the spring alone
    would stop after ``kick``; that speed grows from entry to exit.

    Without friction, quantisation, backlash and limit the kick does not matter. With them the
    result is a property of the kick too.

    Args:
        inertia: m > 0 [kg·m²].
        damping: Viscous friction b >= 0 [N·m·s/rad].
        virtual_damping: B [N·m·s/rad].
        period: T > 0 [s].
        delay: t_d >= 0, from the sample to its torque acting [s].
        coulomb: Coulomb friction c >= 0 [N·m].
        position_step: Encoder count q >= 0 [rad]; 0: not quantised. The wall stands on a count.
        backlash: Between shaft and encoder, full width, >= 0 [rad].
        torque_limit: [N·m], > 0; inf: none.
        one_sided: The wall never pulls.
        velocity_samples: N of the velocity difference, >= 1.
        kick: > 0 [rad].
        tolerance: Wanted relative accuracy, > 0.

    Returns:
        Stiffness [N·m/rad] in the broadcast shape: the middle between two neighbouring ones, of
        which one grows. 0 where the motion grows at the softest wall tried (1e-4 m/T², and below
        half the limit without friction), inf where it does not at the stiffest (20 m/T²).
    """
    loops = (inertia, damping, virtual_damping, period, delay)
    effects = (coulomb, position_step, backlash, torque_limit, velocity_samples, kick)
    arrays = np.broadcast_arrays(*loops, *effects)
    walls = []
    for m, b, virtual, t, t_d, c, q, slack, limit, n, _ in zip(
        *(array.ravel().tolist() for array in arrays), strict=True
    ):
        servo = TrueServo(m, b, c, counts_per_rev=0, torque_limit=limit, backlash=slack)
        wall = wall_of(
            servo,
            period=t,
            delay=t_d,
            virtual_damping=virtual,
            one_sided=one_sided,
            velocity_samples=int(n),
        )
        walls.append(wall._replace(counts=1.0 / q if q > 0.0 else 0.0))
    found = onset(walls, arrays[-1].ravel(), tolerance)
    result: FloatArray = found.reshape(arrays[0].shape)[()]
    return result


def onset(
    walls: Sequence[Wall], kick: FloatArray, tolerance: float, servo: TrueServo | None = None
) -> FloatArray:
    """Return ``simulated_critical_stiffness`` of the given walls.

    Args:
        walls: One- and two-sided ones may be mixed.
        kick: Shape (n,), > 0 [rad].
        tolerance: Wanted relative accuracy.
        servo: Its encoder makes the noise; None: there is none.
    """
    functions = compiled()
    run = search.onset if functions is None else functions.onset
    noise = [] if servo is None else noise_of(servo, walls[0].period, _NOISY)
    guesses = first_guess(walls).tolist()
    found = [
        run(wall, *buffers(wall, noise), size, guess, tolerance)
        for wall, size, guess in zip(walls, kick.tolist(), guesses, strict=True)
    ]
    return np.array(found)
