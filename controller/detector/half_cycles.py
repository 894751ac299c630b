"""Divides a motion into half-cycles at its turning points, without a model of the servo."""

from __future__ import annotations

import math
from collections import deque
from typing import Protocol

from haptic_wall.controller.detector.tuning import HalfCycleTuning

_FINEST = 1e-6
"""The least hysteresis, without an encoder step [rad]."""


class Repeated(Protocol):
    """The last four half-cycles, or contacts, of a motion."""

    known: int
    duration: float
    duration_2: float
    duration_3: float
    duration_4: float
    amplitude: float
    amplitude_2: float
    amplitude_3: float
    amplitude_4: float
    inertia: float
    inertia_2: float
    pull: float
    pull_2: float
    pull_3: float
    elapsed: float
    interval: float
    gain: float
    gaining: int
    load: float


class HalfCycles:
    """The last four half-cycles of a motion, each from one turning point to the next.

    The apparent inertia is the one that the commanded torque alone would have moved in that time:
    the velocity is zero at both ends, so that the integral of torque times distance from the middle
    is minus the inertia times the integral of the squared velocity.

    Attributes:
        known: Half-cycles since the start.
        duration: Duration of the last one [s]; ``duration_2`` to ``duration_4``: of those before
            it.
        amplitude: Half the distance between its turning points [rad]; ``amplitude_2`` and so on, as
            for ``duration``.
        inertia: Apparent inertia in the last one [kg·m²]; ``inertia_2``: in the one before.
        pull: Mean torque toward the middle, weighted by the distance from it in amplitudes
            [N·m]; ``pull_2`` and ``pull_3``: of those before it. It is half of the largest torque
            for a linear spring, and above 0.55 of the limit where the torque saturates most of the
            time.
        elapsed: Since the last turning point [s].
        interval: Between the last two turning points [s].
        gain: 0, like ``gaining``: only contacts have a gain.
        load: Mean torque over the last four half-cycles [N·m]: the load that the wall holds.
        turned: Last turning point [rad]; ``turned_2`` and ``turned_3``: those before it.
    """

    __slots__ = (
        "_direction",
        "_extreme",
        "_hysteresis",
        "_impulse",
        "_impulse_then",
        "_impulses",
        "_largest",
        "_last",
        "_least",
        "_moment",
        "_moment_then",
        "_period",
        "_rippled",
        "_since_extreme",
        "_square",
        "_square_then",
        "_start",
        "_started",
        "_still",
        "_tuning",
        "amplitude",
        "amplitude_2",
        "amplitude_3",
        "amplitude_4",
        "duration",
        "duration_2",
        "duration_3",
        "duration_4",
        "elapsed",
        "gain",
        "gaining",
        "inertia",
        "inertia_2",
        "interval",
        "known",
        "load",
        "pull",
        "pull_2",
        "pull_3",
        "turned",
        "turned_2",
        "turned_3",
    )

    def __init__(self, period: float, position_step: float, tuning: HalfCycleTuning) -> None:
        """Start with no half-cycle.

        Args:
            period: T [s].
            position_step: Encoder count [rad]; 0: none.
            tuning: Numbers for turning points.
        """
        self._period = period
        self._tuning = tuning
        self._still = tuning.still
        self._least = max(tuning.turning_counts * position_step, _FINEST)
        self.known = 0
        self.duration = 0.0
        self.duration_2 = 0.0
        self.duration_3 = 0.0
        self.duration_4 = 0.0
        self.amplitude = 0.0
        self.amplitude_2 = 0.0
        self.amplitude_3 = 0.0
        self.amplitude_4 = 0.0
        self.inertia = 0.0
        self.inertia_2 = 0.0
        self.pull = 0.0
        self.pull_2 = 0.0
        self.pull_3 = 0.0
        self.elapsed = 0.0
        self.interval = self.gain = self.load = 0.0
        self.gaining = 0
        self.turned = self.turned_2 = self.turned_3 = 0.0
        self._hysteresis = self._least
        self._largest = 0.0
        self._rippled = 0
        self._direction = 0
        self._last = 0.0
        self._started = False
        self._start = 0.0
        self._extreme = 0.0
        self._since_extreme = 0.0
        self._moment = 0.0
        self._impulse = 0.0
        self._square = 0.0
        self._moment_then = 0.0
        self._impulse_then = 0.0
        self._impulses: deque[float] = deque(maxlen=4)
        self._square_then = 0.0

    def forget(self) -> None:
        """Restart at the next sample."""
        self._started = False
        self.known = 0
        self._direction = 0
        self._hysteresis = self._least

    def shift(self, way: float) -> None:
        """Count positions from a place that is further by ``way`` [rad]; the motion goes on."""
        self._last -= way
        self._start -= way
        self._extreme -= way
        self.turned, self.turned_2 = self.turned - way, self.turned_2 - way
        self.turned_3 -= way

    @property
    def settled(self) -> float:
        """Return the time since the last turning point, over a half-cycle's [1].

        That is the second longest of the last three: a single push or fall takes long without any
        oscillation.
        """
        usual = sorted((self.duration, self.duration_2, self.duration_3))[1]
        return self.elapsed / usual if usual else math.inf

    def mean_torque(self, known: int) -> float:
        """Return the mean torque of the last cycle [N·m].

        Where two cycles are known it is the lesser of both; 0 if they disagree in sign: a load that
        has come or gone is none.

        Args:
            known: Number of half-cycles that belong to the same motion, >= 2.
        """
        impulses = self._impulses
        last = (impulses[-1] + impulses[-2]) / (self.duration + self.duration_2)
        if known < 4:
            return last
        before = (impulses[-3] + impulses[-4]) / (self.duration_3 + self.duration_4)
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
            self._last = self._start = self._extreme = position
            self._since_extreme = self.elapsed = 0.0
            self._clear()
            return False
        moved = position - self._last
        self._last = position
        self._moment += torque * (position - self._start) * span
        self._impulse += torque * span
        self._square += moved * moved / span
        self.elapsed += span
        self._since_extreme += span
        away = position - self._extreme
        if self._direction == 0:
            if abs(away) > self._hysteresis:
                self._direction = 1 if away > 0.0 else -1
                self._start = self._extreme
                self.elapsed = self._since_extreme
                self._clear()
                self._reach(position)
            return False
        if away * self._direction >= 0.0:
            if away != 0.0:
                self._reach(position)
            return False
        if abs(away) <= self._hysteresis:
            if self._since_extreme > self._still * self.duration:
                # A motion that has become so much smaller would else never be seen again.
                self._hysteresis, self._largest, self._rippled = self._least, 0.0, 0
            return False
        self._turn(position)
        return True

    def _clear(self) -> None:
        self._moment = self._impulse = self._square = 0.0
        self._moment_then = self._impulse_then = self._square_then = 0.0

    def _reach(self, position: float) -> None:
        """Take the present position as the turning point until a farther one comes."""
        self._extreme = position
        self._since_extreme = 0.0
        self._moment_then = self._moment
        self._impulse_then = self._impulse
        self._square_then = self._square

    def _turn(self, position: float) -> None:
        """End a half-cycle at the farthest position, and begin the next one there."""
        start, end = self._start, self._extreme
        self.duration_4, self.amplitude_4 = self.duration_3, self.amplitude_3
        self.duration_3, self.amplitude_3 = self.duration_2, self.amplitude_2
        self.duration_2, self.amplitude_2 = self.duration, self.amplitude
        self.inertia_2 = self.inertia
        self.pull_3, self.pull_2 = self.pull_2, self.pull
        self.duration = max(self.elapsed - self._since_extreme, self._period)
        self.interval = self.duration
        self.amplitude = 0.5 * abs(end - start)
        half = 0.5 * (end - start)
        virial = self._moment_then - half * self._impulse_then
        self.pull = -virial / (self.duration * max(self.amplitude, self._least))
        self.inertia = -virial / self._square_then if self._square_then > 0.0 else 0.0
        impulses = self._impulses
        impulses.append(self._impulse_then)
        spanned = self.duration + self.duration_2 + self.duration_3 + self.duration_4
        self.load = sum(impulses) / spanned
        self.turned, self.turned_2, self.turned_3 = end, start, self.turned_2
        # Shift the sums from the old start to the new one.
        impulse = self._impulse - self._impulse_then
        self._moment = self._moment - self._moment_then - (end - start) * impulse
        self._impulse = impulse
        self._square -= self._square_then
        self._moment_then = self._impulse_then = self._square_then = 0.0
        self._start = end
        self.elapsed = self._since_extreme
        self._direction = -self._direction
        self.known += 1
        tuning = self._tuning
        self._largest = largest = max(self.amplitude, tuning.forgets * self._largest)
        ripple = self.amplitude < tuning.ripple * largest
        self._rippled = tuning.coarse_half_cycles if ripple else self._rippled - 1
        if self._rippled <= 0:
            fraction = tuning.turning_fraction * self.amplitude
        else:
            fraction = tuning.coarse * largest
        self._hysteresis = max(self._least, 2.0 * fraction)
        self._reach(position)
