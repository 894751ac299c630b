"""The believed servo of a sweep: its limits, and the stiffness that sustains an oscillation."""

from __future__ import annotations

import math
from dataclasses import dataclass

from haptic_wall.controller.experiments.holding import torque_limit_of
from haptic_wall.controller.experiments.linear_loop import LinearLoop
from haptic_wall.controller.guard.belief import HEAVIEST, Belief
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.theory import linear_limit
from haptic_wall.controller.theory.harmonic import Lossy, kick_limit

_ROUNDS = 6
"""Rounds in which the damping of friction and the frequency are found that belong together"""


def believed_loop(config: Config, inertia: float, damping: float, gain: float) -> LinearLoop:
    """Return the loop of a servo of a configuration's belief, in commanded units.

    A body of inertia m and damping b under torques g u (torque gain g) moves like one of m/g and
    b/g under u. A load that vibrates too fast to be sampled is counted as rigid.

    Args:
        config: Its belief has the load.
        inertia: [kg·m²]
        damping: [N·m·s/rad]
        gain: Acting over commanded torque.
    """
    belief, period = config.belief(), config.period_s
    load = None
    if belief.bare:
        inertia += belief.load_inertia.value
    if belief.is_flexible and not belief.is_fast(period):
        load = _load(belief, inertia, gain)
    rest = (config.wall.velocity_samples, config.velocity_filter(), load, belief.encoder)
    return LinearLoop(inertia / gain, damping / gain, period, *rest)


def _load(belief: Belief, inertia: float, gain: float) -> tuple[float, float, float]:
    rate = math.tau * belief.flexible_hz.value
    load = min(belief.load_inertia.value, HEAVIEST * inertia)
    moving = load * (inertia - load) / inertia / gain
    damping = 2.0 * belief.flexible_damping_ratio.value * moving * rate
    return load / gain, moving * rate**2, damping


@dataclass(frozen=True, slots=True)
class Device:
    """The belief about the servo that a sweep needs; in commanded units."""

    loop: LinearLoop
    worst: LinearLoop
    """With the lowest inertia and damping"""
    coulomb: float
    torque_limit: float
    max_speed: float
    position_step: float
    """[rad]; 0: not quantised"""
    lag: float
    """Believed time from sending a torque until it acts [s]"""
    longest_lag: float
    heaviest: float
    """Highest inertia"""
    backlash: float
    """Between shaft and encoder [rad]"""

    @classmethod
    def of(cls, config: Config) -> Device:
        """Return the believed servo of a configuration.

        Raises:
            UserError: A real servo's torque limit is not configured.
        """
        belief = config.belief()
        gain = belief.torque_gain
        inertia, damping = belief.inertia, belief.damping
        return cls(
            loop=believed_loop(config, inertia.value, damping.value, gain.value),
            worst=believed_loop(config, inertia.low, damping.low, gain.high),
            coulomb=belief.coulomb.value / gain.value,
            torque_limit=torque_limit_of(config),
            max_speed=config.driven_speed,
            position_step=config.servo.position_step,
            lag=belief.delay.value,
            longest_lag=belief.delay.high,
            heaviest=inertia.high / gain.low,
            backlash=belief.backlash.value,
        )

    @property
    def period(self) -> float:
        """Return the sampling period T [s]."""
        return self.loop.period

    def _critical(
        self, virtual_damping: float, delay: float, friction: float
    ) -> tuple[float, float]:
        """Return the critical stiffness and its frequency with more viscous friction."""
        at = self.loop.critical(virtual_damping, delay, friction)
        return float(at.stiffness), float(at.frequency)

    def exact(self, virtual_damping: float, delay: float) -> float:
        """Return the critical stiffness without friction [N·m/rad]; 0: none."""
        return self._critical(virtual_damping, delay, 0.0)[0]

    def linear(self, virtual_damping: float, delay: float) -> float:
        """Return the linear condition's limit [N·m/rad]."""
        return float(linear_limit(self.loop.damping, virtual_damping, self.period, delay))

    def sustained(self, virtual_damping: float, delay: float, amplitude: float) -> float | None:
        """Return the stiffness that sustains an amplitude, with friction and backlash [N·m/rad].

        None: no stiffness does. With a load backlash is not counted.

        Source: describing function of Coulomb friction, 4 c/(pi A w).
        """
        if self.coulomb == 0.0 and self.backlash == 0.0:
            return self.exact(virtual_damping, delay) or None
        if self.loop.load is not None:
            stiffness, frequency = self._critical(virtual_damping, delay, 0.0)
            friction = 0.0
            for each in range(_ROUNDS if frequency else 0):
                found = 2.0 * self.coulomb / (math.pi**2 * amplitude * frequency)
                friction = 0.5 * (friction + found) if each else found
                stiffness, frequency = self._critical(virtual_damping, delay, friction)
            return stiffness or None
        servo = Lossy(self.loop.inertia, self.loop.damping, self.coulomb, self.backlash)
        loop = virtual_damping, self.period, delay, amplitude, self.loop.samples
        found = kick_limit(servo, *loop)
        return found if math.isfinite(found) else None
