"""Computes the limits of a wall on the believed servo, with load and filter, without friction."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from haptic_wall.controller.guard.belief import HEAVIEST, Belief
from haptic_wall.controller.theory.boundary import CriticalPoint, chain_boundary, chain_ceiling
from haptic_wall.controller.theory.chain import one_mass, two_masses
from haptic_wall.controller.theory.velocity_filter import VelocityFilter
from haptic_wall.hw.truth import EncoderSide


@dataclass(frozen=True, slots=True)
class Link:
    """A load behind a transmission; in commanded units, as ``BelievedLoop``."""

    inertia: float
    stiffness: float
    damping: float
    encoder: EncoderSide


@dataclass(frozen=True, slots=True)
class BelievedLoop:
    """A servo and the velocity of its wall, in commanded units.

    A body of inertia m and damping b under torques g u (torque gain g) moves like one of m/g and
    b/g under u.
    """

    inertia: float
    """Of everything that turns"""
    damping: float
    period: float
    samples: int
    link: Link | None = None
    """The part of the inertia behind the transmission; None: rigid"""
    velocity_filter: VelocityFilter | None = None

    @classmethod
    def of(
        cls,
        belief: Belief,
        inertia: float,
        damping: float,
        gain: float,
        period: float,
        samples: int,
        velocity_filter: VelocityFilter | None,
    ) -> BelievedLoop:
        """Return the loop of a servo of a belief.

        A load that vibrates too fast to be sampled is counted as rigid.

        Args:
            belief: Its load, with the values in the middle.
            inertia: [kg·m²]
            damping: [N·m·s/rad]
            gain: Acting over commanded torque.
            period: T [s].
            samples: N of the velocity difference.
            velocity_filter: Of the velocity that damps; None: none.
        """
        link = None
        if belief.is_flexible and not belief.is_fast(period):
            rate = math.tau * belief.flexible_hz.value
            load = min(belief.load_inertia.value, HEAVIEST * inertia)
            moving = load * (inertia - load) / inertia
            link = Link(
                load / gain,
                moving * rate**2 / gain,
                2.0 * belief.flexible_damping_ratio.value * moving * rate / gain,
                belief.encoder,
            )
        return cls(inertia / gain, damping / gain, period, samples, link, velocity_filter)

    def critical(
        self, virtual_damping: ArrayLike, delay: float, friction: ArrayLike = 0.0
    ) -> CriticalPoint:
        """Return the critical stiffness, with its frequency.

        Args:
            virtual_damping: B [N·m·s/rad].
            delay: Total [s].
            friction: More viscous friction, beside the believed one [N·m·s/rad].
        """
        damping = self.damping + np.asarray(friction, dtype=np.float64)
        if self.link is None:
            chain, shape = one_mass(self.inertia, damping)
        else:
            link = self.link
            rest = (link.inertia, link.stiffness, link.damping)
            chain, shape = two_masses(
                self.inertia - link.inertia, damping, *rest, encoder=link.encoder
            )
        return chain_boundary(
            chain, shape, virtual_damping, self.period, delay, self.samples, self.velocity_filter
        )

    def ceiling(self, delay: float) -> float:
        """Return the virtual damping above which nothing is stable [N·m·s/rad]."""
        rigid, shape = one_mass(self.inertia, self.damping)
        loop = (self.period, delay, self.samples)
        found = float(chain_ceiling(rigid, shape, *loop, self.velocity_filter))
        if self.link is not None:
            link = self.link
            rest = (link.inertia, link.stiffness, link.damping)
            chain, shape = two_masses(
                self.inertia - link.inertia, self.damping, *rest, encoder=link.encoder
            )
            found = min(found, float(chain_ceiling(chain, shape, *loop, self.velocity_filter)))
        return found

    @property
    def is_plain(self) -> bool:
        """Whether the servo is rigid, and its velocity not filtered."""
        return self.link is None and self.velocity_filter is None
