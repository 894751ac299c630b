"""Computes the torque that keeps a load in its place while the spring is softened.

The load is the wall's mean torque between two instants of rest: over a whole cycle, or while no
turning point comes. Whatever the wall does in between, its torque has carried the load then,
whether or not it saturates; friction cancels. So what is held follows the load, slowly.
"""

from __future__ import annotations

import math

from haptic_wall.controller.detector.half_cycles import HalfCycles
from haptic_wall.controller.detector.settings import WatchSettings
from haptic_wall.controller.laws.wall import held_torque


class LoadHold:
    """The torque that holds a load.

    Attributes:
        torque: About which the spring is softened [N·m]; 0: there is no load.
        inside: The load's motion has stayed clear of the surface.
        reach: Distance from the surface up to which it acts in full, on the side without the load
            [rad].
        deep: Distance from the surface, either way, up to which the motion goes [rad]: deeper, the
            softer spring has the whole limit.
        permitted: The law is one linear spring: nothing is held by another one.
        one_sided: The wall has an outside, where nothing is held.
    """

    def __init__(self, motion: HalfCycles, settings: WatchSettings) -> None:
        """Hold nothing.

        Args:
            motion: The observed motion.
            settings: Those of the watch.
        """
        self._motion = motion
        self._tuning = settings.tuning
        self.inside = False
        self.torque = self.reach = self.deep = self._load = 0.0
        self._place = self._rested = self._low = self._high = 0.0
        self._since_rest = 0
        self.change(settings)

    def change(self, settings: WatchSettings) -> None:
        """Hold the load of another law from now on."""
        self._limit = settings.torque_limit
        self._least = settings.tuning.hold_least * self._limit
        self.one_sided = settings.side != 0
        self.permitted = settings.elongation is None

    def begin(self, stiffness: float, rest: tuple[float, float] | None = None) -> None:
        """Hold the load of the last cycle from now on.

        The whole spring carries the load in the middle of the motion: where the middle of the last
        half-cycle is clearly nearer to the surface, the load is just leaving.

        Args:
            stiffness: K of the whole spring [N·m/rad].
            rest: Place [rad] and torque of the wall [N·m] where the shaft rests; None: it moves.
        """
        motion = self._motion
        last = list(motion.last)[-2:]
        turned = [place for one in last for place in (one.start, one.end)] or [0.0]
        if rest is not None:
            self._since_rest = -1
            self._low = self._high = rest[0]
            turned.append(rest[0])
            load = rest[1] if self.permitted else 0.0
        else:
            self._since_rest = known = len(motion.last)
            load = motion.mean_torque(known) if known >= 2 and self.permitted else 0.0
            side = math.copysign(1.0, load)
            depth = self._room - side * (0.5 * (last[-1].start + last[-1].end) if last else 0.0)
            load = side * min(abs(load), stiffness * max(depth, 0.0))
            self._low, self._high = min(turned), max(turned)
        self._load = load = load if abs(load) > self._least else 0.0
        self.deep = max(abs(one) for one in turned) + self._room
        self._hold(load, stiffness)

    def follow(
        self,
        away: float,
        torque: float,
        span: float,
        stiffness: float,
        scale: float,
        *,
        ended: bool,
        returning: bool,
    ) -> None:
        """Change what is held toward the load.

        Args:
            away: Position from the surface [rad].
            torque: Torque of the wall now [N·m]: that of the load where no turning point comes any
                more.
            span: Time since the last sample [s].
            stiffness: K of the whole spring [N·m/rad].
            scale: Of the present one [1].
            ended: A half-cycle has ended.
            returning: The wall waits to come back, which it does where it holds the whole load.
        """
        if not self.permitted:
            return
        motion = self._motion
        self._rested += span
        if stiffness * abs(away - self._place) > self._least:
            self._place, self._rested = away, 0.0
        rests = self._rested * math.sqrt(scale) > self._tuning.hold_rests_s  # it swings slower
        if rests and motion.settled > self._tuning.hold_settled:
            self._load = torque
            self._since_rest = -1  # the half-cycle with the rest in it is no part of a motion
            self._low = self._high = away
        elif ended:
            self._since_rest += 1
            self._extend()
            known = min(len(motion.last), self._since_rest)
            load = motion.mean_torque(known) if known >= 2 else self._load
            clear = returning or abs(load - self.torque) > self._least
            self._load = load if clear else self.torque
        elif self.inside and away * self.torque > 0.0:
            self._load = 0.0  # the load has gone, or the next cycle tells its torque
        change = self._load - self.torque
        if not (returning or abs(change) > self._tuning.hold_slack * self._limit * scale):
            change = 0.0  # the spring about what is held carries it
        share = min(span / self._tuning.hold_follows_s, 1.0)
        self._hold(self.torque + share * change, stiffness)

    @property
    def _room(self) -> float:
        last = list(self._motion.last)[-2:]
        return self._tuning.hold_room * max((one.amplitude for one in last), default=0.0)

    def _extend(self) -> None:
        """Let the motion since the last rest reach to the last turning point.

        The load's motion that was clear of the surface does not pass it: a shaft that turns around
        on the other side has lost the load.
        """
        turned = self._motion.last[-1].end
        if not (self.inside and turned * self.torque > 0.0):
            self._low, self._high = min(self._low, turned), max(self._high, turned)

    def _hold(self, torque: float, stiffness: float) -> None:
        """Hold a torque, up to its place in the whole spring or the turning points, and some more.

        Args:
            torque: [N·m]
            stiffness: K of the whole spring [N·m/rad].
        """
        if stiffness <= 0.0:
            return
        place = -torque / stiffness
        spare = 0.5 * self._tuning.hold_room * (self._high - self._low)
        self.torque = torque
        if torque > 0.0:
            self.reach = max(place, self._high) + spare
        else:
            self.reach = min(place, self._low) - spare
        self.inside = self.reach * torque < 0.0

    def leave(self) -> None:
        """Hold nothing any more: the load has gone, and the motion until now was its motion."""
        self.drop()
        self._motion.last.clear()

    def drop(self) -> None:
        """Hold nothing any more."""
        self.torque = self.reach = self._load = 0.0

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

    def left(self, away: float, *, soft: bool) -> bool:
        """Whether the shaft is past the surface where nothing must be held.

        That is outside a one-sided wall, and where the load's motion has not come near before if
        the whole wall comes back now.

        Args:
            away: Distance from the surface [rad].
            soft: The wall stays soft.
        """
        return ((self.inside and not soft) or self.one_sided) and away * self.torque >= 0.0
