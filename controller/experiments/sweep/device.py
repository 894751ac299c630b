"""Predicts limits and boundary of the believed servo for a sweep."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from haptic_wall.controller.errors import UserError
from haptic_wall.controller.experiments.sweep.believed_loop import BelievedLoop
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.theory import linear_limit, max_virtual_damping
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.controller.theory.harmonic import Lossy, kick_limit
from haptic_wall.controller.theory.velocity_filter import VelocityFilter

_DAMPINGS = np.concatenate([[0.0], np.geomspace(1e-4, 1e4, 500)])
"""Tried equivalent dampings of friction, as multiples of the damping of the limit without friction
"""


@dataclass(frozen=True, slots=True)
class Device:
    """The belief about the servo that a sweep needs; in commanded units."""

    loop: BelievedLoop
    coulomb: float
    torque_limit: float
    max_speed: float
    position_step: float
    """[rad]; 0: not quantised"""
    worst: BelievedLoop
    """With the lowest inertia and damping"""
    longest_lag: float
    lag: float
    """Believed time from sending a torque until it acts [s]"""
    heaviest: float
    """Highest inertia"""
    backlash: float = 0.0
    """Between shaft and encoder [rad]"""

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
                wanted="a torque [N·m], by which a sweep plans its kicks",
                advice="set it, for instance to the servo's stall torque",
            )
        rest = (config.period_s, config.wall.velocity_samples, config.velocity_filter())
        middle = (belief.inertia.value, belief.damping.value, gain.value)
        lowest = (belief.inertia.low, belief.damping.low, gain.high)
        return cls(
            loop=BelievedLoop.of(belief, *middle, *rest),
            coulomb=belief.coulomb.value / gain.value,
            torque_limit=limit,
            max_speed=config.driven_speed,
            position_step=servo.position_step,
            worst=BelievedLoop.of(belief, *lowest, *rest),
            longest_lag=belief.delay.high,
            lag=belief.delay.value,
            heaviest=belief.inertia.high / gain.low,
            backlash=belief.backlash.value,
        )

    @property
    def inertia(self) -> float:
        """Return the inertia of everything that turns."""
        return self.loop.inertia

    @property
    def damping(self) -> float:
        """Return the viscous friction."""
        return self.loop.damping

    @property
    def period(self) -> float:
        """Return the sampling period T [s]."""
        return self.loop.period

    @property
    def velocity_samples(self) -> int:
        """Return N of the velocity difference."""
        return self.loop.samples

    @property
    def velocity_filter(self) -> VelocityFilter | None:
        """Return the filter of the velocity that damps."""
        return self.loop.velocity_filter

    def exact(self, virtual_damping: float, delay: float) -> float:
        """Return the critical stiffness without friction [N·m/rad]; 0: none."""
        return float(self.loop.critical(virtual_damping, delay).stiffness)

    def linear(self, virtual_damping: float, delay: float) -> float:
        """Return the linear condition's limit [N·m/rad]."""
        return float(linear_limit(self.damping, virtual_damping, self.period, delay))

    def ceiling(self, delay: float) -> float:
        """Return the virtual damping above which nothing is stable [N·m·s/rad]."""
        return self.loop.ceiling(delay)

    def rigid_ceiling(self, delay: float) -> float:
        """Return the ceiling without the vibration of a load, and without a filter."""
        loop = (self.inertia, self.damping, self.period, delay)
        return float(max_virtual_damping(*loop, self.velocity_samples))

    def sustained(self, virtual_damping: float, delay: float, amplitude: float) -> float:
        """Return the stiffness that sustains an amplitude, with friction and backlash [N·m/rad].

        A load and a filter of the velocity do not count.
        """
        servo = Lossy(self.inertia, self.damping, self.coulomb, self.backlash)
        loop = virtual_damping, self.period, delay, amplitude, self.velocity_samples
        return kick_limit(servo, *loop)

    def onset(
        self, stiffness: FloatArray, virtual_damping: float, delay: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return the amplitude above which motion grows [rad], and its frequency [Hz]."""
        exact = self.exact(virtual_damping, delay)
        softer = np.sqrt(np.minimum(stiffness / max(exact, 1e-300), 1.0))
        at, amplitude, frequency = self.onsets(virtual_damping, delay)
        return _between(stiffness, at, amplitude), np.interp(stiffness, at, frequency) * softer

    def onsets(
        self, virtual_damping: float, delay: float
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return stiffness from the limit without friction upward, onset amplitude, frequency.

        Friction at an amplitude is a damping, and each damping has its limit, so that no equation
        must be solved.

        Args:
            virtual_damping: One at which some stiffness is stable [N·m·s/rad].
            delay: Believed total [s].

        Returns:
            Three arrays of one shape [N·m/rad], [rad], [Hz]; the first amplitude is inf.

        Source: describing function of Coulomb friction, 4 c/(pi A w).
        """
        return _onsets(self.loop, self.coulomb, virtual_damping, delay)


@lru_cache(maxsize=16)
def _onsets(
    loop: BelievedLoop, coulomb: float, virtual_damping: float, delay: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Compute ``Device.onsets``: with a load that takes a tenth of a second."""
    limit = float(loop.critical(virtual_damping, delay).stiffness)
    extra = limit * (0.5 * loop.period + delay) * _DAMPINGS
    found = loop.critical(virtual_damping, delay, extra)
    frequency, stiffness = np.asarray(found.frequency), np.asarray(found.stiffness)
    amplitude = np.full(extra.size, np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        amplitude[1:] = 2.0 * coulomb / (np.pi**2 * extra[1:] * frequency[1:])
    # with a load the limit may fall again with much friction: motion that small dies
    rises = np.concatenate([[True], np.diff(np.maximum.accumulate(stiffness)) > 0.0])
    return stiffness[rises], amplitude[rises], frequency[rises]


def _between(stiffness: FloatArray, at: FloatArray, amplitude: FloatArray) -> FloatArray:
    """Return onset amplitudes between known ones; infinite up to the first [rad]."""
    above = stiffness > at[0]
    if amplitude[-1] == 0.0:  # without friction all grows
        return np.where(above, 0.0, np.inf)
    inverse = np.interp(stiffness, at, 1.0 / amplitude)
    return np.where(above, 1.0 / np.where(above, inverse, 1.0), np.inf)
