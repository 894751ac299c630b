"""Cuts motion into swings, from one turning point to the next, and sums up what each one cost.

Over a swing the velocity starts and ends at zero. So whatever the wall is, the work of all that
acts is zero, and so is the mean of ``d(m v x)/dt``: work of the torque against friction, and
torque times displacement against ``m v²``, tell whether the torque alone explains the motion.
"""

from __future__ import annotations

import math
from typing import NamedTuple

HYSTERESIS = 1.5
"""Counts of the encoder that a turning point must be left by: flicker of one count is none."""
_FINEST = 1e-9
"""The same without an encoder's steps [rad]."""


Sums = tuple[float, float, float, float, float, float, float]
"""What has come together since the start, up to a turning point: filtered position [rad], time [s],
and ``work, square, area, moment, impulse`` of ``Swings``"""


class Swing(NamedTuple):
    """From one turning point to the next."""

    start: float
    """Filtered position at the turning point before [rad]"""
    end: float
    """At this one [rad]"""
    ended: float
    """When [s since the start]"""
    duration: float
    """[s], > 0"""
    amplitude: float
    """Half the way between them, as it is without the filter [rad]"""
    work: float
    """Of the acting torque [J]"""
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
        """Way travelled [rad]."""
        return abs(self.end - self.start)

    @property
    def virial(self) -> float:
        """Integral of torque times distance from the middle [J·s]; free motion: -m ``square``."""
        return self.moment - 0.5 * (self.start + self.end) * self.impulse


class Swings:
    """Filters position and acting torque alike, and sums between turning points.

    The filter's time constant is a small share of the oscillation's period. It turns the encoder's
    steps into a velocity, and because it acts on both, the phase between them is kept.

    Attributes:
        position: Filtered [rad].
        since: All sums at the last turning point.
        before: At the one before.
        speed: Filtered velocity [rad/s].
        time: Since the start [s].
        work: Of the acting torque [J].
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

    def __init__(self, period: float, position_step: float, position: float) -> None:
        """Begin at rest.

        Args:
            period: T [s].
            position_step: Encoder count q >= 0 [rad].
            position: Where it rests [rad].
        """
        self._period = period
        self._hysteresis = max(HYSTERESIS * position_step, _FINEST)
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

    def update(self, position: float, torque: float, periods: int) -> bool:
        """Take a sample; whether a turning point has been left, which ends a swing.

        ``swing`` then gives it, until the next call.

        Args:
            position: Measured [rad].
            torque: Mean one since the sample before [N·m].
            periods: From the sample before, >= 1.
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
            # Also while it rests there: a swing begins when it is let go.
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
        """All sums to the present."""
        return (
            self.position,
            self.time,
            self.work,
            self.square,
            self.area,
            self.moment,
            self.impulse,
        )

    def swing(self) -> Swing | None:
        """The swing that ended where the turning point was, and begin the next one.

        To be called once whenever ``update`` says so. None for the first motion from rest.
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
        return Swing(
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
