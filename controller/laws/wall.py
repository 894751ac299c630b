"""The law of the virtual wall: a spring and a damper, one- or two-sided."""

from __future__ import annotations

import math
from typing import Literal, Protocol

Side = Literal["above", "below", "both"]
SIGNS: dict[Side, int] = {"above": 1, "below": -1, "both": 0}
"""Direction in which the wall continues from its surface; 0: it has no surface"""


class Law(Protocol):
    """Decides the torque of a tick: the guarded wall, or an experiment's program.

    Attributes:
        stiffness: Present stiffness [N·m/rad]
        damping: Present damping [N·m·s/rad]
        injected: Damping added by passivity control [N·m·s/rad]
        position: Zero of the spring [rad]
        clip: Largest commanded torque [N·m]; inf: no limit.
        phase: Of a program; 0 for a wall.
        done: Nothing is left to render; never for a wall.
        scale: Derating of the stiffness after an oscillation [1].
        damping_scale: Derating of the damping [1].
        elastic_limit: Largest torque of the spring alone [N·m].
    """

    guarded: bool
    """The guard sets its stiffness and damping"""
    one_sided: bool
    stiffness: float
    damping: float
    injected: float
    position: float
    clip: float
    phase: int
    done: bool
    scale: float
    damping_scale: float
    elastic_limit: float

    def in_contact(self, position: float) -> bool:
        """Whether it acts at ``position`` [rad]."""
        ...

    def torque(self, position: float, velocity: float) -> float:
        """Return the torque [N·m] at a position [rad] and a velocity [rad/s]; call once a tick."""
        ...


class Wall:
    """A virtual wall at a position; ``stiffness`` and ``damping`` may be changed at any time.

    ``above`` fills the positions above ``position`` and pushes down, ``below`` the positions below
    and pushes up; both never pull. ``both`` acts everywhere, like a spring to the wall.

    Attributes:
        stiffness: [N·m/rad]
        damping: [N·m·s/rad]
        injected: Damping added by passivity control [N·m·s/rad]
        position: Position of the wall's surface [rad].
        clip: Largest torque of spring and damper together [N·m]; inf: no limit.
        one_sided: The wall never pulls, and so has an outside.
        scale: Derating of the stiffness after an oscillation [1].
        damping_scale: Derating of the damping, the injected included [1].
        elastic_limit: Largest torque of the spring alone [N·m]. Where it is lowered along with the
            stiffness, a spring that saturates gets softer too.
    """

    __slots__ = (
        "_sign",
        "clip",
        "damping",
        "damping_scale",
        "done",
        "elastic_limit",
        "guarded",
        "injected",
        "one_sided",
        "phase",
        "position",
        "scale",
        "stiffness",
    )

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
        self.guarded, self.phase, self.done = True, 0, False
        self.scale = self.damping_scale = 1.0
        self.elastic_limit = math.inf

    def in_contact(self, position: float) -> bool:
        """Whether the wall acts at ``position`` [rad]; a two-sided wall always does."""
        return self._sign == 0 or self._sign * (position - self.position) > 0.0

    def torque(self, position: float, velocity: float) -> float:
        """Return the wall's torque [N·m] at a position [rad] and an estimated velocity [rad/s]."""
        torque = -self.stiffness * self.scale * (position - self.position)
        limit = self.elastic_limit
        if torque > limit:
            torque = limit
        elif torque < -limit:
            torque = -limit
        torque -= (self.damping + self.injected) * self.damping_scale * velocity
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
        if sign * (position - self.position) <= 0.0 or sign * torque >= 0.0:
            return 0.0
        return torque
