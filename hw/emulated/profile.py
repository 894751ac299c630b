"""Computes profiles: the path of a servo's goal from its present position to the commanded one.

A plan is a sequence of stretches with linearly changing velocity. A new plan begins with the
velocity of the old one, so that the velocity never jumps where an acceleration is set.

According to the manual real servos also limit the jerk, which makes them a little slower, without
numbers; this model does not.

Source: ROBOTIS e-Manual, "What is the Profile".
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

STEP, RECTANGULAR, TRIANGULAR, TRAPEZOIDAL = range(4)
"""Kinds of profile, as in bits 4 and 5 of Moving Status"""


class Stretch(NamedTuple):
    """A time of linearly changing velocity."""

    duration: float
    """[s]"""
    start: float
    """Velocity at its start [counts/s]"""
    end: float
    """Velocity at its end [counts/s]"""


class Point(NamedTuple):
    """The point of a plan at one instant."""

    position: float
    """[counts]"""
    velocity: float
    """[counts/s]"""
    acceleration: float
    """[counts/s²]"""


@dataclass(frozen=True, slots=True)
class Plan:
    """A path to a goal, from the time it was made."""

    begin: float
    """Position at its start [counts]"""
    goal: float
    """Position after its end [counts]"""
    kind: int
    stretches: tuple[Stretch, ...]
    final: float = 0.0
    """Velocity after its end [counts/s]"""

    @property
    def duration(self) -> float:
        """Return its duration [s]."""
        return sum(stretch.duration for stretch in self.stretches)

    def at(self, elapsed: float) -> Point:
        """Return its point ``elapsed`` [s] after its start."""
        position = self.begin
        for duration, start, end in self.stretches:
            if elapsed < duration:
                acceleration = (end - start) / duration
                reached = start + acceleration * elapsed
                return Point(position + 0.5 * (start + reached) * elapsed, reached, acceleration)
            position += 0.5 * (start + end) * duration
            elapsed -= duration
        return Point(self.goal, self.final, 0.0)


def by_velocity(
    position: float, velocity: float, goal: float, speed: float, acceleration: float
) -> Plan:
    """Return the quickest plan within a speed and an acceleration.

    Args:
        position: Start [counts].
        velocity: Velocity at the start [counts/s].
        goal: [counts]
        speed: Largest speed [counts/s]; 0: unlimited, the goal is reached at once.
        acceleration: Largest acceleration [counts/s²]; 0: unlimited.
    """
    way = goal - position
    if speed == 0.0:
        return Plan(position, goal, STEP, ())
    if acceleration == 0.0:
        cruise = math.copysign(speed, way)
        stretches = (Stretch(way / cruise, cruise, cruise),) if way else ()
        return Plan(position, goal, RECTANGULAR, stretches)
    # The direction: if it cannot stop before the goal, it has to come back.
    sign = math.copysign(1.0, way - velocity * abs(velocity) / (2.0 * acceleration))
    along, ahead = sign * velocity, sign * way
    to_cruise = abs(speed - along) / acceleration
    cruised = ahead - 0.5 * (along + speed) * to_cruise - 0.5 * speed * speed / acceleration
    if cruised >= 0.0:
        peak, hold, kind = speed, cruised / speed, TRAPEZOIDAL
    else:
        peak = math.sqrt(max(0.0, acceleration * ahead + 0.5 * velocity * velocity))
        to_cruise, hold, kind = abs(peak - along) / acceleration, 0.0, TRIANGULAR
    peak_velocity = sign * peak
    return Plan(
        position,
        goal,
        kind,
        (
            Stretch(to_cruise, velocity, peak_velocity),
            Stretch(hold, peak_velocity, peak_velocity),
            Stretch(peak / acceleration, peak_velocity, 0.0),
        ),
    )


def by_time(position: float, velocity: float, goal: float, span: float, ramp: float) -> Plan:
    """Return the plan that takes a given time.

    Args:
        position: Start [counts].
        velocity: Velocity at the start [counts/s].
        goal: [counts]
        span: Duration [s]; 0: the goal is reached at once.
        ramp: Duration of acceleration and of braking [s]; at most half of ``span`` counts.
    """
    if span == 0.0:
        return Plan(position, goal, STEP, ())
    ramp = min(ramp, 0.5 * span)
    if ramp == 0.0:
        cruise = (goal - position) / span
        return Plan(position, goal, RECTANGULAR, (Stretch(span, cruise, cruise),))
    cruise = (goal - position - 0.5 * velocity * ramp) / (span - ramp)
    hold = span - 2.0 * ramp
    return Plan(
        position,
        goal,
        TRAPEZOIDAL if hold > 0.0 else TRIANGULAR,
        (
            Stretch(ramp, velocity, cruise),
            Stretch(hold, cruise, cruise),
            Stretch(ramp, cruise, 0.0),
        ),
    )


def ramp_to(velocity: float, goal: float, duration: float) -> Plan:
    """Return a plan between two velocities [counts/s] in ``duration`` [s], without positions."""
    kind = TRAPEZOIDAL if duration > 0.0 else STEP
    stretches = (Stretch(duration, velocity, goal),) if duration > 0.0 else ()
    return Plan(0.0, 0.0, kind, stretches, final=goal)
