"""Takes one position sample a period, and estimates the velocity from it."""

from __future__ import annotations

import math
from typing import Literal

from haptic_wall.controller.laws.velocity import Biquad, VelocityEstimator
from haptic_wall.hw.servo import Bus, Outcome, Reading, Servo
from haptic_wall.hw.settings import Schedule

COLLECT_SHARE = 0.8
"""Fraction of a period after which a missing reply is given up [1]. A pipelined tick that waits
sends its next request later, until a phase of the adapter's timer comes in which the replies are in
time. A loop that does not wait misses every reply at some phases."""
LONGER_SHARE = 1.05
"""The same fraction after a pipelined reply was lost, until another one is lost [1]. An adapter
flushes its buffer periodically. A request sent after giving up can then miss each tick by the time
that it takes itself, for ever. With the first fraction that happens at phases of 0.8 to about 0.95
periods, with this one at 0.05 to 0.2, so that changing the fraction leaves either."""
JITTER = 0.1
"""Largest distance from whole periods at which an interval between samples counts as whole
[periods]. A loop that serves a tick every 1.5 periods is far from it: with a division by 2, its
velocity would omit a quarter of the damping."""
SHORTEST = 0.5
"""The shortest interval for a velocity [periods]: over a very short one, after a late tick, one
encoder count would give a high speed."""
_OK = Outcome.OK  # looking up an enum member is slow: a plain name is many times faster
_WAITING = Outcome.WAITING


def is_pipelined(schedule: Schedule | Literal["auto"], bus: Bus | None, period_s: float) -> bool:
    """Whether requests are sent in the period before.

    Args:
        schedule: As configured.
        bus: The servo's bus after its start; None: there is none.
        period_s: The sampling period [s].
    """
    if schedule == "auto":  # where a reply takes several periods, neither is better
        return bus is not None and not bus.reply_s and bus.longest_s > COLLECT_SHARE * period_s
    return schedule == "pipelined"


class Sampler:
    """Requests and collects positions; holds the last position, its instant and the velocity.

    Args:
        servo: Source of the position.
        velocity: Estimates the velocity from the positions.
        period_ns: The sampling period [ns].
        pipelined: Requests are sent at the end of the period before; else in the period of the
            sample.
        velocity_filter: Filter of the velocity that damps; None: none.

    Attributes:
        outcome: Outcome of the last request.
        position: The last known position [rad]; NaN: none is known yet.
        velocity: Estimated velocity [rad/s]; 0 after a reading that failed.
        damped: Velocity that the law's damping acts on: filtered if the wall has a filter.
        sampled_ns: When ``position`` was sampled [ns]; None: none is known yet.
        measured_torque: Torque in the last reply [N·m]; NaN: the servo measures none.
        first: Whether the last sample was the first good one.
        pipelined: As given; the tick then sends the next request when its torque is sent.
    """

    __slots__ = (
        "_collect_ns",
        "_estimator",
        "_filter",
        "_other_collect_ns",
        "_period_ns",
        "_servo",
        "damped",
        "first",
        "measured_torque",
        "outcome",
        "pipelined",
        "position",
        "sampled_ns",
        "velocity",
    )

    def __init__(
        self,
        servo: Servo,
        velocity: VelocityEstimator,
        period_ns: int,
        *,
        pipelined: bool,
        velocity_filter: Biquad | None = None,
    ) -> None:
        self._servo = servo
        self._estimator = velocity
        self._filter = velocity_filter
        self._period_ns = period_ns
        self.pipelined = pipelined
        self._collect_ns = int(COLLECT_SHARE * period_ns)
        self._other_collect_ns = int(LONGER_SHARE * period_ns)
        self.outcome = _OK
        self.position = math.nan
        self.velocity = self.damped = 0.0
        self.sampled_ns: int | None = None
        self.measured_torque = math.nan
        self.first = False

    def sample(self, woke_ns: int) -> Reading:
        """Collect the reply; update the position and the velocity.

        Args:
            woke_ns: When the loop woke for this period [ns].

        Returns:
            The reply; its outcome says whether there is a new position.
        """
        servo = self._servo
        if not self.pipelined:
            servo.request()
        reading = servo.collect(woke_ns + self._collect_ns)
        outcome, position, _, sampled_ns, self.measured_torque, _ = reading
        self.outcome = outcome
        self.first = False
        if outcome is _WAITING:
            # Held until the next sample: a loop with a longer period, as in the theory. With dx = 0
            # in between the damping would act in one tick of many.
            return reading
        if outcome is not _OK:
            # The last position again, so dx = 0. Before the first good reading the torque is zero.
            self.velocity = self.damped = 0.0
            if self.pipelined and outcome is Outcome.LOST:
                self._collect_ns, self._other_collect_ns = self._other_collect_ns, self._collect_ns
            return reading
        last_ns = self.sampled_ns
        self.position = position
        self.sampled_ns = sampled_ns
        self.first = last_ns is None
        # Not the count of ticks: readings may be lost, periods skipped, ticks late. Nearly whole
        # numbers are rounded, so that jitter does not disturb the velocity.
        periods = 1.0 if last_ns is None else (sampled_ns - last_ns) / self._period_ns
        if not -JITTER <= periods - 1.0 <= JITTER:
            whole = round(periods)
            near = abs(periods - whole) <= JITTER and whole
            periods = whole if near else max(periods, SHORTEST)
        else:
            periods = 1.0
        velocity = self._estimator.update(position, periods)
        self.velocity = velocity
        self.damped = velocity if self._filter is None else self._filter.update(velocity)
        return reading
