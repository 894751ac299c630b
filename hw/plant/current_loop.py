"""Simulates the current loop of a motor: computes the acting torque from the commanded one.

Everything is in units of torque: a current times the torque constant, and ``u``, the motor's
voltage times torque constant over resistance. The motor makes ::

    torque = u - b w                      b = stall torque / no-load speed

and the loop leads u toward the value that makes the goal at the present speed, which the supply
bounds ::

    u' = rate (u* - u)                    rate = 2 pi bandwidth
    u* = goal + (1 - s |w| / w0) b w      at most the stall torque, either way

A bandwidth of 0 means u = u*, at once. Without back-EMF b is 0 and no supply bounds u. The back-EMF
acts at once and the loop takes it away with its own bandwidth, but for the share s |w| / w0, which
stays: s is the droop at the no-load speed w0.

The motor's voltage is held over steps of ``STEP_NS``, at the mean of its exponential, and the body
moves exactly meanwhile. The impulse of each step is exact, and a change of torque J on an inertia m
leaves an error of the position of at most ``J STEP² / (12 m)`` (1.1e-6 rad for the stall torque of
an XM430 on 0.012 kg·m²); those of a change and its return cancel. Back-EMF is taken at the speed
predicted for the middle of the step, an error of second order too. A step begins where a goal is
taken over, or where the last one ended, so that the motion does not depend on when it is read.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from haptic_wall.hw.truth import TrueServo

STEP_NS: Final = 200_000
"""Longest time over which the voltage is held at its mean [ns]"""
STEP_S: Final = 1e-9 * STEP_NS
_SETTLED: Final = 1e-12
"""Fraction of the goal at which a lag is over"""


class Winding(NamedTuple):
    """The motor as its supply sees it, at the output."""

    stall_torque: float
    """Torque of the full supply voltage at a standstill [N·m]"""
    no_load_speed: float
    """Speed at which the back-EMF equals the supply [rad/s]"""


class Drive(NamedTuple):
    """Numbers of a current loop."""

    rate: float
    """Of the loop [1/s]; 0: at once"""
    dead_band: float
    """[N·m]"""
    back_emf: float
    """b [N·m·s/rad]"""
    droop: float
    """s b / w0 [N·m·s²/rad²]"""
    stall: float
    """Stall torque [N·m]"""
    acts: bool
    """Whether something lies between a commanded torque and the one that acts"""


def drive_of(true: TrueServo, winding: Winding) -> Drive:
    """Return the current loop of a servo."""
    stall, fastest = winding
    back_emf = stall / fastest if true.back_emf else 0.0
    droop = true.current_droop * back_emf / fastest if true.back_emf else 0.0
    acts = any((true.current_bandwidth, true.current_period, true.dead_band))
    return Drive(
        math.tau * true.current_bandwidth,
        true.dead_band,
        back_emf,
        droop,
        stall,
        acts or true.back_emf,
    )


def goal_for(drive: Drive, torque: float) -> float:
    """Return the torque that the loop leads to for a commanded one [N·m]."""
    return math.copysign(max(abs(torque) - drive.dead_band, 0.0), torque)


def target_of(
    drive: Drive, goal: float, u: float, velocity: float, acceleration: float
) -> tuple[float, float, float]:
    """Begin a step of the loop: return target and start of u [N·m], and the braking [N·m·s/rad].

    Args:
        drive: The loop.
        goal: [N·m].
        u: At the end of the last step [N·m].
        velocity: Of the motor [rad/s].
        acceleration: Over the last step [rad/s²]; predicts the speed in the middle of this one.
    """
    target, braking = goal, 0.0
    if drive.back_emf > 0.0:
        speed = velocity + acceleration * (0.5 * STEP_S)
        lost = drive.droop * abs(speed)
        wanted = goal + (drive.back_emf - lost) * speed
        target, braking = min(max(wanted, -drive.stall), drive.stall), drive.back_emf
        if drive.rate == 0.0 and target == wanted:
            # As u = u* at each instant, only the droop is left of the back-EMF: it only brakes.
            target, braking = goal, lost
    if drive.rate == 0.0 or abs(u - target) <= _SETTLED * abs(target):
        u = target
    return target, u, braking


def mean_of(drive: Drive, target: float, u: float, duration: float) -> float:
    """Return the mean of u over a step [N·m]."""
    if u == target:
        return u
    y = drive.rate * duration
    return target + (u - target) * (-math.expm1(-y) / y)


def end_of(drive: Drive, target: float, u: float, duration: float) -> float:
    """Return u at the end of a step [N·m]."""
    return u if u == target else target + (u - target) * math.exp(-drive.rate * duration)


class CurrentLoop:
    """Current control of one motor; the caller moves the body that it drives, in steps.

    ``hold`` gives a torque and a braking to hold until a given time, at most until ``end_ns``;
    ``moved`` ends a step.

    Args:
        true: The servo's true parameters.
        drive: The numbers of its loop.
        start_ns: The time of the first period [ns].

    Attributes:
        begin_ns: Start of the present step [ns].
    """

    def __init__(self, true: TrueServo, drive: Drive, start_ns: int) -> None:
        self._drive = drive
        self._period_ns = round(true.current_period * 1e9)
        self.begin_ns = self._start_ns = start_ns
        self._goal = 0.0
        self._regulated = False
        """Whether a current is controlled; otherwise the motor is limp"""
        self._u = self._target = self._braking = 0.0
        self._duration = 0.0
        self._speed = self._acceleration = 0.0

    @property
    def end_ns(self) -> int:
        """Return the latest end of the present step [ns]."""
        return self.begin_ns + STEP_NS

    @property
    def steady(self) -> bool:
        """Whether the torque stays as it is until something is commanded."""
        follows_speed = self._regulated and self._drive.back_emf > 0.0
        return self._braking == 0.0 and self._u == self._target and not follows_speed

    def feed(self, stall_torque: float) -> None:
        """Change the supply, by what it makes at a standstill [N·m]; acts from the next step on."""
        self._drive = self._drive._replace(stall=stall_torque)

    def taken_over_ns(self, now_ns: int) -> int:
        """Return when a command that arrives at ``now_ns`` is taken over: at a tick of the loop."""
        period_ns = self._period_ns
        if not period_ns:
            return now_ns
        return now_ns + (self._start_ns - now_ns) % period_ns

    def take(self, goal: float | None, velocity: float, now_ns: int) -> None:
        """Begin a step with a new goal.

        Args:
            goal: Torque of the current [N·m]; None: the motor is limp.
            velocity: Velocity of the body [rad/s].
            now_ns: The time [ns].
        """
        torque = self.torque(velocity)
        self._regulated = goal is not None
        if goal is None:
            self._goal = self._u = self._target = self._braking = 0.0
        else:
            self._goal = goal_for(self._drive, goal)
            # The current does not jump; where there is no lag it need not be known.
            self._u = torque + self._drive.back_emf * velocity
        self._begin(velocity, now_ns)

    def hold(self, until_ns: int) -> tuple[float, float]:
        """Return torque [N·m] and braking [N·m·s/rad] to hold from ``begin_ns`` to ``until_ns``."""
        duration = (until_ns - self.begin_ns) * 1e-9
        self._duration = duration
        return mean_of(self._drive, self._target, self._u, duration), self._braking

    def moved(self, velocity: float, until_ns: int) -> None:
        """End the step at ``until_ns`` [ns], at this velocity [rad/s]; the next begins there."""
        self._acceleration = (velocity - self._speed) / self._duration
        self._u = self._value()
        self._begin(velocity, until_ns)

    def torque(self, velocity: float) -> float:
        """Return the torque that acts where the last motion ended [N·m].

        Args:
            velocity: Velocity of the body there [rad/s].
        """
        return self._value() - self._braking * velocity

    def _value(self) -> float:
        """Return u where the last ``hold`` ended."""
        return end_of(self._drive, self._target, self._u, self._duration)

    def _begin(self, velocity: float, now_ns: int) -> None:
        """Begin a step: compute the target of u for the speed expected in its middle."""
        self.begin_ns = now_ns
        self._duration = 0.0
        self._speed = velocity
        if self._regulated:
            self._target, self._u, self._braking = target_of(
                self._drive, self._goal, self._u, velocity, self._acceleration
            )
