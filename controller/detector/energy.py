"""What the wall gives out and friction eats, with room for a belief that is wrong by a fifth.

The wall's energy is a property of the motion and the wall, whoever moves: on the way from one point
to another a spring gives back what it took, a damper takes more, and delay gives out. So a wall
that gives out more than friction eats is too stiff, with a hand on it or without.

Whether somebody moves it is told by what is left over: over a swing the torque's work pays for
friction, and its moment for the inertia, unless a hand pays too.

Source: condition on work after Hannaford and Ryu, IEEE T-RA 18(1), 2002, with the torque that acts.
"""

from __future__ import annotations

import math

from haptic_wall.controller.detector.swings import Sums, Swing

_FRICTION_ROOM = 0.3
"""Share by which friction may be larger than believed."""
_DELAY_ROOM = 0.15
"""Share of ``K t_d`` by which damping that balances it may be larger: with a delay that is believed
a fifth too long, a wall at nine tenths of its limit seems to give out nearly a tenth."""
_CLEAR = 0.06
"""What must be left then, of the energy in the motion."""
_COUNTS = 0.6
"""And of what a count's spring torque works on the way: a motion of less than a count per delay
seems to be given so much, because each count's torque acts after the count."""
_FEWEST = 2.5
"""Periods to have passed first: a turning point that no sample has met is known to one."""
_WRONG = 0.3
"""Share of a believed value by which the true one may be larger: a fifth too low, and some more."""
_LIGHTEST, _HEAVIEST, _MASS_COUNTS = 1.0 / 1.3, 1.4, 1.0
"""Inertia that a motion may seem to have, of the believed one: that a fifth too high, and too low,
and what damping that acts late adds to it while it grows fast; the third per amplitude in counts"""
_LOSS_ROOM, _LOSS_COUNTS = 0.02, 0.35
"""Room for what is not a belief: the filter's and the encoder's share, per amplitude in counts."""


class EnergyBalance:
    """Judges what a motion costs, and who pays.

    Attributes:
        surface: Where the wall stands [rad]; NaN: not known.
        side: 0: two-sided; +1 or -1: it fills the positions above or below, and never pulls.
        virtual_damping: Commanded B [N·m·s/rad]; 0 where it is not known.
        lag: Believed delay from a sample to its torque acting [s].
        moves: Whether the torque's moment was what this servo's inertia needed, in the last swing.
        pays: Whether its work was what friction takes: nobody else paid, and nobody took.
        share: Inertia that the torque seems to have moved, of the believed one.
        left: Work that it did beyond friction's, as a damping over ``m ω``; 0 without the inertia.
        growth: Of the oscillation, from what the wall has last given out too much [1/s]; NaN: it
            has not.
    """

    __slots__ = (
        "_coulomb",
        "_damping",
        "_inertia",
        "_limit",
        "_natural",
        "_period",
        "_step",
        "_stiffness",
        "growth",
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
    ) -> None:
        """What is believed of the servo; see ``DetectorSettings``."""
        self._period = period
        self._inertia = inertia
        self._damping = 0.0 if math.isnan(damping) else damping
        self._coulomb = 0.0 if math.isnan(coulomb) else coulomb
        self._step = 0.0 if math.isnan(position_step) else position_step
        self._limit = limit
        self._stiffness = self._natural = math.nan
        self.surface = math.nan
        self.virtual_damping = 0.0
        self.side = 0
        self.lag = 0.0
        self.growth = math.nan
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
        """Angular frequency of the undamped oscillation [rad/s]; NaN: not known."""
        return self._natural

    def potential(self, position: float) -> float:
        """Energy in the wall's spring, its torque limited [J]; NaN: not known."""
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
        """Whether the wall has given out clearly more since a turning point than friction eats.

        Args:
            now: The sums to the present.
            since: Those to a turning point before; with a wall that never pulls, the one before
                the last: it gives back on the way out what it has taken on the way in.
            way: From there to here [rad].
            speed: Present velocity [rad/s].
        """
        step = self._step
        elapsed = now[1] - since[1]
        if elapsed < _FEWEST * self._period:
            return False
        square = now[3] - since[3]
        stored = self.potential(since[0])
        lost = self._damping * square + self._coulomb * way
        given = now[2] - since[2] + self.potential(now[0]) - stored
        late = self._stiffness * self.lag
        left = given - (1.0 + _FRICTION_ROOM) * lost - _DELAY_ROOM * late * square
        # A damper that acts late lends energy in mid-swing, as if the body were lighter; to second
        # order in the delays of hold and difference, too.
        spring, damper = self.lag + 0.5 * self._period, self.lag + self._period
        lent = self.virtual_damping * damper - 0.5 * self._stiffness * spring * spring
        if lent > 0.0:
            left -= 0.5 * lent * speed * speed
        # Over a whole swing either term is the energy of the oscillation.
        energy = stored + self._inertia * self._natural * square / math.pi
        if not left > _CLEAR * energy + _COUNTS * self._stiffness * step * way:
            return False  # also where the surface is not known, and so nothing of all this
        self.growth = 0.5 * (given - lost) / (energy * elapsed)
        return True

    def gave(self, swing: Swing) -> bool:
        """Whether over this whole swing the wall gave out more than friction is believed to eat."""
        lost = self._damping * swing.square + self._coulomb * swing.path
        return swing.work + self.potential(swing.end) - self.potential(swing.start) > lost

    def judge(self, swing: Swing, before: Swing | None) -> None:
        """Judge what moves the servo over this swing, and who pays for it.

        Both are asked of this swing and the one before together where that is known: a steady push
        then pays next to nothing, and it is as large as the torque's mean, since the velocity
        starts and ends at zero. Against a wall that never pulls a servo returns only if something
        pushes it, and there a swing by itself says nothing.

        Sets ``moves``, ``pays``, ``share`` and ``left``.

        Args:
            swing: The one that has just ended.
            before: The one before it; None: not known.
        """
        work, square, path = swing.work, swing.square, swing.path
        duration, speed = swing.duration, math.pi / swing.duration
        moment = swing.virial
        if before is not None:
            duration += before.duration
            square += before.square
            path += before.path
            impulse = swing.impulse + before.impulse
            moment = swing.moment + before.moment
            moment -= impulse * (swing.area + before.area) / duration
            work += before.work - impulse / duration * (swing.end - before.start)
            if not self.side:
                speed = 2.0 * math.pi / duration
        elif self.side:
            self.moves = self.pays = False
            return
        seems, known = -moment / square, not math.isnan(self._inertia)
        inertia = self._inertia if known else abs(seems)
        fine = self._step / swing.amplitude
        self.share = seems / inertia if inertia > 0.0 else 0.0
        self.moves = _LIGHTEST - _MASS_COUNTS * fine < self.share < _HEAVIEST + _MASS_COUNTS * fine
        # As dampings, all of them [N·m·s/rad].
        lost = self._damping + self._coulomb * path / square
        left = work / square - lost
        scale = speed * inertia
        late = scale * speed * self.lag  # K t_d, at the frequency that this is
        room = _WRONG * (lost + late) + (_LOSS_ROOM + _LOSS_COUNTS * fine) * scale
        self.left = left / scale if known else 0.0
        # Friction that is not known is paid for as well.
        self.pays = left > -room and (left < room or not known)
