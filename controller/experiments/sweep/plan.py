"""Plans one point of a sweep: the soft spring, the kick, and the highest stiffness.

All of it comes from the belief, before anything moves: the soft spring is stable in the belief's
worst corner, and no stiffness is tried at which torque or speed would exceed its limit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from haptic_wall.controller.experiments.sweep.device import Device
from haptic_wall.controller.laws.program import Phase
from haptic_wall.controller.theory.checks import FloatArray

KICK = 0.1
"""Largest default kick [rad]"""
_KICK_COUNTS = 8.0
"""Smallest default kick [encoder counts]"""
_KICK_TORQUE = 0.5
"""Fraction of the torque limit that the spring may command at such a kick"""
_QUICK = 0.15
"""Largest product of the soft spring's angular frequency and the delay"""
_QUICKEST = 60.0
"""Largest angular frequency of the soft spring [rad/s]"""
_RATIO = 0.5
"""Its damping ratio"""
_CALM = 0.05
"""Fraction of the torque limit that one encoder count may command through its damping"""
_UNDER = 0.5
"""Largest fraction of the ceiling in that corner that it damps with"""
_SURE = 0.3
"""Largest fraction of the critical stiffness at the belief's worst corner"""
_GROWN = 1.6
"""Growth at which a trial ends [kicks]"""
_ROOM = 1.15
"""Growth that torque and speed limit must allow"""
_HALF_CYCLES = 12
_LEAST_S, _MOST_S = 0.5, 8.0
"""Least and largest duration of a trial [s]"""
_LEAST_STILL_S = 0.1
_TRAVEL_S = 0.3
"""Time of the soft spring for one kick [s]"""


@dataclass(frozen=True, slots=True)
class Options:
    """Options of a sweep, without its points."""

    kick: float | None = None
    """[rad]; None: chosen for each point"""
    repeats: int = 2
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


def reach(device: Device, setting: PlanePoint, delay: float, kick: float | None) -> Reach:
    """Return the range of stiffnesses at a point, and the kick.

    Args:
        device: The belief.
        setting: The point, with a virtual damping at which some stiffness is stable.
        delay: Believed total [s].
        kick: Requested [rad]; None: the largest up to ``KICK`` that the torque limit allows.
    """
    damping = setting.virtual_damping
    stiffness, amplitude, frequency = device.onsets(damping, delay)
    speed_share = 2.0 * np.pi * frequency
    torque = np.hypot(stiffness, damping * speed_share)
    if kick is None:
        least = min(_KICK_COUNTS * device.position_step, KICK)
        kicks = KICK * np.geomspace(1.0, max(least / KICK, 1e-4), 60)
        at = np.array([_balanced(stiffness, amplitude, k) for k in kicks])
        asked = kicks * np.interp(at, stiffness, torque)
        room = np.flatnonzero(
            (asked <= _KICK_TORQUE * device.torque_limit)
            & (kicks * np.interp(at, stiffness, speed_share) <= 0.5 * device.max_speed)
        )
        kick = float(kicks[room[0]] if room.size else kicks[-1])
    predicted = _balanced(stiffness, amplitude, kick)
    below = np.geomspace(1e-3, 1.0, 200, endpoint=False)
    softer = np.concatenate([stiffness[0] * below, stiffness])
    # Below the limit a spring and a mass, about.
    speed_share = np.concatenate([speed_share[0] * np.sqrt(below), speed_share])
    torque = np.hypot(softer, damping * speed_share) * kick * _ROOM
    by_torque = torque <= device.torque_limit
    by_speed = speed_share * kick * _ROOM <= device.max_speed
    possible = np.flatnonzero(by_torque & by_speed)
    top = float(softer[possible[-1]]) if possible.size else 0.0
    beyond = min(int(possible[-1]) + 1 if possible.size else 0, softer.size - 1)
    bound_by = "safety.max_speed" if by_torque[beyond] else "servo.torque_limit"
    return Reach(kick, predicted, top, bound_by)


def _balanced(stiffness: FloatArray, amplitude: FloatArray, kick: float) -> float:
    """Return the stiffness whose onset is the kick [N·m/rad]; without friction the exact limit."""
    below = np.flatnonzero(amplitude <= kick)
    if below.size == 0:
        return float(stiffness[-1])
    n = int(below[0])
    if not np.isfinite(amplitude[n - 1]) or amplitude[n] == 0.0:
        # The onset falls from infinity at the limit itself.
        return float(stiffness[max(n - 1, 0)])
    x = np.log(amplitude[n - 1 : n + 1])
    share = (x[0] - np.log(kick)) / (x[0] - x[1])
    return float(stiffness[n - 1] * (stiffness[n] / stiffness[n - 1]) ** share)


@dataclass(frozen=True, slots=True)
class HoldingSpring:
    """The soft spring that moves the shaft and holds it before the release."""

    stiffness: float
    damping: float
    torque: float
    """Additional torque in the direction of travel against friction [N·m]"""
    still_s: float
    still_band: float

    def phase(self, center: float, sign: float, kick: float) -> Phase:
        """Move the shaft to ``center`` [rad], from the other side or from the middle."""
        speed = kick / _TRAVEL_S
        return Phase(
            seconds=4.0 + 2.0 * abs(center) / speed,
            stiffness=self.stiffness,
            damping=self.damping,
            center=center,
            speed=speed,
            torque=sign * self.torque,
            still_s=self.still_s,
            still_band=self.still_band,
        )


def hold_spring(device: Device, delay_steps: int, age: float, kick: float) -> HoldingSpring:
    """Return a surely stable spring: far below the limit in the belief's worst corner.

    Args:
        device: The belief.
        delay_steps: Inserted.
        age: Longest assumed age of a sample [s].
        kick: [rad]
    """
    worst = device.worst
    delay = delay_steps * device.period + device.longest_lag + age
    step = device.position_step
    most = np.inf if step == 0.0 else _CALM * device.torque_limit * device.period / step
    rate = min(_QUICK / (delay + 0.5 * device.period), _QUICKEST)
    most = min(most, _UNDER * worst.ceiling(delay))
    rate = min(rate, (worst.damping + most) / (2.0 * _RATIO * worst.inertia))
    added = max(2.0 * _RATIO * worst.inertia * rate - worst.damping, 0.0)
    limit = float(worst.critical(added, delay).stiffness)
    stiffness = min(worst.inertia * rate * rate, _SURE * limit)
    rate = float(np.sqrt(stiffness / device.heaviest))
    return HoldingSpring(
        stiffness=stiffness,
        damping=added,
        torque=device.coulomb,
        still_s=max(0.1, 1.5 / rate),
        still_band=max(1.5 * step, 1e-3 * kick),
    )


def trial_phase(
    device: Device, setting: PlanePoint, delay: float, stiffness: float, kick: float
) -> Phase:
    """Return the wall itself, about the program's start, until its motion is decided."""
    frequency = device.onset(stiffness, setting.virtual_damping, delay)[1]
    torque = float(np.hypot(stiffness, setting.virtual_damping * 2.0 * np.pi * frequency))
    largest = max(min(_GROWN * kick, device.torque_limit / torque), _ROOM * kick)
    cycle = 1.0 / frequency
    return Phase(
        seconds=min(max(0.5 * _HALF_CYCLES * cycle, _LEAST_S), _MOST_S),
        stiffness=stiffness,
        damping=setting.virtual_damping,
        reach=largest,
        still_s=max(2.0 * cycle, _LEAST_STILL_S) + delay,
        still_band=max(1.5 * device.position_step, 1e-3 * kick),
    )
