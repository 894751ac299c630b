"""Judges from energy whether the wall feeds a motion; tolerates parameter errors of 20 %.

The energy that a wall gives depends only on the wall and the motion, not on the source of the
motion: a spring returns the energy that it took, a damper takes energy, and delay adds energy. So a
wall that gives more than friction dissipates is too stiff, with or without a hand on the shaft.

A hand is detected by a remainder: over a half-cycle the work of the torque equals that of friction,
and the moment of the torque equals that of the inertia, unless a hand acts too.

Source: condition on work after Hannaford and Ryu, IEEE T-RA 18(1), 2002, with the acting torque.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from haptic_wall.controller.detector.half_cycle_sums import HalfCycle, Sums
from haptic_wall.controller.detector.tuning import EnergyTuning


class EnergyBalance:
    """Judges the energy of a motion, and its source.

    Attributes:
        surface: Position of the wall [rad]; NaN: not known.
        side: 0: two-sided; +1 or -1: it fills the positions above or below, and never pulls.
        elongation: Elongation of a linear spring with the same energy, over position [rad]; None:
            the law is linear, and its zero is the surface.
        virtual_damping: Commanded B [N·m·s/rad]; 0 where it is not known.
        held: Constant torque that holds a load beside the spring [N·m].
        lag: Believed delay from a sample until its torque acts [s].
        moves: Whether the torque's moment was that of this servo's inertia in the last half-cycle.
        pays: Whether the torque's work was that of friction, so that there was no other source or
            sink.
        share: Apparent over believed inertia.
        left: The torque's work beyond that of friction, as a damping over ``m ω``; 0 without the
            inertia.
    """

    __slots__ = (
        "_coulomb",
        "_damping",
        "_fewest",
        "_inertia",
        "_limit",
        "_natural",
        "_period",
        "_step",
        "_stiffness",
        "_torque_step",
        "_tuning",
        "elongation",
        "held",
        "lag",
        "left",
        "moves",
        "pays",
        "share",
        "side",
        "surface",
        "virtual_damping",
    )

    def __init__(
        self,
        period: float,
        inertia: float,
        damping: float,
        coulomb: float,
        position_step: float,
        limit: float,
        tuning: EnergyTuning,
        torque_step: float = 0.0,
    ) -> None:
        """Store the believed values of the servo; see ``DetectorSettings``."""
        self._tuning = tuning
        self._period = period
        self._fewest = tuning.fewest_periods * period
        self._inertia = inertia
        self._damping = 0.0 if math.isnan(damping) else damping
        self._coulomb = 0.0 if math.isnan(coulomb) else coulomb
        self._step = 0.0 if math.isnan(position_step) else position_step
        self._limit = limit
        self._torque_step = torque_step
        self._stiffness = self._natural = math.nan
        self.surface = math.nan
        self.virtual_damping = self.held = 0.0
        self.side = 0
        self.elongation: Callable[[float], float] | None = None
        self.lag = 0.0
        self.moves = self.pays = False
        self.share = self.left = 0.0

    @property
    def stiffness(self) -> float:
        """Commanded K [N·m/rad]; NaN: not known."""
        return self._stiffness

    @stiffness.setter
    def stiffness(self, value: float) -> None:
        self._stiffness = value
        self._natural = math.sqrt(value / self._inertia) if value > 0.0 else math.nan

    @property
    def natural(self) -> float:
        """Return the angular frequency of the undamped oscillation [rad/s]; NaN: not known."""
        return self._natural

    def potential(self, position: float) -> float:
        """Return the energy in the wall's spring with limited torque [J]; NaN: not known."""
        if self.elongation is not None:
            depth = self.elongation(position)
            return 0.5 * self._stiffness * depth * depth
        depth = position - self.surface
        if self.side:
            depth *= self.side
            if depth <= 0.0:
                return 0.0
        elif depth < 0.0:
            depth = -depth
        stiffness, limit = self._stiffness, self._limit
        if stiffness * depth > limit:
            return limit * (depth - 0.5 * limit / stiffness)
        return 0.5 * stiffness * depth * depth

    def gives_out(self, now: Sums, since: Sums, way: float, speed: float) -> bool:
        """Whether the wall has given clearly more since a turning point than friction dissipates.

        Args:
            now: The sums to the present.
            since: Those to an earlier turning point; with a one-sided wall, the one before the
                last: it returns on the way out what it has taken on the way in.
            way: Distance from that turning point [rad].
            speed: Present velocity [rad/s].
        """
        step = self._step
        elapsed = now[1] - since[1]
        if elapsed < self._fewest:
            return False
        tuning = self._tuning
        square = now[3] - since[3]
        stored = self.potential(since[0])
        lost = self._damping * square + self._coulomb * way
        given = now[2] - since[2] + self.potential(now[0]) - stored
        given -= self.held * (now[0] - since[0])
        late = self._stiffness * self.lag
        left = given - (1.0 + tuning.wrong) * lost - tuning.delay * late * square
        # A delayed damper gives energy in the middle of a half-cycle, as if the body were lighter;
        # hold and difference add to it in second order.
        spring, damper = self.lag + 0.5 * self._period, self.lag + self._period
        lent = self.virtual_damping * damper - 0.5 * self._stiffness * spring * spring
        if lent > 0.0:
            left -= 0.5 * lent * speed * speed
        # Over a whole half-cycle both terms are the energy of the oscillation.
        energy = stored + self._inertia * self._natural * square / math.pi
        rounding = max(self._stiffness * step, self._torque_step)
        # False also where the surface is not known
        return left > tuning.clear * energy + tuning.counts * rounding * way

    def gave(self, half_cycle: HalfCycle) -> bool:
        """Whether over this whole half-cycle the wall gave more than the believed friction."""
        lost = self._damping * half_cycle.square + self._coulomb * half_cycle.path
        start, end = self.potential(half_cycle.start), self.potential(half_cycle.end)
        work = half_cycle.work - self.held * (half_cycle.end - half_cycle.start)
        return work + end - start > lost

    def judge(self, half_cycle: HalfCycle, before: HalfCycle | None) -> None:
        """Judge which torque moved the servo over this half-cycle, and the source of its energy.

        Both are computed for this half-cycle and the one before together where that is known: a
        steady push then does nearly no work, and equals the mean torque, since the velocity starts
        and ends at zero. From a one-sided wall a servo returns only if a push acts, and there a
        single half-cycle is no evidence.

        Sets ``moves``, ``pays``, ``share`` and ``left``.

        Args:
            half_cycle: The one that has just ended.
            before: The one before it; None: not known.
        """
        work, square, path = half_cycle.work, half_cycle.square, half_cycle.path
        duration, speed = half_cycle.duration, math.pi / half_cycle.duration
        moment = half_cycle.virial
        if before is not None:
            duration += before.duration
            square += before.square
            path += before.path
            impulse = half_cycle.impulse + before.impulse
            moment = half_cycle.moment + before.moment
            moment -= impulse * (half_cycle.area + before.area) / duration
            work += before.work - impulse / duration * (half_cycle.end - before.start)
            if not self.side:
                speed = 2.0 * math.pi / duration
        elif self.side:
            self.moves = self.pays = False
            return
        seems, known = -moment / square, not math.isnan(self._inertia)
        inertia = self._inertia if known else abs(seems)
        fine = self._step / half_cycle.amplitude
        self.share = seems / inertia if inertia > 0.0 else 0.0
        tuning = self._tuning
        room = tuning.inertia_counts * fine
        self.moves = tuning.lightest - room < self.share < tuning.heaviest + room
        # As dampings, all of them [N·m·s/rad].
        lost = self._damping + self._coulomb * path / square
        left = work / square - lost
        scale = speed * inertia
        late = scale * speed * self.lag  # K t_d, at the frequency that this is
        room = tuning.wrong * (lost + late) + (tuning.loss + tuning.loss_counts * fine) * scale
        self.left = left / scale if known else 0.0
        # The torque also supplies unknown friction.
        self.pays = left > -room and (left < room or not known)
