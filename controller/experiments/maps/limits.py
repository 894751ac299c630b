"""Computes the theory's limits of a servo's walls without friction, rigid or with a load."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from haptic_wall.controller.experiments.maps.loop import Wall
from haptic_wall.controller.theory import (
    critical_stiffness,
    flexible_boundary,
    flexible_ceiling,
    max_virtual_damping,
    one_sided_limit,
)
from haptic_wall.controller.theory.chain import two_masses
from haptic_wall.controller.theory.chain_contact import one_sided_limits
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.hw.truth import TrueServo


def exact_limit(
    servo: TrueServo, damping: FloatArray, period: float, delay: FloatArray, samples: int
) -> FloatArray:
    """Return the stiffness up to which a two-sided wall is stable [N·m/rad].

    Args:
        servo: The servo.
        damping: B [N·m·s/rad].
        period: T [s].
        delay: t_d, broadcast with the damping [s].
        samples: N of the velocity difference.
    """
    loop = (damping, period, delay, samples)
    if not servo.flexible:
        return critical_stiffness(servo.inertia, servo.damping, *loop)
    return flexible_boundary(*_flexible(servo), *loop, encoder=servo.encoder).stiffness


def one_sided_limit_of(
    servo: TrueServo,
    damping: FloatArray,
    period: float,
    delay: FloatArray,
    samples: int,
    tolerance: float = 1e-4,
) -> FloatArray:
    """Return the stiffness up to which a wall that never pulls returns no energy; see above.

    Args:
        servo: The servo.
        damping: B, shape (n,) [N·m·s/rad].
        period: T [s].
        delay: t_d, shape (m, 1) [s].
        samples: N of the velocity difference.
        tolerance: Wanted relative accuracy for a rigid servo; 0.01 is quick.

    Returns:
        Delays × dampings [N·m/rad].
    """
    if not servo.flexible:
        loop = (damping, period, delay, samples)
        return one_sided_limit(servo.inertia, servo.damping, *loop, tolerance)
    chain, _ = two_masses(*_flexible(servo), encoder=servo.encoder)
    exact = exact_limit(servo, damping, period, delay, samples)
    return np.array(
        [
            one_sided_limits(chain, period, float(one[0]), row, damping, samples)
            for one, row in zip(delay, exact, strict=True)
        ]
    )


def ceiling(servo: TrueServo, period: float, delay: float, samples: int) -> float:
    """Return the virtual damping up to which some stiffness is stable [N·m·s/rad]."""
    loop = (period, delay, samples)
    if not servo.flexible:
        return float(max_virtual_damping(servo.inertia, servo.damping, *loop))
    return float(flexible_ceiling(*_flexible(servo), *loop, encoder=servo.encoder))


def first_guess(walls: Sequence[Wall]) -> FloatArray:
    """Return where to look first for the critical stiffnesses [N·m/rad]: the exact limits."""
    columns = zip(
        *(
            (w.moved, w.body.forth, w.virtual_damping, w.period, w.whole * w.period + w.lag)
            for w in walls
        ),
        strict=True,
    )
    moved, damping, *loop = (np.array(column) for column in columns)
    loop.append(np.array([w.samples for w in walls]))
    found = critical_stiffness(moved, damping, *loop)
    for side in ("motor", "output"):
        some = [i for i, w in enumerate(walls) if w.body.behind and w.on_motor == (side == "motor")]
        if some:
            bodies = [walls[i].body for i in some]
            servo = zip(
                *((b.inertia, b.forth, b.behind, b.joint, b.loss) for b in bodies),
                strict=True,
            )
            each = (one[some] for one in loop)
            arrays = (*(np.array(column) for column in servo), *each)
            found[some] = flexible_boundary(*arrays, encoder=side).stiffness
    return found


def _flexible(servo: TrueServo) -> tuple[float, float, float, float, float]:
    return (
        servo.inertia,
        servo.damping,
        servo.load_inertia,
        servo.transmission_stiffness,
        servo.transmission_damping,
    )
