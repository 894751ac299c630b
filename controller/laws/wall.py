"""Renders the virtual wall, a one- or two-sided spring and damper; defines the interface `Law`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal, Protocol

Side = Literal["above", "below", "both"]
NONE: Final = "none"
"""The law that reads the position and commands no torque"""
SIGNS: dict[Side, int] = {"above": 1, "below": -1, "both": 0}
"""Direction in which the wall continues from its surface; 0: it has no surface"""


@dataclass(slots=True)
class Derating:
    """What an oscillation leaves of a law; a law that takes the place of another one shares it."""

    scale: float = 1.0
    """Of the stiffness [1]"""
    damping_scale: float = 1.0
    """Of the damping, the injected included [1]"""
    elastic_limit: float = math.inf
    """Largest torque of the spring alone up to ``soft_to`` [N·m]. Where it is lowered along with
    the stiffness, a spring that saturates gets softer too."""
    soft_to: float = 0.0
    """Distance from its zero up to which that limit holds [rad]. Deeper, the spring's torque rises
    with its stiffness again."""
    carried: float = 0.0
    """Torque about which the spring is softened [N·m]: it holds a load. 0: about none"""
    carried_to: float = 0.0
    """Distance from its zero up to which it is added in full [rad]"""


class Law(Protocol):
    """Decides the torque of a tick: the guarded wall, or an experiment's program.

    Attributes:
        name: As in ``wall.law``.
        linear: One spring to ``position``, of one slope wherever the law is in contact.
        stiffness: Present stiffness [N·m/rad]
        damping: Present damping [N·m·s/rad]
        injected: Damping added by passivity control [N·m·s/rad]
        position: Zero of the spring: the wall's surface [rad]
        clip: Largest torque of spring and damper together [N·m]; inf: no limit.
        phase: Phase of a program; 0 for a wall.
        done: Nothing is left to render; never for a wall.
        derating: Left by an oscillation.
        held: Torque added for the load in the last tick [N·m].
    """

    guarded: bool
    """The guard sets its stiffness and damping"""
    one_sided: bool
    """It never pulls, and so has an outside"""
    name: str
    linear: bool
    stiffness: float
    damping: float
    injected: float
    position: float
    clip: float
    phase: int
    done: bool
    derating: Derating
    held: float

    def in_contact(self, position: float) -> bool:
        """Whether it acts at ``position`` [rad]."""
        ...

    def elongation(self, position: float) -> float:
        """Return the elongation of a linear spring with the same energy at ``position`` [rad].

        It is signed where the law is linear, and zero out of contact. No slope exceeds K, so that
        the law's own elastic torque is not above K times it.
        """
        ...

    def stored(self, position: float, limit: float) -> float:
        """Return the energy in its spring at ``position`` [J], in contact.

        Args:
            position: [rad]
            limit: Largest torque of the spring [N·m].
        """
        ...

    def settle(self, position: float) -> None:
        """Start at ``position`` [rad]: the law comes on now."""
        ...

    def torque(self, position: float, velocity: float) -> float:
        """Return the torque [N·m] at a position [rad] and a velocity [rad/s]; call once a tick."""
        ...


def held_torque(
    carried: float, carried_to: float, away: float, stiffness: float, scale: float
) -> float:
    """Return the torque that holds a load while the spring has only a part of its stiffness [N·m].

    With it a spring ``s K`` acts as ``tau0 + s (tau - tau0)``, where ``tau`` is the torque of the
    whole spring and ``tau0`` that at the load's working point: the load stays where it is. The
    torque is constant up to a place on the way to the wall's surface. Beyond it, where only a
    shaft without the load comes, it falls by ``(1 - s) K`` per radian down to zero, so that the
    slope of both together is never above K.

    Args:
        carried: tau0 [N·m].
        carried_to: That place [rad].
        away: Signed distance from the spring's zero [rad].
        stiffness: K [N·m/rad].
        scale: s [1].
    """
    past = away - carried_to
    sign = 1.0 if carried > 0.0 else -1.0
    if sign * past > 0.0:
        carried -= stiffness * past
    return (1.0 - scale) * carried if sign * carried > 0.0 else 0.0


def limited_torque(torque: float, limit: float, rise: float) -> float:
    """Return the torque of a softened spring that is beyond its limit [N·m].

    Args:
        torque: Torque of the spring without a limit; more than ``limit``, either way [N·m].
        limit: ``Law.elastic_limit`` [N·m].
        rise: Rise of the spring's torque beyond ``Law.soft_to`` [N·m]; negative: not as deep.
    """
    # The rise starts from the limit, or from the spring's line below it.
    if rise > 0.0:
        limit = min(limit + rise, abs(torque))
    return limit if torque > 0.0 else -limit


class Wall:
    """A virtual wall at a position; ``stiffness`` and ``damping`` may be changed at any time.

    ``above`` fills the positions above ``position`` and pushes down, ``below`` the positions below
    and pushes up; both never pull. ``both`` acts everywhere, like a spring to the wall.
    Attributes as of ``Law``.
    """

    linear, phase, done = True, 0, False

    def __init__(
        self,
        stiffness: float,
        damping: float,
        position: float,
        side: Side,
        clip: float = math.inf,
    ) -> None:
        self.stiffness = stiffness
        self.damping = damping
        self.injected = 0.0
        self.position = position
        self.clip = clip
        self._sign = SIGNS[side]
        self.one_sided = self._sign != 0
        self.name, self.guarded = "wall", True
        self.derating = Derating()
        self.held = 0.0

    def in_contact(self, position: float) -> bool:
        """Whether the wall acts at ``position`` [rad]; a two-sided wall always does."""
        return self._sign == 0 or self._sign * (position - self.position) > 0.0

    def elongation(self, position: float) -> float:
        """Return the penetration at ``position`` [rad], signed; 0 out of contact."""
        away = position - self.position
        return away if self._sign == 0 or self._sign * away > 0.0 else 0.0

    def stored(self, position: float, limit: float) -> float:
        """Return the energy of the spring at ``position``, its torque limited [J]; in contact."""
        depth = position - self.position
        if depth < 0.0:
            depth = -depth
        stiffness = self.stiffness
        if stiffness * depth > limit:
            return limit * (depth - 0.5 * limit / stiffness)
        return 0.5 * stiffness * depth * depth

    def settle(self, position: float) -> None:
        """Do nothing: a wall has no memory."""

    def torque(self, position: float, velocity: float) -> float:
        """Return the wall's torque [N·m] at a position [rad] and an estimated velocity [rad/s]."""
        away = position - self.position
        derating = self.derating
        stiffness = self.stiffness * derating.scale
        torque = -stiffness * away
        limit = derating.elastic_limit
        if torque > limit or torque < -limit:
            torque = limited_torque(torque, limit, stiffness * (abs(away) - derating.soft_to))
        if derating.carried:
            self.held = held = held_torque(
                derating.carried, derating.carried_to, away, self.stiffness, derating.scale
            )
            torque += held
        elif self.held:
            self.held = 0.0
        torque -= (self.damping + self.injected) * derating.damping_scale * velocity
        clip = self.clip
        if torque > clip:
            torque = clip
        elif torque < -clip:
            torque = -clip
        sign = self._sign
        if sign == 0:
            return torque
        # A one-sided wall is zero outside and never pulls inside. NaN falls through the
        # comparisons, so that the safety checks see it.
        if sign * away <= 0.0 or sign * torque >= 0.0:
            return 0.0
        return torque
