"""The believed servo in a sweep: its limits, and the theory's predictions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from haptic_wall.controller.errors import UserError
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.theory import critical_stiffness, linear_limit, max_virtual_damping
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.controller.theory.exact import critical_point
from haptic_wall.controller.theory.friction import onset_amplitude

_DAMPINGS = np.concatenate([[0.0], np.geomspace(1e-4, 1e4, 500)])
"""Tried equivalent dampings of friction, as multiples of the damping of the limit without friction
"""


@dataclass(frozen=True, slots=True)
class Device:
    """The belief about the servo that a sweep needs; in commanded units.

    A body of inertia m and damping b under torques g u (torque gain g) moves like one of m/g and
    b/g under u.
    """

    inertia: float
    damping: float
    coulomb: float
    period: float
    velocity_samples: int
    torque_limit: float
    max_speed: float
    position_step: float
    """[rad]; 0: not quantised"""
    worst: tuple[float, float, float]
    """Lowest inertia and damping, longest lag, in commanded units"""
    lag: float
    """Believed time from sending a torque until it acts [s]"""
    heaviest: float
    """Highest inertia"""

    @classmethod
    def of(cls, config: Config) -> Device:
        """Return the believed servo of a configuration.

        Raises:
            UserError: Its torque limit is not known beforehand.
        """
        belief, servo = config.belief(), config.servo
        gain = belief.torque_gain
        limit = servo.torque_limit
        if limit is None and servo.kind == "simulated":
            limit = config.true_servo().torque_limit
        if limit is None:
            raise UserError(
                "found null",
                field="servo.torque_limit",
                wanted="a torque [N·m]: a sweep plans its kicks by it",
                advice="set it, for instance to the servo's stall torque",
            )
        return cls(
            inertia=belief.inertia.value / gain.value,
            damping=belief.damping.value / gain.value,
            coulomb=belief.coulomb.value / gain.value,
            period=config.period_s,
            velocity_samples=config.wall.velocity_samples,
            torque_limit=limit,
            max_speed=config.driven_speed,
            position_step=servo.position_step,
            worst=(
                belief.inertia.low / gain.high,
                belief.damping.low / gain.high,
                belief.delay.high,
            ),
            lag=belief.delay.value,
            heaviest=belief.inertia.high / gain.low,
        )

    def exact(self, virtual_damping: float, delay: float) -> float:
        """Return the critical stiffness without friction [N·m/rad]; 0: none."""
        loop = (self.inertia, self.damping, virtual_damping, self.period, delay)
        return float(critical_stiffness(*loop, self.velocity_samples))

    def linear(self, virtual_damping: float, delay: float) -> float:
        """Return the linear condition's limit [N·m/rad]."""
        return float(linear_limit(self.damping, virtual_damping, self.period, delay))

    def ceiling(self, delay: float) -> float:
        """Return the virtual damping above which nothing is stable [N·m·s/rad]."""
        loop = (self.inertia, self.damping, self.period, delay)
        return float(max_virtual_damping(*loop, self.velocity_samples))

    def onset(
        self, stiffness: FloatArray, virtual_damping: float, delay: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return the amplitude above which motion grows [rad], and its frequency [Hz]."""
        found = onset_amplitude(
            self.inertia,
            self.damping,
            self.coulomb,
            stiffness,
            virtual_damping,
            self.period,
            delay,
            self.velocity_samples,
        )
        exact = self.exact(virtual_damping, delay)
        softer = np.sqrt(np.minimum(stiffness / max(exact, 1e-300), 1.0))
        return np.asarray(found.amplitude), np.asarray(found.frequency) * softer

    def onsets(
        self, virtual_damping: float, delay: float
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return stiffness from the limit without friction upward, onset amplitude, frequency.

        It is the inverse of ``onset`` and much faster: friction at an amplitude is a damping, and
        each damping has its limit, so that no equation must be solved.

        Args:
            virtual_damping: One at which some stiffness is stable [N·m·s/rad].
            delay: Believed total [s].

        Returns:
            Three arrays of one shape [N·m/rad], [rad], [Hz]; the first amplitude is inf.

        Source: describing function of Coulomb friction, 4 c/(pi A w).
        """
        scale = self.exact(virtual_damping, delay) * (0.5 * self.period + delay)
        extra = scale * _DAMPINGS
        damping = self.damping + extra
        loop = (self.inertia, damping, virtual_damping, self.period, delay)
        found = critical_point(*loop, self.velocity_samples)
        frequency = np.asarray(found.frequency)
        amplitude = np.full(extra.size, np.inf)
        amplitude[1:] = 2.0 * self.coulomb / (np.pi**2 * extra[1:] * frequency[1:])
        return np.asarray(found.stiffness), amplitude, frequency
