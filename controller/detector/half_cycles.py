"""Divides a motion into half-cycles at its turning points, without a model of the servo."""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

from haptic_wall.controller.detector.tuning import TUNING

_FINEST = 1e-6
"""The least hysteresis, without an encoder step [rad]."""


class HalfCycle(NamedTuple):
    """The motion from one turning point to the next, or a contact with a one-sided wall.

    The apparent inertia is the one that the commanded torque alone would have moved in that time:
    the velocity is zero at both ends, so that the integral of torque times distance from the middle
    is minus the inertia times the integral of the squared velocity. A contact counts the distance
    from the surface, where the spring's elongation is zero at both ends.
    """

    duration: float
    """[s], > 0"""
    amplitude: float
    """Half the distance between the turning points, or the depth of the contact [rad]"""
    inertia: float
    """Apparent inertia [kg·m²]"""
    pull: float
    """Mean torque toward the middle, weighted by the distance from it in amplitudes [N·m]. It is
    half of the largest torque for a linear spring, and above 0.55 of the limit where the torque
    saturates most of the time."""
    impulse: float
    """Integral of the torque [N·m·s]"""
    start: float
    """First turning point [rad]"""
    end: float
    """Second one [rad]"""


class HalfCycles:
    """The last four half-cycles of a motion.

    Attributes:
        last: The last four at most, the newest last.
        elapsed: Time since the last one ended [s].
        interval: Time between the ends of the last two [s].
        gain: 0; see ``Contacts``.
    """

    def __init__(self, period: float, position_step: float) -> None:
        """Start with no half-cycle.

        Args:
            period: T [s].
            position_step: Encoder count [rad]; 0: none.
        """
        self._period = period
        self._hysteresis = self._least = max(TUNING.turning_counts * position_step, _FINEST)
        self.last: deque[HalfCycle] = deque(maxlen=4)
        self.elapsed = self.interval = self.gain = 0.0
        self._direction = 0
        self._started = False
        self._position = self._start = self._extreme = self._since_extreme = 0.0
        self._rested = self._early = 0.0
        # Integrals since the start of torque times distance from it, torque, and velocity squared:
        # to the present, and to the farthest position.
        self._now = [0.0, 0.0, 0.0]
        self._then = (0.0, 0.0, 0.0)

    def forget(self) -> None:
        """Restart at the next sample."""
        self._started = False
        self.last.clear()
        self._direction = 0
        self._hysteresis = self._least

    def shift(self, way: float) -> None:
        """Count positions from a place that is further by ``way`` [rad]; the motion goes on."""
        self._position -= way
        self._start -= way
        self._extreme -= way
        moved = [one._replace(start=one.start - way, end=one.end - way) for one in self.last]
        self.last.clear()
        self.last.extend(moved)

    @property
    def load(self) -> float:
        """Return the mean torque over the last four half-cycles [N·m]: the wall holds that load."""
        spanned = sum(one.duration for one in self.last)
        return sum(one.impulse for one in self.last) / spanned if spanned else 0.0

    @property
    def settled(self) -> float:
        """Return the time since the last turning point, over a half-cycle's [1].

        That is the second longest of the last three: a single push or fall takes long without any
        oscillation.
        """
        lasted = sorted(one.duration for one in list(self.last)[-3:])
        return self.elapsed / lasted[-2] if len(lasted) > 1 else math.inf

    def mean_torque(self, known: int) -> float:
        """Return the mean torque of the last cycle [N·m].

        Where two cycles are known it is the lesser of both; 0 if they disagree in sign: a load that
        has come or gone is none.

        Args:
            known: Number of half-cycles that belong to the same motion, from 2 to 4.
        """
        first, second = list(self.last)[-2:]
        last = (first.impulse + second.impulse) / (first.duration + second.duration)
        if known < 4:
            return last
        first, second = self.last[0], self.last[1]
        before = (first.impulse + second.impulse) / (first.duration + second.duration)
        if last * before <= 0.0:
            return 0.0
        return last if abs(last) < abs(before) else before

    def update(self, position: float, torque: float, span: float) -> bool:
        """Take a sample; return whether a half-cycle has ended since the last one.

        Args:
            position: [rad]
            torque: Commanded since the last sample [N·m].
            span: Time since the last sample [s].
        """
        if not self._started:
            self._started = True
            self._position = self._start = self._extreme = position
            self._since_extreme = self.elapsed = self._rested = self._early = 0.0
            self._clear()
            return False
        moved = position - self._position
        self._position = position
        now = self._now
        now[0] += torque * (position - self._start) * span
        now[1] += torque * span
        self._rested += span
        if moved:  # over all the time since the last count, or slow motion would seem too fast
            now[2] += moved * moved / self._rested
            self._rested = 0.0
        self.elapsed += span
        self._since_extreme += span
        away = position - self._extreme
        if self._direction == 0:
            if abs(away) > self._hysteresis:
                self._direction = 1 if away > 0.0 else -1
                self._start = self._extreme
                self.elapsed = self._since_extreme
                self._early = now[1]  # its time counts, too
                self._clear()
                self._reach(position)
            return False
        if away * self._direction >= 0.0:
            if away != 0.0:
                self._reach(position)
            return False
        if abs(away) <= self._hysteresis:
            if self._since_extreme > TUNING.still * self.interval:
                # A motion that has become so much smaller would else never be seen again.
                self._hysteresis = self._least
            return False
        self._turn(position)
        return True

    def _clear(self) -> None:
        self._now = [0.0, 0.0, 0.0]
        self._then = (0.0, 0.0, 0.0)

    def _reach(self, position: float) -> None:
        """Take the present position as the turning point until a farther one comes."""
        self._extreme = position
        self._since_extreme = 0.0
        self._then = self._now[0], self._now[1], self._now[2]

    def _turn(self, position: float) -> None:
        """End a half-cycle at the farthest position, and begin the next one there."""
        start, end = self._start, self._extreme
        moment, impulse, square = self._then
        duration = max(self.elapsed - self._since_extreme, self._period)
        half = 0.5 * (end - start)
        virial = moment - half * impulse
        amplitude = abs(half)
        self.last.append(
            HalfCycle(
                duration,
                amplitude,
                -virial / square if square > 0.0 else 0.0,
                -virial / (duration * max(amplitude, self._least)),
                impulse + self._early,
                start,
                end,
            )
        )
        # Shift the integrals from the old start to the new one.
        now = self._now
        left = now[1] - impulse
        self._now = [now[0] - moment - (end - start) * left, left, now[2] - square]
        self._start = end
        self._early = 0.0
        self.interval = duration
        self.elapsed = self._since_extreme
        self._direction = -self._direction
        self._hysteresis = max(self._least, 2.0 * TUNING.turning_fraction * amplitude)
        self._reach(position)
