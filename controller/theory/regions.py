"""Classifies walls by friction against sampling and friction against quantisation.

Two ratios place a wall: ``viscous = b / (K T)`` and ``dry = c / (K q)``. Sampling and delay inject
energy that grows with the speed, and viscous friction dissipates it in the same way; rounding
injects energy by the count, and Coulomb friction dissipates it by the count. So each ratio is large
enough, or is not:

==========================  ==========================================================
viscous enough, dry enough  stable
viscous enough, dry not     limit cycle: a bounded rattle of about a count
viscous not, dry enough     locally stable: small motion decays, larger motion grows
neither                     unstable
==========================  ==========================================================

The plane and its four regions, with both thresholds 1/2 for a spring without virtual damping and
without delay, are Diolaiti et al.'s. Extended here:

- *Delay*, virtual damping and velocity differences move the viscous threshold to the exact boundary
  (the b at which ``critical_stiffness`` is K; the paper's 1/2 is a condition for passivity, which
  coincides with it for a heavy device). This is exact for the linear loop.
- *Virtual damping* also multiplies the step of one count: the torque then jumps by up to
  ``(K + |B| / (N T)) q``, and so the dry threshold is raised to half of ``1 + |B| / (N K T)``. With
  it friction holds a body at rest against half of the greatest step. A bound, not a boundary: a
  wall with less may still be quiet.
- The delay does not change the dry threshold: it changes when a step acts, not its size. That is an
  argument for slow motion, not a proof.
"""

from __future__ import annotations

from enum import StrEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from haptic_wall.controller.theory.checks import (
    FloatArray,
    broadcast,
    not_negative,
    number,
    positive,
    samples,
)
from haptic_wall.controller.theory.exact import critical_stiffness
from haptic_wall.controller.theory.servos import SERVOS


class Region(StrEnum):
    """Behaviour of a wall."""

    STABLE = "stable"
    LIMIT_CYCLE = "limit cycle"
    LOCALLY_STABLE = "locally stable"
    UNSTABLE = "unstable"


class Place(NamedTuple):
    """Places of walls in the plane; each field has the broadcast shape of the arguments."""

    viscous: FloatArray
    """b / (K T)"""
    dry: FloatArray
    """c / (K q); inf without quantisation"""
    viscous_enough: NDArray[np.bool_]
    """K is below the critical stiffness"""
    dry_threshold: FloatArray
    """The value that ``dry`` must reach"""
    region: NDArray[np.object_]
    """A ``Region`` for each; a single one for scalars"""


class ServoPlace(NamedTuple):
    """The place of a wall on a servo."""

    name: str
    viscous: float
    dry: float
    region: Region


def place(
    inertia: ArrayLike,
    damping: ArrayLike,
    coulomb: ArrayLike,
    encoder_step: ArrayLike,
    stiffness: ArrayLike,
    virtual_damping: ArrayLike,
    period: ArrayLike,
    delay: ArrayLike,
    velocity_samples: ArrayLike = 1,
) -> Place:
    """Return the place of a two-sided wall in the plane, and its behaviour there.

    Args:
        inertia: m > 0 [kg·m²].
        damping: Viscous damping b >= 0 [N·m·s/rad].
        coulomb: Coulomb friction c >= 0 [N·m].
        encoder_step: One count q >= 0 [rad]; 0: no quantisation.
        stiffness: K > 0 [N·m/rad].
        virtual_damping: B [N·m·s/rad].
        period: T > 0 [s].
        delay: t_d >= 0, from the sample to its torque acting [s].
        velocity_samples: N of the velocity difference, >= 1.

    Raises:
        ValueError: An argument is outside of its domain; the message names it.

    Source: Diolaiti et al., IEEE T-RO 22(2), 2006, the regions; extended as the module says.
    """
    m, b, c, q, k, big_b, t, t_d, n = broadcast(
        inertia=positive("inertia", inertia),
        damping=not_negative("damping", damping),
        coulomb=not_negative("coulomb", coulomb),
        encoder_step=not_negative("encoder_step", encoder_step),
        stiffness=positive("stiffness", stiffness),
        virtual_damping=number("virtual_damping", virtual_damping),
        period=positive("period", period),
        delay=not_negative("delay", delay),
        velocity_samples=samples("velocity_samples", velocity_samples),
    )
    dry = np.where(q > 0, c / np.where(q > 0, k * q, 1.0), np.inf)
    threshold = 0.5 * (1 + np.abs(big_b) / (n * k * t))
    enough = np.asarray(k < critical_stiffness(m, b, big_b, t, t_d, n))
    rows = np.where(
        enough,
        np.where(dry >= threshold, Region.STABLE, Region.LIMIT_CYCLE),
        np.where((dry >= threshold) & (c > 0), Region.LOCALLY_STABLE, Region.UNSTABLE),
    )
    region = np.array([Region(str(x)) for x in rows.ravel()], dtype=object).reshape(rows.shape)
    return Place((b / (k * t))[()], dry[()], enough[()], threshold[()], region[()])


def servo_places(
    stiffness: float, virtual_damping: float, period: float, delay: float
) -> list[ServoPlace]:
    """Return the places of one wall on every servo of ``SERVOS``.

    Args:
        stiffness: K > 0 [N·m/rad].
        virtual_damping: B [N·m·s/rad].
        period: T > 0 [s].
        delay: t_d >= 0, from the sample to its torque acting [s].

    Raises:
        ValueError: An argument is outside of its domain; the message names it.
    """
    found = []
    for facts in SERVOS.values():
        at = place(
            facts.inertia,
            facts.damping,
            facts.coulomb,
            facts.encoder_step,
            stiffness,
            virtual_damping,
            period,
            delay,
        )
        region = Region(str(at.region))
        found.append(ServoPlace(facts.name, float(at.viscous), float(at.dry), region))
    return found
