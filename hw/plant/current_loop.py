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
moves exactly meanwhile. A held torque is what every friction law of the body takes; a closed form
would exist for one of them. The impulse of each step is exact, so that the speed at its end is, and
a change of torque J on an inertia m leaves an error of the position of at most ::

    J STEP² / (12 m)

(1.1e-6 rad for the stall torque of an XM430 on 0.012 kg·m²). The errors of a change and of its
return cancel, so that many changes leave no more than the largest one. Back-EMF is taken at the
speed predicted for the middle of the step, an error of second order too.

A step begins where a goal is taken over, or where the last one ended, so that the motion does not
depend on the times at which it is read.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from haptic_wall.hw.errors import SpecError
from haptic_wall.hw.settings import TrueServo

STEP_NS: Final = 200_000
"""Longest time over which the voltage is held at its mean [ns]"""
_SETTLED: Final = 1e-12
"""Fraction of the goal at which a lag is over"""


class Winding(NamedTuple):
    """The motor as its supply sees it, at the output."""

    stall_torque: float
    """Torque of the full supply voltage at a standstill [N·m]"""
    no_load_speed: float
    """Speed at which the back-EMF equals the supply [rad/s]"""


class CurrentLoop:
    """Current control of one motor; the caller moves the body that it drives.

    The caller moves the body in steps: ``hold`` gives a torque and a braking to hold until a given
    time, at most until ``end_ns``; ``moved`` ends a step.

    Args:
        true: The servo's true parameters.
        winding: The motor.
        start_ns: The time of the first period [ns].

    Raises:
        ValueError: A value is out of range.
    """

    __slots__ = (
        "_acceleration",
        "_back_emf",
        "_braking",
        "_dead_band",
        "_droop",
        "_duration",
        "_filter_rate",
        "_goal",
        "_mean",
        "_period_ns",
        "_rate",
        "_regulated",
        "_sensed",
        "_sensed_now",
        "_speed",
        "_start_ns",
        "_target",
        "_u",
        "_winding",
        "begin_ns",
    )

    def __init__(self, true: TrueServo, winding: Winding, start_ns: int) -> None:
        for name, value, unit in (
            ("current_bandwidth", true.current_bandwidth, "Hz"),
            ("current_period", true.current_period, "s"),
            ("current_droop", true.current_droop, "(a fraction)"),
            ("dead_band", true.dead_band, "N·m"),
            ("current_filter", true.current_filter, "Hz"),
        ):
            if not 0.0 <= value < math.inf:
                raise SpecError(f"{name} is {value} {unit}", advice="give a finite value from 0 up")
        if true.back_emf and not winding.no_load_speed > 0.0:
            raise SpecError(
                f"no_load_speed is {winding.no_load_speed} rad/s", advice="give a value above 0"
            )
        self._rate = math.tau * true.current_bandwidth
        self._period_ns = round(true.current_period * 1e9)
        self._start_ns = start_ns
        self._dead_band = true.dead_band
        self._filter_rate = math.tau * true.current_filter
        self._back_emf = self._droop = 0.0
        self._winding = winding
        if true.back_emf:
            self._back_emf = winding.stall_torque / winding.no_load_speed
            self._droop = true.current_droop * self._back_emf / winding.no_load_speed
        self.begin_ns = start_ns
        """Start of the present step [ns]"""
        self._goal = 0.0
        self._regulated = False
        """Whether a current is controlled; otherwise a voltage is held, or the motor is limp"""
        self._u = self._target = self._mean = self._braking = 0.0
        self._duration = 0.0
        self._speed = self._acceleration = 0.0
        self._sensed = self._sensed_now = 0.0

    @property
    def end_ns(self) -> int:
        """Return the latest end of the present step [ns]."""
        return self.begin_ns + STEP_NS

    @property
    def steady(self) -> bool:
        """Whether the torque stays as it is until something is commanded."""
        return self._braking == 0.0 and self._u == self._target and not self._follows_speed

    @property
    def sensed(self) -> float:
        """Return the measured torque, behind its filter [N·m]."""
        return self._sensed_now

    def feed(self, stall_torque: float) -> None:
        """Change the supply, by what it makes at a standstill [N·m]; acts from the next step on."""
        self._winding = self._winding._replace(stall_torque=stall_torque)

    def taken_over_ns(self, now_ns: int) -> int:
        """Return when a command that arrives at ``now_ns`` is taken over: at a tick of the loop."""
        period_ns = self._period_ns
        if not period_ns:
            return now_ns
        return now_ns + (self._start_ns - now_ns) % period_ns

    def take(self, goal: float, braking: float | None, velocity: float, now_ns: int) -> None:
        """Begin a step with a new goal.

        Args:
            goal: Torque [N·m].
            braking: 0: ``goal`` is a current's; above 0: a voltage is held, with this loss of
                torque with the velocity [N·m·s/rad]; None: the motor is limp.
            velocity: Velocity of the body [rad/s].
            now_ns: The time [ns].
        """
        torque = self.torque(velocity)
        self._regulated = braking == 0.0
        if braking is None:
            self._goal = self._u = self._target = self._braking = 0.0
        elif braking > 0.0:
            self._goal = self._u = self._target = goal
            self._braking = braking
        else:
            self._goal = math.copysign(max(abs(goal) - self._dead_band, 0.0), goal)
            # The current does not jump; where there is no lag it need not be known.
            self._u = torque + self._back_emf * velocity
        self._begin(velocity, now_ns)

    def hold(self, until_ns: int) -> tuple[float, float]:
        """Return torque [N·m] and braking [N·m·s/rad] to hold from ``begin_ns`` to ``until_ns``."""
        duration = (until_ns - self.begin_ns) * 1e-9
        self._duration = duration
        if self._u == self._target:
            self._mean = self._u
        else:
            y = self._rate * duration
            self._mean = self._target + (self._u - self._target) * (-math.expm1(-y) / y)
        return self._mean, self._braking

    def moved(self, distance: float, velocity: float, until_ns: int, *, ended: bool) -> None:
        """Account for the motion from ``begin_ns`` to ``until_ns`` [ns].

        Args:
            distance: [rad].
            velocity: At the end [rad/s].
            until_ns: As given to ``hold``.
            ended: The next step begins there; otherwise this one is taken again, to a later time.
        """
        duration = self._duration
        mean = self._mean - self._braking * distance / duration
        kept = math.exp(-self._filter_rate * duration) if self._filter_rate else 0.0
        self._sensed_now = (
            mean + (self._sensed - mean) * kept if self._filter_rate else self.torque(velocity)
        )
        if ended:
            self._sensed = self._sensed_now
            self._acceleration = (velocity - self._speed) / duration
            self._u = self._value()
            self._begin(velocity, until_ns)

    def torque(self, velocity: float) -> float:
        """Return the torque that acts where the last motion ended [N·m].

        Args:
            velocity: Velocity of the body there [rad/s].
        """
        return self._value() - self._braking * velocity

    @property
    def _follows_speed(self) -> bool:
        return self._regulated and self._back_emf > 0.0

    def _value(self) -> float:
        """Return u where the last ``hold`` ended."""
        if self._u == self._target:
            return self._u
        return self._target + (self._u - self._target) * math.exp(-self._rate * self._duration)

    def _begin(self, velocity: float, now_ns: int) -> None:
        """Begin a step: compute the target of u for the speed expected in its middle."""
        self.begin_ns = now_ns
        self._duration = 0.0
        self._speed = velocity
        if not self._regulated:
            return
        goal, back_emf = self._goal, self._back_emf
        self._braking = back_emf
        if back_emf > 0.0:
            speed = velocity + self._acceleration * (0.5e-9 * STEP_NS)
            stall = self._winding.stall_torque
            lost = self._droop * abs(speed)
            wanted = goal + (back_emf - lost) * speed
            self._target = min(max(wanted, -stall), stall)
            if self._rate == 0.0 and self._target == wanted:
                # As u = u* at each instant, only the droop is left of the back-EMF.
                self._target, self._braking = goal - lost * speed, 0.0
        else:
            self._target = goal
        if self._rate == 0.0 or abs(self._u - self._target) <= _SETTLED * abs(self._target):
            self._u = self._target


def current_loop(true: TrueServo, winding: Winding, start_ns: int) -> CurrentLoop | None:
    """Return the current loop of a servo; None: its torque is the commanded one, at once."""
    effects = (
        true.current_bandwidth,
        true.current_period,
        true.dead_band,
        true.current_filter,
        float(true.back_emf),
    )
    return CurrentLoop(true, winding, start_ns) if any(effects) else None
