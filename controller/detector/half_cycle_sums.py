"""Divides motion into half-cycles, and integrates work and moments over each.

Over a half-cycle the velocity starts and ends at zero. So for any wall the work of all torques is
zero, and so is the mean of ``d(m v x)/dt``: work of the torque against friction, and torque times
displacement against ``m v²``, show whether the torque alone explains the motion.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from haptic_wall.controller.detector.tuning import HalfCycleTuning

_FINEST = 1e-9
"""The same without an encoder's steps [rad]."""


Sums = tuple[float, float, float, float, float, float, float]
"""Sums from the start to a turning point: filtered position [rad], time [s], and ``work, square,
area, moment, impulse`` of ``HalfCycleSums``"""


class HalfCycle(NamedTuple):
    """The motion and its integrals from one turning point to the next."""

    start: float
    """Filtered position at the first turning point [rad]"""
    end: float
    """Filtered position at the second one [rad]"""
    ended: float
    """Its end [s since the start]"""
    duration: float
    """[s], > 0"""
    amplitude: float
    """Half the distance between them, corrected for the filter [rad]"""
    work: float
    """Work of the acting torque [J]"""
    square: float
    """Integral of the velocity's square [rad²/s], > 0"""
    area: float
    """Integral of the position [rad·s]"""
    moment: float
    """Integral of torque times position [J·s]"""
    impulse: float
    """Integral of the torque [N·m·s]"""

    @property
    def path(self) -> float:
        """Return the travelled distance [rad]."""
        return abs(self.end - self.start)

    @property
    def virial(self) -> float:
        """Return the integral of torque times distance from the middle [J·s]."""
        return self.moment - 0.5 * (self.start + self.end) * self.impulse


class HalfCycleSums:
    """Filters position and acting torque alike, and integrates between turning points.

    The filter's time constant is a small fraction of the oscillation's period. It turns the
    encoder's steps into a velocity, and because it acts on both, it keeps the phase between them.

    Attributes:
        position: Filtered [rad].
        since: All sums at the last turning point.
        before: At the one before.
        speed: Filtered velocity [rad/s].
        time: Since the start [s].
        work: Work of the acting torque [J].
        square: Integral of the velocity's square [rad²/s].
        area: Integral of the position [rad·s].
        moment: Integral of torque times position [J·s].
        impulse: Integral of the torque [N·m·s].
    """

    __slots__ = (
        "_direction",
        "_gain",
        "_hysteresis",
        "_period",
        "_tau",
        "_torque",
        "_turn",
        "area",
        "before",
        "impulse",
        "moment",
        "position",
        "since",
        "speed",
        "square",
        "time",
        "work",
    )

    def __init__(
        self, period: float, position_step: float, position: float, tuning: HalfCycleTuning
    ) -> None:
        """Start at rest.

        Args:
            period: T [s].
            position_step: Encoder count q >= 0 [rad].
            position: Rest position [rad].
            tuning: Numbers for turning points.
        """
        self._period = period
        self._hysteresis = max(tuning.turning_counts * position_step, _FINEST)
        self._torque = 0.0
        self._tau = self._gain = 0.0
        self.filter(0.0)
        self.position = position
        self._direction = 0
        self.time = self.work = self.square = self.area = self.moment = self.impulse = 0.0
        self.speed = 0.0
        self.before = self.since = self._turn = (position, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

    def filter(self, time_constant: float) -> None:
        """Change the filter's time constant [s]."""
        self._tau = time_constant
        self._gain = 1.0 - math.exp(-self._period / time_constant) if time_constant > 0 else 1.0

    @property
    def smear(self) -> float:
        """Return the time over which the filter spreads a step of the torque [s]."""
        return 2.0 * self._tau

    def update(self, position: float, torque: float, periods: int) -> bool:
        """Take a sample; return whether a turning point was confirmed, which ends a half-cycle.

        ``half_cycle`` then returns it, until the next call.

        Args:
            position: Measured [rad].
            torque: Mean one since the last sample [N·m].
            periods: Number of periods from the last sample, >= 1.
        """
        gain = self._gain if periods == 1 else 1.0 - (1.0 - self._gain) ** periods
        span = periods * self._period
        before = self.position
        moved = gain * (position - before)
        self.position = now = before + moved
        acting = self._torque
        self._torque = acting = acting + gain * (torque - acting)
        self.time += span
        self.work += acting * moved
        self.speed = speed = moved / span
        self.square += speed * moved
        middle = before + 0.5 * moved
        self.area += middle * span
        impulse = acting * span
        self.impulse += impulse
        self.moment += impulse * middle
        away = now - self._turn[0]
        if away * self._direction >= 0.0 and (self._direction or away == 0.0):
            # Also while it rests there: a half-cycle begins with the motion.
            self._turn = (
                now,
                self.time,
                self.work,
                self.square,
                self.area,
                self.moment,
                self.impulse,
            )
            if not self._direction:
                self.since = self._turn
            return False
        return away > self._hysteresis or away < -self._hysteresis

    def now(self) -> Sums:
        """Return all sums to the present."""
        return (
            self.position,
            self.time,
            self.work,
            self.square,
            self.area,
            self.moment,
            self.impulse,
        )

    def half_cycle(self) -> HalfCycle | None:
        """Return the half-cycle that ended at the turning point, and begin the next one.

        Call it once whenever ``update`` returns true. None for the first motion from rest.
        """
        start, end = self.since, self._turn
        first = self._direction == 0
        self._direction = 1 if self.position > end[0] else -1
        self._turn = self.now()
        if first:
            return None
        self.before, self.since = start, end
        begun, left = start[0], end[0]
        duration = end[1] - start[1]
        square = end[3] - start[3]
        if duration <= 0.0 or square <= 0.0:
            return None
        attenuation = math.pi / duration * self._tau
        return HalfCycle(
            begun,
            left,
            end[1],
            duration,
            0.5 * abs(left - begun) * math.sqrt(1.0 + attenuation * attenuation),
            end[2] - start[2],
            square,
            end[4] - start[4],
            end[5] - start[5],
            end[6] - start[6],
        )
