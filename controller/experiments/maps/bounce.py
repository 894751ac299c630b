"""Computes from single contacts whether a one-sided wall returns a servo faster than it came.

``theory.contact`` does the same for servos without friction, encoder, backlash and torque limit.
That module is separate because it is exact and dimensionless. Tests compare each of the two with
the other.
"""

from __future__ import annotations

import numpy as np

from haptic_wall.controller.experiments.maps import lane_rows
from haptic_wall.controller.experiments.maps.kicks import unsaturated
from haptic_wall.controller.experiments.maps.many_walls import Loops
from haptic_wall.controller.experiments.maps.walls import Walls, blocks
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.controller.theory.response import held_response
from haptic_wall.hw.plant.many_two_masses import ManyTwoMasses

_PHASES = (17, 9, 9)
"""Numbers of tried instants of entry: over the whole period, then twice around the worst one"""
_JUST = 1e-9
"""Distance between the last tried entry and the end of the period [periods]"""
_CONTACTS = 6.0
"""Longest simulated contact, in half oscillations of the undamped spring; a servo that then still
creeps out has exit speed 0"""
_LOOK = 32


def returned(walls: Walls, kick: FloatArray) -> FloatArray:
    """Return log(exit speed / entry speed) at the worst phase; above 0 the servo returns faster.

    The servo moves freely and enters with the speed that the spring alone would stop within
    ``kick``. It starts outside, early enough for the velocity estimate. The exit speed is the
    greatest one outside, until the last commanded torque has ended. With a load it includes the
    vibration: it is that of a rigid servo of the same energy.

    Args:
        walls: One-sided walls with stiffness > 0.
        kick: Penetration at which the undamped spring would stop the servo, > 0 [rad]; where it
            would saturate, ``kicks.unsaturated`` replaces it.

    Returns:
        The greatest value over the instants of entry between two samples; -1 if every exit speed is
        0.
    """
    middle, reach = np.full((walls.size, 1), 0.5), 0.5
    worst = np.full(walls.size, -np.inf)
    speed = unsaturated(walls, kick) * np.sqrt(walls.stiffness / walls.moved)
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
    m, period = walls.moved, walls.period
    free = held_response(walls.damping * period / m, -lead)
    braked = walls.coulomb * period / m
    position = free.position_per_speed * speed - free.position_per_torque * braked
    before = free.speed_per_speed * speed - free.position_per_speed * braked
    loops = Loops(walls, position * period, before)
    contact = _Contact(loops, walls)
    half = np.pi * np.sqrt(walls.moved / walls.stiffness) / walls.period
    length = float(np.max(_CONTACTS * (half + walls.whole) + lead))
    while loops.k < length:
        contact.run(_LOOK)
        if contact.over():
            break
    back = contact.leaving > 0.0
    return np.where(back, np.log(np.where(back, contact.leaving, 1.0) / speed), -1.0)


class _Contact:
    """Records the speeds outside the wall.

    Attributes:
        entered: Whether each servo has been inside.
        leaving: Greatest outward speed since the wall was left; 0 inside.
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
        self._memory: FloatArray | None = None
        if loops.lanes is not None:
            self._memory = loops.lanes.seen(self._velocity, self._position)

    def run(self, periods: int) -> None:
        """Simulate some periods, and record them."""
        memory = self._memory
        if memory is None:
            self._loops.run(periods, self.at_sample, self.at_switch)
            return
        self._loops.run_watched(periods, lane_rows.CONTACTS, memory)
        self.leaving = memory[lane_rows.LEAVING]
        np.not_equal(memory[lane_rows.ENTERED], 0.0, self.entered)
        np.copyto(self._outside_for, memory[lane_rows.OUTSIDE], casting="unsafe")

    def at_sample(self) -> None:
        """Record the state at the end of a period."""
        self._look(self._walls.rest)
        self._outside_for += 1
        self._outside_for[~self.entered | (self._position > 0.0)] = 0

    def at_switch(self) -> None:
        """Record the state at a change of the torque; the speed is monotone between two changes."""
        self._look(self._walls.lag)

    def _look(self, since: FloatArray) -> None:
        """Update ``leaving`` and ``entered`` for the time ``since`` the last record [s]."""
        x, v = self._loops.bodies.position, self._loops.bodies.velocity
        before, came = self._position, self._velocity
        inside = x > 0.0
        self.entered |= inside
        out = ~inside & self.entered
        if isinstance(self._loops.bodies, ManyTwoMasses):
            speed = np.maximum(self.leaving, self._loops.bodies.rigid_speed)
            self.leaving = np.where(out, speed, 0.0)
        elif out.any():
            speed = np.maximum(self.leaving, -v)
            # In the step in which it left it may have been faster than at the end. The push
            # outwards follows from momentum, the speed at the wall from energy, with friction at
            # the mean of the speeds at both ends.
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
        """Whether every servo has left the wall, and every delayed torque has ended."""
        return bool(np.all(self._outside_for > self._walls.whole + 2))
