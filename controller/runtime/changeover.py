"""Decides in which tick a change of a running wall gives the shaft no energy.

Before and after that tick law, stiffness, damping and delay are as the guard has decided them
together, so that no pair of an old and a new value ever acts. The tick is one in which the new law
holds no more energy than the old one, and in which the torque hardly jumps. Only one thing is done
before: a stiffness that is to fall falls along a ramp, which always takes energy. So K goes down
before B goes down or the delay up, and goes up no sooner than B.

A derating after an oscillation stays. While there is one, no change is made that could feed the
oscillation again: only the stiffness may go down.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Final

from haptic_wall.controller.detector.soft_wall import Phase
from haptic_wall.controller.detector.watch import Watch
from haptic_wall.controller.guard.schedule import Allowed
from haptic_wall.controller.laws.delay import DelayRing
from haptic_wall.controller.laws.wall import Law

MOST_J: Final = 1e-4
"""Energy that counts as none [J]: a spring of 85 N·m/rad holds it at one count of 4096"""
SPEED_TICKS: Final = 8
"""Ticks over which the speed is taken: one encoder count in a period is no speed"""


class Obstacle(IntEnum):
    """The reason why a change waits."""

    NONE = 0
    NOT_ON = 1
    """The wall has not come on yet."""
    READING = 2
    """The position, or the speed, of the shaft is not known."""
    PROBED = 3
    """The wall is being probed for an oscillation."""
    REDUCED = 4
    """An oscillation has reduced the wall."""
    ENERGY = 5
    """The new law would hold more energy [J]."""
    TORQUE = 6
    """The torque would jump [N·m]."""
    DELAY = 7
    """The shaft moves too fast for another delay [rad/s]."""


class Changeover:
    """Finds the tick for a change.

    Args:
        torque: Largest jump of the torque [N·m]: ``safety.engage_torque``.
        torque_limit: Torque limit of the servo [N·m].
        period: T [s].

    Attributes:
        size: Size of the obstacle found last, in its unit.
    """

    def __init__(self, torque: float, torque_limit: float, period: float) -> None:
        self._torque, self._torque_limit, self._period = torque, torque_limit, period
        self.restart()

    def restart(self) -> None:
        """Begin with another change: the positions so far are not followed by the next ones."""
        self._positions: list[float] = []
        self.size = 0.0

    def watched(self, watch: Watch, softer: bool) -> Obstacle:
        """Return the obstacle that the oscillation watch is, if it is one."""
        wall, found = watch.backstop.wall, Obstacle.NONE
        if not softer and min(wall.reduced) < 1.0:
            found = Obstacle.REDUCED
        elif wall.phase == Phase.PROBED or (not softer and watch.current):
            found = Obstacle.PROBED
        if found is not Obstacle.NONE:
            self.restart()  # of the ticks from here on no position is known
        return found

    def obstacle(
        self,
        old: Law,
        ring: DelayRing,
        new: Law,
        allowed: Allowed,
        steps: int,
        position: float,
        velocity: float,
    ) -> Obstacle:
        """Return the obstacle to making the change in this tick; call it in each tick that is on.

        Both laws are asked for their torque; neither is changed.

        Args:
            old: The law in force.
            ring: The inserted delay in force.
            new: The law after the change; the same one, or another, which has rested so far.
            allowed: What is commanded after the change; its delay is the longer of both.
            steps: Inserted delay after the change [periods].
            position: Position of the shaft [rad].
            velocity: Velocity as the law gets it [rad/s].
        """
        period, most = self._period, max(ring.steps, steps)
        if not self._known(position, most):
            return Obstacle.READING
        fastest = self._fastest(most)
        reach = fastest * period * (most + 1)
        places = [position, position + self._speed() * allowed.delay]
        if most >= SPEED_TICKS:  # so long that the shaft may turn before the torque acts
            places += position - reach, position + reach
        held = [self._held(old, place, least=True) for place in places]
        torque = old.torque(position, velocity)
        before = old.stiffness, old.damping
        if new is not old:
            adopt(new, old)
            new.settle(position)
        new.stiffness, new.damping = allowed.stiffness, allowed.damping
        torque_then = new.torque(position, velocity)
        more = max(
            self._held(new, place, least=False) - less
            for place, less in zip(places, held, strict=True)
        )
        if new is old:
            old.stiffness, old.damping = before
        if not more <= MOST_J:
            self.size = more
            return Obstacle.ENERGY
        added = steps - ring.steps
        jump = abs(torque_then - torque)
        if added:
            resized = ring.resized(steps, torque, torque)
            jump = max(jump, abs(resized.coming(torque_then) - ring.coming(torque)))
        if not jump <= self._torque:
            self.size = jump
            return Obstacle.TORQUE
        if added:
            # Until the new delay is whole the torque is neither that of the old law nor that of the
            # new one. It differs from them by what the shaft does in that time.
            stiffness = max(before[0], allowed.stiffness) * abs(added) / (most + 1)
            damping = max(before[1], allowed.damping)
            late = (jump + stiffness * reach + 2.0 * damping * fastest) * reach
            if not late <= 0.5 * MOST_J:
                self.size = fastest
                return Obstacle.DELAY
        return Obstacle.NONE

    def _known(self, position: float, most: int) -> bool:
        """Store a position; whether those of as many ticks are known as a torque is under way.

        So the ring holds no torque of the law before the present one.

        Args:
            position: [rad]
            most: Steps of the longer delay [periods].
        """
        positions = self._positions
        positions.append(position)
        if len(positions) <= max(SPEED_TICKS, most + 1):
            return False
        del positions[: -max(SPEED_TICKS, most + 1) - 1]
        return True

    def _speed(self) -> float:
        """Return the mean speed over the last ticks [rad/s]."""
        positions = self._positions
        return (positions[-1] - positions[-1 - SPEED_TICKS]) / (SPEED_TICKS * self._period)

    def _fastest(self, most: int) -> float:
        """Return the speed of the last ticks, or that of a delay if it was higher [rad/s].

        Of the last ticks the faster half counts: near a turning point the mean is zero.
        """
        positions, period, half = self._positions, self._period, SPEED_TICKS // 2
        last, middle, first = positions[-1], positions[-1 - half], positions[-1 - SPEED_TICKS]
        way = max(abs(last - middle), abs(middle - first))
        window = positions[-most - 2 :]
        return max(way / half, (max(window) - min(window)) / (most + 1)) / period

    def _held(self, law: Law, position: float, *, least: bool) -> float:
        """Return a lower or an upper bound of the energy in the law's spring [J].

        A limited torque takes more way for the same energy. Of a law with several slopes only the
        energy of the unlimited spring is known. A limited one that exceeds its limit L somewhere
        holds at least ``L² / 2 K``: no slope is above K.
        """
        if not law.in_contact(position):
            return 0.0
        limit = min(law.clip, self._torque_limit)
        if not law.linear and least and law.stiffness * law.elongation(position) > limit:
            return 0.5 * limit * limit / law.stiffness
        return law.stored(position, limit)


def adopt(new: Law, old: Law) -> None:
    """Give a law the state that is not its own: the derating, and the injected damping."""
    new.derating, new.held, new.injected = old.derating, old.held, old.injected
