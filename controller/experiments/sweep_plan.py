"""What one point of a sweep asks of the servo: the soft spring, the kick, and how stiff to go.

All of it comes from the belief, before anything moves: the spring that moves the shaft is stable in
its worst corner, and no stiffness is tried at which torque or speed would pass its limit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from controller.config import Config
from controller.errors import UserError
from controller.program import Phase
from controller.theory import (
    critical_stiffness,
    linear_limit,
    max_virtual_damping,
)
from controller.theory.checks import FloatArray
from controller.theory.friction import onset_amplitude

KICK = 0.1
"""Largest kick that is chosen where none is asked for [rad]"""
_KICK_COUNTS = 8.0
"""Smallest, in encoder counts"""
_KICK_TORQUE = 0.5
"""Share of the torque limit that the spring may command at such a kick"""
_QUICK = 0.15
"""Stiffness of the soft spring: its angular frequency times the delay, at most"""
_QUICKEST = 60.0
"""... and itself, at most [rad/s]"""
_RATIO = 0.5
"""Its damping ratio"""
_CALM = 0.05
"""Share of the torque limit that one encoder count may command through its damping"""
_SURE = 0.3
"""Share of the critical stiffness at the belief's worst corner that it may have"""
_GROWN = 1.6
"""A trial ends when the motion has grown to this many kicks"""
_ROOM = 1.15
"""Growth for which there must be room below torque and speed limit"""
_HALF_CYCLES = 12
_LEAST_S, _MOST_S = 0.25, 8.0
"""Of a trial [s]"""
_LEAST_STILL_S = 0.1
_TRAVEL_S = 0.3
"""How long a soft spring takes over one kick [s]"""


@dataclass(frozen=True, slots=True)
class Options:
    """What a sweep is asked for beside its points."""

    kick: float | None = None
    """[rad]; None: chosen for each point"""
    repeats: int = 2
    tolerance: float = 0.005
    """Wanted relative standard error"""


@dataclass(frozen=True, slots=True)
class Setting:
    """One point of the plane."""

    virtual_damping: float
    """[N·m·s/rad]"""
    delay_steps: int


@dataclass(frozen=True, slots=True)
class Device:
    """What is believed of the servo, as far as a sweep needs it; in commanded units.

    A torque gain of g makes a body of inertia m and damping b under torques g u the same as one of
    m/g and b/g under u.
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
    """Believed from a torque being sent to its action [s]"""
    heaviest: float
    """Highest inertia"""

    @classmethod
    def of(cls, config: Config) -> Device:
        """The believed servo of a configuration.

        Raises:
            UserError: Its torque has no limit that is known beforehand.
        """
        belief, servo = config.belief(), config.servo
        gain = belief.torque_gain
        limit = servo.torque_limit
        if limit is None and servo.kind == "simulated":
            limit = config.true_servo().torque_limit
        if limit is None:
            raise UserError(
                "servo.torque_limit: found null, wanted a torque [N·m]: a sweep plans its kicks by"
                " it; set it, for instance to the servo's stall torque"
            )
        counts = servo.counts_per_rev if servo.kind != "hardware" else 4096
        return cls(
            inertia=belief.inertia.value / gain.value,
            damping=belief.damping.value / gain.value,
            coulomb=belief.coulomb.value / gain.value,
            period=config.period_s,
            velocity_samples=config.wall.velocity_samples,
            torque_limit=limit,
            max_speed=config.safety.max_speed,
            position_step=2.0 * np.pi / counts if counts else 0.0,
            worst=(
                belief.inertia.low / gain.high,
                belief.damping.low / gain.high,
                belief.delay.high,
            ),
            lag=belief.delay.value,
            heaviest=belief.inertia.high / gain.low,
        )

    def exact(self, virtual_damping: float, delay: float) -> float:
        """Critical stiffness without friction [N·m/rad]; 0: none."""
        loop = (self.inertia, self.damping, virtual_damping, self.period, delay)
        return float(critical_stiffness(*loop, self.velocity_samples))

    def linear(self, virtual_damping: float, delay: float) -> float:
        """The linear condition's limit [N·m/rad]."""
        return float(linear_limit(self.damping, virtual_damping, self.period, delay))

    def ceiling(self, delay: float) -> float:
        """Virtual damping above which nothing is stable [N·m·s/rad]."""
        loop = (self.inertia, self.damping, self.period, delay)
        return float(max_virtual_damping(*loop, self.velocity_samples))

    def onset(
        self, stiffness: FloatArray, virtual_damping: float, delay: float
    ) -> tuple[FloatArray, FloatArray]:
        """Amplitude from which motion grows [rad], and the oscillation's frequency [Hz]."""
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


@dataclass(frozen=True, slots=True)
class Reach:
    """Which stiffnesses a kick can be tried at."""

    kick: float
    """[rad]"""
    predicted: float
    """Stiffness at which motion of that amplitude neither grows nor dies [N·m/rad]"""
    top: float
    """Stiffest that the limits leave room for [N·m/rad]"""
    bound_by: str
    """The limit that says so"""


def reach(device: Device, setting: Setting, delay: float, kick: float | None) -> Reach:
    """How stiff a point can be tried, and with which kick.

    Args:
        device: What is believed.
        setting: The point, of a virtual damping at which some stiffness is stable.
        delay: Believed total [s].
        kick: Asked for [rad]; None: the largest up to ``KICK`` that leaves the torque room.
    """
    damping = setting.virtual_damping
    exact = device.exact(damping, delay)
    stiffness = exact * np.geomspace(1.0, 1000.0, 400)
    amplitude, frequency = device.onset(stiffness, damping, delay)
    amplitude[0] = np.inf
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
    softer = np.concatenate([exact * np.geomspace(1e-3, 1.0, 200, endpoint=False), stiffness])
    _, frequency = device.onset(softer, damping, delay)
    speed_share = 2.0 * np.pi * frequency
    torque = np.hypot(softer, damping * speed_share) * kick * _ROOM
    by_torque = torque <= device.torque_limit
    by_speed = speed_share * kick * _ROOM <= device.max_speed
    possible = np.flatnonzero(by_torque & by_speed)
    top = float(softer[possible[-1]]) if possible.size else 0.0
    beyond = min(int(possible[-1]) + 1 if possible.size else 0, softer.size - 1)
    bound_by = "safety.max_speed" if by_torque[beyond] else "servo.torque_limit"
    return Reach(kick, predicted, top, bound_by)


def _balanced(stiffness: FloatArray, amplitude: FloatArray, kick: float) -> float:
    """Stiffness whose onset is at the kick [N·m/rad]; without friction the exact limit."""
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
class Hold:
    """The soft spring that moves the shaft and holds it before it is let go."""

    stiffness: float
    damping: float
    torque: float
    """Beside it, in the direction of travel: what friction will take [N·m]"""
    still_s: float
    still_band: float

    def phase(self, center: float, sign: float, kick: float) -> Phase:
        """Move the shaft to ``center`` [rad], coming from the other side or from the middle."""
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


def hold_spring(device: Device, delay_steps: int, age: float, kick: float) -> Hold:
    """A spring that is surely stable: far below the limit in the belief's worst corner.

    Args:
        device: What is believed.
        delay_steps: Inserted.
        age: Longest age of a sample that is reckoned with [s].
        kick: [rad]
    """
    inertia, damping, lag = device.worst
    delay = delay_steps * device.period + lag + age
    step = device.position_step
    most = np.inf if step == 0.0 else _CALM * device.torque_limit * device.period / step
    rate = min(_QUICK / (delay + 0.5 * device.period), _QUICKEST)
    rate = min(rate, (damping + most) / (2.0 * _RATIO * inertia))
    added = max(2.0 * _RATIO * inertia * rate - damping, 0.0)
    loop = (inertia, damping, added, device.period, delay)
    limit = float(critical_stiffness(*loop, device.velocity_samples))
    stiffness = min(inertia * rate * rate, _SURE * limit)
    rate = float(np.sqrt(stiffness / device.heaviest))
    return Hold(
        stiffness=stiffness,
        damping=added,
        torque=device.coulomb,
        still_s=max(0.1, 1.5 / rate),
        still_band=max(1.5 * step, 1e-3 * kick),
    )


def trial_phase(
    device: Device, setting: Setting, delay: float, stiffness: float, kick: float
) -> Phase:
    """The wall itself, about where the program began, until motion has told what it does."""
    at = np.array([stiffness])
    frequency = float(device.onset(at, setting.virtual_damping, delay)[1][0])
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
