"""Whether a wall that never pulls returns a servo faster than it came, told by single contacts.

``theory.contact`` asks the same of servos without friction, encoder, play and torque limit. It is
kept apart: in pure numbers, exact, and the oracle of this one, as this one is of it.
"""

from __future__ import annotations

import numpy as np

from haptic_wall.controller.experiments.maps.kicks import unsaturated
from haptic_wall.controller.experiments.maps.many_walls import Loops, Walls, blocks
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.controller.theory.response import held_response

_PHASES = (17, 9, 9)
"""Instants of entry tried: over the whole period, then around the worst one"""
_JUST = 1e-9
"""The entry that just misses a sample, or is just seen by it [periods]."""
_CONTACTS = 6.0
"""How many half oscillations (of the undamped spring) a contact is followed at most; a wall that
lets the servo only creep out returns no speed."""
_LOOK = 32


def returned(walls: Walls, kick: FloatArray) -> FloatArray:
    """Logarithm of exit speed over entry speed at the worst phase; > 0: it returns faster.

    The servo comes freely and enters with the speed that the spring alone would stop after
    ``kick``. It starts outside, early enough that the velocity estimate knows how it comes. The
    exit speed is the greatest outside, until no commanded torque acts any more.

    Args:
        walls: One-sided walls with stiffness > 0.
        kick: Penetration at which the undamped spring would stop the servo, > 0 [rad]; where it
            would saturate, ``kicks.unsaturated`` replaces it.

    Returns:
        The worst over the instants of entry between two samples; -1 where
        none returns any speed.
    """
    middle, reach = np.full((walls.size, 1), 0.5), 0.5
    worst = np.full(walls.size, -np.inf)
    speed = unsaturated(walls, kick) * np.sqrt(walls.stiffness / walls.inertia)
    for points in _PHASES:
        phase = np.clip(middle + reach * np.linspace(-1.0, 1.0, points), _JUST, 1.0 - _JUST)
        each = walls.take(np.repeat(np.arange(walls.size), points))
        speeds = np.repeat(speed, points)
        result = np.empty(each.size)
        for index in blocks(each):
            result[index] = _returned(each.take(index), speeds[index], phase.ravel()[index])
        tried = result.reshape(phase.shape)
        best = np.argmax(tried, axis=1)[:, None]
        worst = np.maximum(worst, np.take_along_axis(tried, best, axis=1)[:, 0])
        middle = np.take_along_axis(phase, best, axis=1)
        reach *= 2.0 / (points - 1)
    return worst


def _returned(walls: Walls, speed: FloatArray, phase: FloatArray) -> FloatArray:
    lead = walls.velocity_samples + 1.0 + phase
    m, period = walls.inertia, walls.period
    free = held_response(walls.damping * period / m, -lead)
    braked = walls.coulomb * period / m
    position = free.position_per_speed * speed - free.position_per_torque * braked
    before = free.speed_per_speed * speed - free.position_per_speed * braked
    loops = Loops(walls, position * period, before)
    contact = _Contact(loops, walls)
    half = np.pi * np.sqrt(walls.inertia / walls.stiffness) / walls.period
    length = float(np.max(_CONTACTS * (half + walls.whole) + lead))
    while loops.k < length:
        loops.run(_LOOK, contact.at_sample, contact.at_switch)
        if contact.over():
            break
    back = contact.leaving > 0.0
    return np.where(back, np.log(np.where(back, contact.leaving, 1.0) / speed), -1.0)


class _Contact:
    """Watches the speeds outside of the wall.

    Attributes:
        entered: Which servos have been inside of it.
        leaving: Greatest outward speed since the wall was left; 0 inside of it.
    """

    def __init__(self, loops: Loops, walls: Walls) -> None:
        self._loops = loops
        self._walls = walls
        self._decay = walls.damping / walls.inertia
        self._position = loops.bodies.position.copy()
        self._velocity = loops.bodies.velocity.copy()
        self._outside_for = np.zeros(walls.size, dtype=np.int64)
        self.entered = np.zeros(walls.size, dtype=np.bool_)
        self.leaving = np.zeros(walls.size)

    def at_sample(self) -> None:
        """Look at the end of a period."""
        self._look(self._walls.rest)
        self._outside_for += 1
        self._outside_for[~self.entered | (self._position > 0.0)] = 0

    def at_switch(self) -> None:
        """Look where the torque changes: under a held torque the speed changes one way only."""
        self._look(self._walls.lag)

    def _look(self, since: FloatArray) -> None:
        """Take what the time since the last look [s] has brought, in which a torque was held."""
        x, v = self._loops.bodies.position, self._loops.bodies.velocity
        before, came = self._position, self._velocity
        inside = x > 0.0
        self.entered |= inside
        out = ~inside & self.entered
        if out.any():
            speed = np.maximum(self.leaving, -v)
            # Within the step in which it left it may have been faster than at its end. The push
            # outwards is the balance of momentum; then the balance of energy from the wall on,
            # what friction takes on that short way by the mean of the speeds at its ends.
            crossed = out & (before > 0.0)
            push = (came - v + self._decay * (before - x)) / since
            lost = np.where(crossed, -self._decay * x, 0.0)
            square = lost * lost + 4.0 * (v * v + 2.0 * push * x - lost * v)
            at_wall = 0.5 * (lost + np.sqrt(np.maximum(square, 0.0)))
            speed = np.where(crossed, np.maximum(speed, at_wall), speed)
            self.leaving = np.where(out, speed, 0.0)
        self.leaving[inside] = 0.0
        np.copyto(before, x)
        np.copyto(came, v)

    def over(self) -> bool:
        """Whether every servo has left, and no torque is under way any more."""
        return bool(np.all(self._outside_for > self._walls.whole + 2))
