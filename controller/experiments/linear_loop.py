"""A servo without Coulomb friction in its loop, with a load and a filter of the velocity or not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from haptic_wall.controller.theory.boundary import CriticalPoint, chain_boundary, chain_ceiling
from haptic_wall.controller.theory.chain import Chain, one_mass, two_masses
from haptic_wall.controller.theory.velocity_filter import VelocityFilter
from haptic_wall.hw.truth import EncoderSide


@dataclass(frozen=True, slots=True)
class LinearLoop:
    """A servo, and the velocity of its two-sided wall."""

    inertia: float
    """Of everything that turns [kg·m²]"""
    damping: float
    """[N·m·s/rad]"""
    period: float
    """T [s]"""
    samples: int
    """N of the velocity difference"""
    velocity_filter: VelocityFilter | None = None
    """Of the velocity that damps"""
    load: tuple[float, float, float] | None = None
    """Inertia, stiffness and damping of the part behind the transmission; None: rigid"""
    encoder: EncoderSide = "output"

    def chain(self, friction: float = 0.0) -> Chain:
        """Return the masses that move, one or two, with more viscous friction [N·m·s/rad]."""
        damping = self.damping + friction
        if self.load is None:
            return one_mass(self.inertia, damping)[0]
        motor = self.inertia - self.load[0]
        return two_masses(motor, damping, *self.load, encoder=self.encoder)[0]

    def critical(
        self, virtual_damping: ArrayLike, delay: ArrayLike, friction: float = 0.0
    ) -> CriticalPoint:
        """Return the critical stiffness, with its frequency, in the broadcast shape.

        Args:
            virtual_damping: B [N·m·s/rad].
            delay: Total [s].
            friction: More viscous friction [N·m·s/rad].
        """
        loop = (self.period, delay, self.samples, self.velocity_filter)
        return chain_boundary(self.chain(friction), (), virtual_damping, *loop)

    def ceiling(self, delay: float) -> float:
        """Return the virtual damping above which nothing is stable [N·m·s/rad]."""
        loop = (self.period, delay, self.samples, self.velocity_filter)
        chains = [self.chain(), one_mass(self.inertia, self.damping)[0]]
        return min(float(np.asarray(chain_ceiling(each, (), *loop))) for each in chains)
