"""Holds the load on a wall while its spring is softer: the spring is softened about its torque.

The velocity is zero at both ends of a whole cycle, so that the wall's mean torque in it is that of
the load, whether or not the torque saturates; friction cancels. It is constant from one half-cycle
to the next at least, so that the loop is that of the softer spring. The hold ends where the load
has gone: at the wall's surface, or where the wall pushes with less than half of it.
"""

from __future__ import annotations

import math

from haptic_wall.controller.detector.half_cycles import HalfCycles
from haptic_wall.controller.detector.tuning import HoldTuning
from haptic_wall.controller.laws.wall import held_torque


class LoadHold:
    """The torque that holds a load.

    Attributes:
        torque: About which the spring is softened [N·m]; 0: there is no load.
        inside: The load's motion has stayed clear of the surface.
        reach: Distance from the surface up to which it acts in full, on the side without the load
            [rad].
        permitted: A load may be held from now on. Not while something else has softened the wall:
            the mean torque is then that of the softer spring.
    """

    __slots__ = (
        "_limit",
        "_motion",
        "_one_sided",
        "_tuning",
        "inside",
        "permitted",
        "reach",
        "torque",
    )

    def __init__(
        self, motion: HalfCycles, torque_limit: float, tuning: HoldTuning, *, one_sided: bool
    ) -> None:
        """Hold nothing.

        Args:
            motion: The observed motion.
            torque_limit: Of the servo [N·m].
            tuning: Numbers for the hold.
            one_sided: The wall has an outside, where nothing is held.
        """
        self._motion = motion
        self._limit = torque_limit
        self._tuning = tuning
        self._one_sided = one_sided
        self.inside = False
        self.permitted = True
        self.torque = self.reach = 0.0

    def begin(self, stiffness: float, *, whole: bool) -> None:
        """Hold the mean torque of the last cycle.

        Args:
            stiffness: K of the whole spring [N·m/rad].
            whole: The whole spring acted until now. It carries the load in the middle of the
                motion: where the middle of the last half-cycle is clearly nearer to the surface,
                the load is just leaving.
        """
        self.drop()
        motion = self._motion
        if not self.permitted or motion.known < 2:
            return  # friction has its part in a single half-cycle
        load = motion.mean_torque()
        if whole:
            side = math.copysign(1.0, load)
            depth = self._room - 0.5 * side * (motion.turned + motion.turned_2)
            load = side * min(abs(load), stiffness * max(depth, 0.0))
        if abs(load) > self._least:
            self._hold(load, stiffness)

    def follow(self, most: float, stiffness: float) -> None:
        """Change what is held toward the mean torque of the last cycle.

        Args:
            most: Largest change [N·m].
            stiffness: K of the whole spring [N·m/rad].
        """
        if self.torque and self._motion.known >= 2:
            change = self._motion.mean_torque() - self.torque
            self._hold(self.torque + min(max(change, -most), most), stiffness)

    @property
    def _least(self) -> float:
        return self._tuning.least * self._limit

    @property
    def _room(self) -> float:
        return self._tuning.room * max(self._motion.amplitude, self._motion.amplitude_2)

    def _hold(self, torque: float, stiffness: float) -> None:
        """Hold a torque, up to its place in the whole spring or the turning points, and some more.

        Args:
            torque: [N·m]
            stiffness: K of the whole spring [N·m/rad].
        """
        motion = self._motion
        if stiffness <= 0.0:
            return
        places = motion.turned, motion.turned_2, motion.turned_3, -torque / stiffness
        self.torque = torque
        self.reach = max(places) + self._room if torque > 0.0 else min(places) - self._room
        self.inside = self.reach * torque < 0.0

    def drop(self) -> None:
        """Hold nothing any more."""
        self.torque = self.reach = 0.0

    def acts(self, away: float, stiffness: float, scale: float) -> float:
        """Return the torque that is added at a distance from the surface [N·m].

        Args:
            away: [rad]
            stiffness: K [N·m/rad].
            scale: Of it [1].
        """
        if not self.torque:
            return 0.0
        return held_torque(self.torque, self.reach, away, stiffness, scale)

    def left(self, away: float) -> bool:
        """Whether the shaft is past the surface where nothing must be held.

        That is outside a one-sided wall, and where the load's motion has not come near before.

        Args:
            away: Distance from the surface [rad].
        """
        return (self.inside or self._one_sided) and away * self.torque >= 0.0

    def gone(self, torque: float) -> bool:
        """Whether the wall pushes with less than half of the hold: the load has gone.

        Args:
            torque: Mean or resting torque of the wall [N·m].
        """
        return torque * self.torque < self._tuning.gone * self.torque * self.torque
