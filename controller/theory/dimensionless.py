"""Converts the settings of a wall to dimensionless form: one period long, unit inertia.

The behaviour of the sampled loop depends on four numbers only (the paper's Table I): ``delta = b T
/ m``, ``alpha = K T² / m``, ``beta = B T / m`` and ``d = t_d / T``.
"""

from __future__ import annotations

from dataclasses import dataclass

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

_MOST_DAMPING, _LONGEST = 1e100, 1e6


@dataclass(frozen=True, slots=True)
class Settings:
    """Dimensionless settings, as flat arrays of one length, and the factors back to SI units."""

    delta: FloatArray
    """Viscous damping, b T / m"""
    beta: FloatArray
    """Virtual damping, B T / m"""
    delay: FloatArray
    """Total delay in periods, t_d / T"""
    samples: FloatArray
    """N of the N-sample velocity difference, whole numbers"""
    stiffness_unit: FloatArray
    """m / T², which turns alpha into a stiffness [N·m/rad]"""
    damping_unit: FloatArray
    """m / T, which turns beta into a damping [N·m·s/rad]"""
    period: FloatArray
    """[s]"""
    shape: tuple[int, ...]
    """The broadcast shape of the arguments"""

    def shaped(self, flat: FloatArray) -> FloatArray:
        """Return a flat result in the shape of the arguments; a scalar for scalars."""
        result: FloatArray = flat.reshape(self.shape)[()]
        return result


def settings(
    inertia: ArrayLike,
    damping: ArrayLike,
    virtual_damping: ArrayLike,
    period: ArrayLike,
    delay: ArrayLike,
    velocity_samples: ArrayLike,
) -> Settings:
    """Return the dimensionless form of settings in SI units.

    Args:
        inertia: m > 0 [kg·m²].
        damping: Viscous damping b >= 0 [N·m·s/rad].
        virtual_damping: B, any sign [N·m·s/rad].
        period: T > 0 [s].
        delay: t_d >= 0, from the sample to its torque acting [s].
        velocity_samples: N >= 1.

    Raises:
        ValueError: An argument is outside of its domain; the message names it.

    Source: Gil et al., ICRA 2007, Table I.
    """
    arrays = broadcast(
        inertia=positive("inertia", inertia),
        damping=not_negative("damping", damping),
        virtual_damping=number("virtual_damping", virtual_damping),
        period=positive("period", period),
        delay=not_negative("delay", delay),
        velocity_samples=samples("velocity_samples", velocity_samples),
    )
    m, b, big_b, t, t_d, n = (np.ravel(array) for array in arrays)
    with np.errstate(over="ignore", divide="ignore", under="ignore", invalid="ignore"):
        result = Settings(
            delta=b * t / m,
            beta=big_b * t / m,
            delay=t_d / t,
            samples=n,
            stiffness_unit=m / t / t,
            damping_unit=m / t,
            period=t,
            shape=arrays[0].shape,
        )
    _computable(result)
    return result


def _computable(s: Settings) -> None:
    """Raise for settings that double precision cannot represent."""
    largest = np.finfo(np.float64).max
    for good, message in (
        (s.delta <= _MOST_DAMPING, "inertia is too small: b T / m must be at most 1e100"),
        (np.abs(s.beta) <= largest, "inertia is too small: B T / m must be a finite number"),
        (s.delay <= _LONGEST, "period is too small: t_d / T must be at most 1e6"),
        (s.stiffness_unit <= largest, "period is too small: m / T² must be a finite number"),
        (s.stiffness_unit > 0, "period is too large: m / T² must be above 0"),
    ):
        if not np.all(good):
            raise ValueError(message)
