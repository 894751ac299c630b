"""Softens a wall about the load that it holds, and gives it back where that changes no torque.

The load is the wall's mean torque between two instants of rest: over a whole cycle, or while no
turning point comes. Whatever the wall does in between, its torque has carried the load then,
whether or not it saturates; friction cancels. So what is held follows the load, slowly.
"""

from __future__ import annotations

import math
from enum import IntEnum

from haptic_wall.controller.detector.half_cycles import HalfCycles
from haptic_wall.controller.detector.settings import WatchSettings
from haptic_wall.controller.detector.tuning import TUNING
from haptic_wall.controller.laws.wall import Derating, held_torque


class Phase(IntEnum):
    """The state of a wall."""

    WHOLE = 0
    PROBED = 1
    REDUCED = 2
    RETURNING = 3
    """The gains return as soon as the wall's spring is at rest."""


class SoftWall:
    """One wall, whole or softened; it alone changes its phase and its derating.

    Attributes:
        phase: Its state.
        derating: What is left of the law, which shares it, and the torque that holds the load.
        inside: The load's motion has stayed clear of the surface.
        permitted: The law is one linear spring: nothing is held by another one.
        stiffness: K without the derating [N·m/rad].
        damping: B without the derating [N·m·s/rad].
    """

    def __init__(self, motion: HalfCycles, settings: WatchSettings) -> None:
        """Start with the whole wall.

        Args:
            motion: Of the shaft.
            settings: Those of the watch.
        """
        self._motion = motion
        self.phase = Phase.WHOLE
        self.derating = Derating()
        self.inside = False
        self.stiffness = self.damping = 0.0
        self._away = self._torque = self._elongation = self._last = 0.0
        self._load = self._place = self._rested = self._low = self._high = 0.0
        self._since_rest = 0
        self.change(settings)

    def change(self, settings: WatchSettings) -> None:
        """Soften another law from now on."""
        self._settings = settings
        self._limit = settings.torque_limit
        self._least = TUNING.hold_least * self._limit
        self.permitted = settings.elongation is None

    def take(self, away: float, torque: float, stiffness: float, damping: float) -> None:
        """Take a sample; the arguments are those of ``Backstop.update``."""
        self._away, self._torque = away, torque
        self.stiffness, self.damping = stiffness, damping
        self._last, self._elongation = self._elongation, self._settings.elongated(away)

    @property
    def reduced(self) -> tuple[float, float]:
        """Return the scales of stiffness and damping, without those of a probe that goes on [1]."""
        if self.phase == Phase.PROBED:
            return 1.0, 1.0
        return self.derating.scale, self.derating.damping_scale

    def gives_way(self, load: float, steps: int, *, contacts: bool) -> bool:
        """Whether a load would push through the wall.

        Args:
            load: Torque [N·m].
            steps: Number of steps by which the wall is reduced; 0: it is probed.
            contacts: The load bounces on the wall, which then holds none.
        """
        limit = self._limit
        if self.permitted and not contacts:
            return abs(load) > TUNING.loaded * limit
        return abs(load) > TUNING.loaded_contacts * TUNING.scale**steps * limit

    def reduce(self, stiffness: float, damping: float, *, moves: bool) -> None:
        """Reduce the wall to these scales [1]; ``moves`` as of ``hold``, for a whole wall."""
        if self.phase == Phase.WHOLE:
            self.hold(moves=moves)
        self.phase = Phase.REDUCED
        self._scale(stiffness, damping)

    def let_return(self) -> None:
        """Let the wall return as soon as its spring is at rest."""
        self.phase = Phase.RETURNING

    def _scale(self, stiffness: float, damping: float) -> None:
        now = self.derating
        now.scale, now.damping_scale = stiffness, damping
        now.elastic_limit = stiffness * self._limit
        if stiffness == 1.0:
            self.drop()

    def probe(self, cycle: float, *, moves: bool) -> None:
        """Soften the wall for the probe of a motion.

        Args:
            cycle: Period of the motion [s].
            moves: The motion is certainly that of this shaft.
        """
        self.phase = Phase.PROBED
        rests = not self.hold(moves=moves)
        if rests and not self.permitted and self.gives_way(self._torque, 0, contacts=False):
            return  # the load would push through: this wall holds none
        # Damping that acts late stiffens the wall by up to B w, and would hide the softer spring.
        # Whole, it slows down a shaft whose load is let go.
        stiffens = self.damping * math.tau > self.stiffness * cycle
        holds = self.derating.carried != 0.0
        self._scale(TUNING.scale, 1.0 if holds and not stiffens else TUNING.scale)

    def hold(self, *, moves: bool) -> bool:
        """Hold the load of the last cycle, or that at rest, from now on; return whether it moves.

        The whole spring carries the load in the middle of the motion: where the middle of the last
        half-cycle is clearly nearer to the surface, the load is just leaving.

        Args:
            moves: The shaft certainly moves.
        """
        motion = self._motion
        moves = moves or motion.settled <= TUNING.hold_settled
        last = list(motion.last)[-2:]
        turned = [place for one in last for place in (one.start, one.end)] or [0.0]
        if moves:
            self._since_rest = known = len(motion.last)
            load = motion.mean_torque(known) if known >= 2 and self.permitted else 0.0
            side = math.copysign(1.0, load)
            depth = self._room - side * (0.5 * (last[-1].start + last[-1].end) if last else 0.0)
            load = side * min(abs(load), self.stiffness * max(depth, 0.0))
            self._low, self._high = min(turned), max(turned)
        else:
            self._since_rest = -1
            self._low = self._high = self._elongation
            turned.append(self._elongation)
            load = self._torque if self.permitted else 0.0
        self._load = load = load if abs(load) > self._least else 0.0
        self.derating.soft_to = max(abs(one) for one in turned) + self._room
        self._carry(load)
        return moves

    def follow(self, span: float, *, ended: bool) -> None:
        """Change what is held toward the load.

        Args:
            span: Time since the last sample [s].
            ended: A half-cycle has ended.
        """
        if not self.permitted:
            return
        motion, away, carried = self._motion, self._away, self.derating.carried
        scale = self.derating.scale
        returning = self.phase == Phase.RETURNING  # where it holds the whole load
        self._rested += span
        if self.stiffness * abs(away - self._place) > self._least:
            self._place, self._rested = away, 0.0
        rests = self._rested * math.sqrt(scale) > TUNING.hold_rests_s  # it swings slower
        if rests and motion.settled > TUNING.hold_settled:
            self._load = self._torque
            self._since_rest = -1  # the half-cycle with the rest in it is no part of a motion
            self._low = self._high = away
        elif ended:
            self._since_rest += 1
            self._extend()
            known = min(len(motion.last), self._since_rest)
            load = motion.mean_torque(known) if known >= 2 else self._load
            clear = returning or abs(load - carried) > self._least
            self._load = load if clear else carried
        elif self.inside and away * carried > 0.0:
            self._load = 0.0  # the load has gone, or the next cycle tells its torque
        change = self._load - carried
        if not (returning or abs(change) > TUNING.hold_slack * self._limit * scale):
            change = 0.0  # the spring about what is held carries it
        share = min(span / TUNING.hold_follows_s, 1.0)
        self._carry(carried + share * change)

    @property
    def _room(self) -> float:
        last = list(self._motion.last)[-2:]
        return TUNING.hold_room * max((one.amplitude for one in last), default=0.0)

    def _extend(self) -> None:
        """Let the motion since the last rest reach to the last turning point.

        The load's motion that was clear of the surface does not pass it: a shaft that turns around
        on the other side has lost the load.
        """
        turned = self._motion.last[-1].end
        if not (self.inside and turned * self.derating.carried > 0.0):
            self._low, self._high = min(self._low, turned), max(self._high, turned)

    def _carry(self, torque: float) -> None:
        """Hold a torque, up to its place in the whole spring or the turning points, and some more.

        Args:
            torque: [N·m]
        """
        if self.stiffness <= 0.0:
            return
        now, place = self.derating, -torque / self.stiffness
        spare = 0.5 * TUNING.hold_room * (self._high - self._low)
        now.carried = torque
        if torque > 0.0:
            now.carried_to = max(place, self._high) + spare
        else:
            now.carried_to = min(place, self._low) - spare
        self.inside = now.carried_to * torque < 0.0

    def drop(self) -> None:
        """Hold nothing any more."""
        self.derating.carried = self.derating.carried_to = self._load = 0.0

    def loses_load(self) -> bool:
        """Drop a load that has gone; return whether it has just gone.

        It has where the shaft is past the surface: outside a one-sided wall, and where the load's
        motion has not come near before if the whole wall comes back now. The motion until then was
        the load's.
        """
        carried, soft = self.derating.carried, self.phase == Phase.REDUCED
        ends = (self.inside and not soft) or self._settings.side != 0
        gone = carried != 0.0 and ends and self._elongation * carried >= 0.0
        if gone:
            self.drop()
            self._motion.last.clear()
        return gone

    def returns(self) -> bool:
        """Give the wall back if its spring is at rest; return whether it was.

        A fast motion is at rest between two samples.
        """
        missing = self._missing(self._elongation)
        most = self._settings.rest_torque
        if missing * self._missing(self._last) < 0.0:
            most *= TUNING.rest_between
        least = TUNING.rest_counts * self._settings.position_step
        softer = 1.0 - self.derating.scale
        rests = abs(missing) <= max(most, least * softer * self.stiffness)
        if rests:
            self.phase = Phase.WHOLE
            self._scale(1.0, 1.0)
        return rests

    def _missing(self, elongation: float) -> float:
        """Return the torque by which the whole spring's differs from the present one's [N·m]."""
        now, spring, held = self.derating, self.stiffness * elongation, 0.0
        if now.carried:
            held = held_torque(now.carried, now.carried_to, elongation, self.stiffness, now.scale)
        return (1.0 - now.scale) * spring + held
