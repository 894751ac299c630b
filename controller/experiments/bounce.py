"""Whether a wall that never pulls returns a servo faster than it came, told by single contacts."""

from __future__ import annotations

import numpy as np

from controller.experiments.many_walls import Loops, Walls, blocks
from controller.theory.checks import FloatArray

_PHASES = 17
_CONTACTS = 6.0
"""How many half oscillations (of the undamped spring) a contact is followed at most; a wall that
lets the servo only creep out returns no speed."""
_LOOK = 32


def returned(walls: Walls, kick: FloatArray) -> FloatArray:
    """Logarithm of exit speed over entry speed at the worst phase; > 0: it returns faster.

    The servo comes freely, with the speed that the spring alone would stop after ``kick``. It
    starts outside, early enough that the velocity estimate knows that speed at the entry. The
    exit speed is the greatest outside, until no commanded torque acts any more.

    Args:
        walls: One-sided walls with stiffness > 0.
        kick: Penetration at which the undamped spring would stop the servo, > 0 [rad].

    Returns:
        The worst over evenly spread instants of entry between two samples. Where friction stops
        the servo on its way to the wall, or nothing is returned: -1.
    """
    phases = np.linspace(0.0, 1.0, _PHASES)
    each = walls.take(np.repeat(np.arange(walls.size), _PHASES))
    speed = np.repeat(kick * np.sqrt(walls.stiffness / walls.inertia), _PHASES)
    phase = np.tile(phases, walls.size)
    result = np.empty(each.size)
    for index in blocks(each):
        result[index] = _returned(each.take(index), speed[index], phase[index])
    worst: FloatArray = result.reshape(walls.size, _PHASES).max(axis=1)
    return worst


def _returned(walls: Walls, speed: FloatArray, phase: FloatArray) -> FloatArray:
    lead = walls.velocity_samples + 1.0 + phase
    loops = Loops(walls, -lead * walls.period * speed, speed)
    contact = _Contact(loops, walls)
    half = np.pi * np.sqrt(walls.inertia / walls.stiffness) / walls.period
    length = float(np.max(_CONTACTS * (half + walls.whole) + lead))
    while loops.k < length:
        loops.run(_LOOK, contact.watch)
        if contact.over():
            break
    came, left = contact.entry, contact.leaving
    back = (came > 0.0) & (left > 0.0)
    ratio = np.where(back, left, 1.0) / np.where(back, came, 1.0)
    return np.where(back, np.log(ratio), -1.0)


class _Contact:
    """Watches the speeds outside of the wall.

    Attributes:
        entry: Speed of the first entry [rad/s]; 0 before.
        leaving: Greatest outward speed since the wall was left; 0 inside of it.
    """

    def __init__(self, loops: Loops, walls: Walls) -> None:
        self._loops = loops
        self._walls = walls
        self._position = loops.bodies.position.copy()
        self._velocity = loops.bodies.velocity.copy()
        self._outside_for = np.zeros(walls.size, dtype=np.int64)
        self.entry = np.zeros(walls.size)
        self.leaving = np.zeros(walls.size)

    def watch(self) -> None:
        """Look at the period that has just passed."""
        x, v = self._loops.bodies.position, self._loops.bodies.velocity
        before, came = self._position, self._velocity
        inside = x > 0.0
        enters = np.flatnonzero(inside & (before <= 0.0) & (self.entry == 0.0))
        if enters.size:
            # No torque acts on the way in: the speed falls with the distance.
            walls, u = self._walls, came[enters]
            lost = (walls.damping[enters] + walls.coulomb[enters] / u) / walls.inertia[enters]
            self.entry[enters] = u + lost * before[enters]
        out = ~inside & (self.entry > 0.0)
        if out.any():
            speed = np.maximum(self.leaving, -v)
            # Within the step in which it left it may have been faster than at its end.
            crossed = out & (before > 0.0)
            gain = 2.0 * (came - v) / self._walls.period * np.abs(x)
            at_wall = np.sqrt(np.maximum(v * v - gain, 0.0))
            speed = np.where(crossed, np.maximum(speed, at_wall), speed)
            self.leaving = np.where(out, speed, 0.0)
            self._outside_for += 1
        self._outside_for[~out] = 0
        self.leaving[inside] = 0.0
        np.copyto(before, x)
        np.copyto(came, v)

    def over(self) -> bool:
        """Whether every servo has left, and no torque is under way, or has stopped before."""
        gone = self._outside_for > self._walls.whole + 2
        stopped = (self.entry == 0.0) & (self._loops.bodies.velocity <= 0.0)
        return bool(np.all(gone | stopped))
