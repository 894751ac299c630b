"""The believed servo of a sweep: its limits, with load and filter, and the onset of motion."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from haptic_wall.controller.experiments.holding import torque_limit_of
from haptic_wall.controller.guard.belief import HEAVIEST, Belief
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.theory import linear_limit
from haptic_wall.controller.theory.boundary import CriticalPoint, chain_boundary, chain_ceiling
from haptic_wall.controller.theory.chain import one_mass, two_masses
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.controller.theory.harmonic import Lossy, kick_limit
from haptic_wall.controller.theory.velocity_filter import VelocityFilter
from haptic_wall.hw.truth import EncoderSide

_DAMPINGS = np.concatenate([[0.0], np.geomspace(1e-4, 1e4, 500)])
"""Tried equivalent dampings of friction, as multiples of the damping of the limit without friction
"""


@dataclass(frozen=True, slots=True)
class BelievedLoop:
    """A servo without Coulomb friction, and the velocity of its wall, in commanded units.

    A body of inertia m and damping b under torques g u (torque gain g) moves like one of m/g and
    b/g under u.
    """

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

    @classmethod
    def of(cls, config: Config, inertia: float, damping: float, gain: float) -> BelievedLoop:
        """Return the loop of a servo of a configuration's belief.

        A load that vibrates too fast to be sampled is counted as rigid.

        Args:
            config: Its belief has the load.
            inertia: [kg·m²]
            damping: [N·m·s/rad]
            gain: Acting over commanded torque.
        """
        belief, period = config.belief(), config.period_s
        load = None
        if belief.is_flexible and not belief.is_fast(period):
            load = _load(belief, inertia, gain)
        rest = (config.wall.velocity_samples, config.velocity_filter(), load, belief.encoder)
        return cls(inertia / gain, damping / gain, period, *rest)

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
        if self.load is None:
            chain, shape = one_mass(self.inertia, damping)
        else:
            motor = self.inertia - self.load[0]
            chain, shape = two_masses(motor, damping, *self.load, encoder=self.encoder)
        loop = (self.period, delay, self.samples, self.velocity_filter)
        return chain_boundary(chain, shape, virtual_damping, *loop)

    def ceiling(self, delay: float) -> float:
        """Return the virtual damping above which nothing is stable [N·m·s/rad]."""
        loop = (self.period, delay, self.samples, self.velocity_filter)
        chain, shape = one_mass(self.inertia, self.damping)
        found = float(chain_ceiling(chain, shape, *loop))
        if self.load is not None:
            motor = self.inertia - self.load[0]
            chain, shape = two_masses(motor, self.damping, *self.load, encoder=self.encoder)
            found = min(found, float(chain_ceiling(chain, shape, *loop)))
        return found


def _load(belief: Belief, inertia: float, gain: float) -> tuple[float, float, float]:
    rate = math.tau * belief.flexible_hz.value
    load = min(belief.load_inertia.value, HEAVIEST * inertia)
    moving = load * (inertia - load) / inertia / gain
    damping = 2.0 * belief.flexible_damping_ratio.value * moving * rate
    return load / gain, moving * rate**2, damping


@dataclass(frozen=True, slots=True)
class Device:
    """The belief about the servo that a sweep needs; in commanded units."""

    loop: BelievedLoop
    worst: BelievedLoop
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
            loop=BelievedLoop.of(config, inertia.value, damping.value, gain.value),
            worst=BelievedLoop.of(config, inertia.low, damping.low, gain.high),
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

    def exact(self, virtual_damping: float, delay: float) -> float:
        """Return the critical stiffness without friction [N·m/rad]; 0: none."""
        return float(self.loop.critical(virtual_damping, delay).stiffness)

    def linear(self, virtual_damping: float, delay: float) -> float:
        """Return the linear condition's limit [N·m/rad]."""
        return float(linear_limit(self.damping, virtual_damping, self.period, delay))

    def ceiling(self, delay: float) -> float:
        """Return the virtual damping above which nothing is stable [N·m·s/rad]."""
        return self.loop.ceiling(delay)

    def sustained(self, virtual_damping: float, delay: float, amplitude: float) -> float | None:
        """Return the stiffness that sustains an amplitude, with friction and backlash [N·m/rad].

        None: there are a load or a filter of the velocity, which this theory does not know; inf: no
        stiffness does.
        """
        if self.loop.load is not None or self.loop.velocity_filter is not None:
            return None
        servo = Lossy(self.inertia, self.damping, self.coulomb, self.backlash)
        loop = virtual_damping, self.period, delay, amplitude, self.velocity_samples
        return kick_limit(servo, *loop)

    def onset(self, stiffness: float, virtual_damping: float, delay: float) -> tuple[float, float]:
        """Return the amplitude above which motion grows [rad], and its frequency [Hz]."""
        at, amplitude, frequency = self.onsets(virtual_damping, delay)
        hertz = float(np.interp(stiffness, at, frequency)) * min(stiffness / at[0], 1.0) ** 0.5
        if stiffness <= at[0]:
            return math.inf, hertz
        if amplitude[-1] == 0.0:  # without friction all grows
            return 0.0, hertz
        return float(1.0 / np.interp(stiffness, at, 1.0 / amplitude)), hertz

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
