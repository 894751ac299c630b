"""Plans one point of a sweep: the soft spring, the kick, and the highest stiffness.

All of it comes from the belief, before anything moves: the soft spring is stable in the belief's
worst corner, and no stiffness is tried at which torque or speed would exceed its limit.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from dataclasses import dataclass, replace

import numpy as np

from haptic_wall.controller.experiments.holding import Hold, hold_of, sample_age
from haptic_wall.controller.experiments.sweep.device import Device
from haptic_wall.controller.laws.program import Phase
from haptic_wall.controller.settings.config import Config

KICK = 0.1
"""Largest default kick [rad]"""
_KICK_COUNTS = 8.0
"""Smallest default kick [encoder counts]"""
_KICKS = 60
"""Number of kicks from which the default is chosen"""
_KICK_TORQUE = 0.5
"""Fraction of the torque limit that the spring may command at such a kick"""
_SURE = 0.3
"""Fractions of ceiling and limit that the soft spring of a servo with a load has at most, at the
worst corner of its belief"""
_GROWN = 1.6
"""Growth at which a trial ends [kicks]"""
_ROOM = 1.15
"""Growth that torque and speed limit must allow"""
_HALF_CYCLES = 12
_LEAST_S, _MOST_S = 0.5, 8.0
"""Least and largest duration of a trial [s]"""
_LEAST_STILL_S = 0.1
_STILL_COUNTS = 2.5
"""Motion of the held shaft within this many encoder counts is rest"""
_TRAVEL_S = 0.3
"""Time of the soft spring for one kick [s]"""


@dataclass(frozen=True, slots=True)
class Options:
    """Options of a sweep, without its points."""

    kick: float | None = None
    """[rad]; None: chosen for each point"""
    tolerance: float = 0.005
    """Wanted relative standard error"""


@dataclass(frozen=True, slots=True)
class PlanePoint:
    """One point of the plane."""

    virtual_damping: float
    """[N·m·s/rad]"""
    delay_steps: int


@dataclass(frozen=True, slots=True)
class Reach:
    """The stiffnesses at which a kick can be tried."""

    kick: float
    """[rad]"""
    predicted: float
    """Stiffness at which motion of that amplitude neither grows nor decays [N·m/rad]"""
    top: float
    """Stiffest that the limits allow [N·m/rad]"""
    bound_by: str
    """Name of that limit"""


@dataclass(frozen=True, slots=True)
class Swing:
    """The oscillation that is expected at a point, by the belief."""

    device: Device
    virtual_damping: float
    """One at which some stiffness is stable [N·m·s/rad]"""
    delay: float
    """Believed total [s]"""
    exact: float
    """Critical stiffness without friction [N·m/rad]"""
    rate: float
    """Angular frequency there [rad/s]"""

    @classmethod
    def of(cls, device: Device, virtual_damping: float, delay: float) -> Swing:
        """Return the oscillation at a point."""
        at = device.loop.critical(virtual_damping, delay)
        rate = 2.0 * np.pi * float(at.frequency)
        return cls(device, virtual_damping, delay, float(at.stiffness), rate)

    def rate_at(self, stiffness: float) -> float:
        """Return the angular frequency at a stiffness, about that of a spring and a mass."""
        return self.rate * math.sqrt(stiffness / self.exact)

    def torque_at(self, stiffness: float) -> float:
        """Return the torque of the wall at a stiffness, over the amplitude [N·m/rad]."""
        return math.hypot(stiffness, self.virtual_damping * self.rate_at(stiffness))

    def balanced(self, kick: float) -> float:
        """Return the stiffness at which motion of this amplitude neither grows nor decays."""
        return self.device.sustained(self.virtual_damping, self.delay, kick) or self.exact

    def fits(self, kick: float) -> bool:
        """Whether torque and speed leave room for a kick at its balance."""
        stiffness = self.balanced(kick)
        torque, speed = kick * self.torque_at(stiffness), kick * self.rate_at(stiffness)
        most = self.device.torque_limit, self.device.max_speed
        return torque <= _KICK_TORQUE * most[0] and speed <= 0.5 * most[1]

    def tops(self, kick: float) -> tuple[float, float]:
        """Return the stiffnesses at which torque and speed of a kick reach their limits."""
        most = self.device.torque_limit / (kick * _ROOM)
        fast = self.device.max_speed / (kick * _ROOM * self.rate)
        # The damper's torque grows with the root of the stiffness.
        damper = 0.5 * (self.virtual_damping * self.rate) ** 2 / self.exact
        return math.hypot(damper, most) - damper, self.exact * fast * fast


def reach(device: Device, setting: PlanePoint, delay: float, kick: float | None) -> Reach:
    """Return the range of stiffnesses at a point, and the kick.

    Args:
        device: The belief.
        setting: The point, with a virtual damping at which some stiffness is stable.
        delay: Believed total [s].
        kick: Requested [rad]; None: the largest up to ``KICK`` that the torque limit allows.
    """
    swing = Swing.of(device, setting.virtual_damping, delay)
    if kick is None:
        least = max(min(_KICK_COUNTS * device.position_step / KICK, 1.0), 1e-4)
        kicks = (KICK * np.geomspace(1.0, least, _KICKS)).tolist()
        kick = kicks[bisect_left(kicks[:-1], True, key=swing.fits)]
    by_torque, by_speed = swing.tops(kick)
    bound_by = "servo.torque_limit" if by_torque <= by_speed else "safety.max_speed"
    return Reach(kick, swing.balanced(kick), min(by_torque, by_speed), bound_by)


def soft_spring(config: Config, device: Device, delay_steps: int) -> Hold:
    """Return the spring that moves the shaft and holds it: far below any limit of the belief.

    Args:
        config: The effective configuration.
        device: Its belief.
        delay_steps: Inserted.
    """
    hold = hold_of(config, device.torque_limit, delay_steps)
    if device.worst.load is None:
        return hold
    delay = delay_steps * device.period + device.longest_lag + sample_age(config)
    damping = min(hold.damping, _SURE * device.worst.ceiling(delay))
    limit = float(device.worst.critical(damping, delay).stiffness)
    return replace(hold, stiffness=min(hold.stiffness, _SURE * limit), damping=damping)


def soft_phase(hold: Hold, device: Device, center: float, kick: float) -> Phase:
    """Return the phase that moves the shaft to a place [rad] and lets it rest there."""
    speed = kick / _TRAVEL_S
    return Phase(
        4.0 + 2.0 * abs(center) / speed,
        hold.stiffness,
        hold.damping,
        center,
        speed=speed,
        still_s=max(_LEAST_STILL_S, 1.5 * math.sqrt(device.heaviest / hold.stiffness)),
        still_band=max(_STILL_COUNTS * device.position_step, 1e-4),
    )


def trial_phase(
    device: Device, setting: PlanePoint, delay: float, stiffness: float, kick: float
) -> Phase:
    """Return the wall itself, about the program's start, until its motion is decided."""
    swing = Swing.of(device, setting.virtual_damping, delay)
    largest = max(
        min(_GROWN * kick, device.torque_limit / swing.torque_at(stiffness)), _ROOM * kick
    )
    cycle = 2.0 * math.pi / swing.rate_at(stiffness)
    return Phase(
        seconds=min(max(0.5 * _HALF_CYCLES * cycle, _LEAST_S), _MOST_S),
        stiffness=stiffness,
        damping=setting.virtual_damping,
        reach=largest,
        still_s=max(2.0 * cycle, _LEAST_STILL_S) + delay,
        still_band=max(1.5 * device.position_step, 1e-3 * kick),
    )
