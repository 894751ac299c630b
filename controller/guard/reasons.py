"""The reasons of the guard as data: request, command, binding limit, remedies.

``sentences`` puts them into words.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Literal

from haptic_wall.controller.guard.belief import Belief
from haptic_wall.controller.guard.delay_parts import DelayParts

WORTH_NAMING = 1.02
"""Smallest factor that counts as an improvement: the limits are accurate to about 1 %."""


class LimitName(StrEnum):
    """The limits of the stiffness; the values are those of reports."""

    LINEAR = "linear"
    """(b + B) / (T/2 + t_d)"""
    EXACT = "exact"
    """The two-sided loop is stable below it"""
    ONE_SIDED = "one_sided"
    """Below it a wall that never pulls returns no device faster than it came"""
    QUANTISATION = "quantisation"
    """One encoder count commands a small share of the torque limit"""
    PASSIVE = "passive"
    """Stable with any passive hand below it"""
    BACKLASH = "backlash"
    """Backlash sustains no oscillation of more than four counts below it"""
    FLEXIBLE = "flexible"
    """A load behind a flexible transmission does not vibrate below it"""
    RESOLUTION = "resolution"
    """The encoder resolves the law below it"""


Change = Literal[
    "virtual_damping",
    "largest_part",
    "delay",
    "rate",
    "damping",
    "baud",
    "latency_timer",
    "encoder",
    "two_sided",
    "motor_encoder",
    "stiffer",
    "belief",
]
"""Names of the changes: ``virtual_damping`` another B; ``largest_part`` of the delay ``shorter``,
the hold included; ``delay`` t_d halved; ``rate`` twice; ``damping``, the viscous, twice; ``baud``
``FAST_BAUD``; ``latency_timer`` ``SHORT_TIMER``; ``encoder`` ``FINER`` times finer; ``two_sided`` a
wall that also pulls; ``motor_encoder`` on the motor's side of a flexible transmission; ``stiffer``,
that transmission's vibration at twice its frequency; ``belief`` the servo known exactly, at its
believed values."""


@dataclass(frozen=True, slots=True)
class Improvement:
    """The limit after one change."""

    change: Change
    stiffness: float
    """The smallest limit after the change [N·m/rad]"""
    binding: LimitName
    """The name of that limit"""
    damping: float
    """Virtual damping after the change [N·m·s/rad]"""

    def factor(self, now: float) -> float | None:
        """Return the new limit as a multiple of ``now`` [N·m/rad]; None where ``now`` is 0."""
        return self.stiffness / now if now > 0 else None

    def buys(self, now: float) -> bool:
        """Whether the new limit exceeds ``now`` [N·m/rad] by more than 2 %."""
        return self.stiffness > WORTH_NAMING * now


@dataclass(frozen=True, slots=True)
class StiffnessBound:
    """A limit binds the stiffness."""

    asked: float
    """[N·m/rad]"""
    allowed: float
    """[N·m/rad]"""
    limit: LimitName
    value: float
    """Value of the limit [N·m/rad]"""
    margin: float
    """Share of the limit that is allowed [1]"""
    commanded: bool
    """The allowed stiffness is commanded; else something besides the guard commands less"""
    law: str = ""
    """Another law than a wall, with its steepest part"""


@dataclass(frozen=True, slots=True)
class CoarseCount:
    """One encoder count in one sample commands much torque through the damping."""

    torque: float
    """Through the damping alone [N·m]"""
    allowed: float
    """The share of the torque limit that a count may command [N·m]"""
    highest_damping: float | None
    """Virtual damping below which any is left to the stiffness [N·m·s/rad]; None: there is none"""
    samples: int
    """Samples of the velocity difference"""


@dataclass(frozen=True, slots=True)
class CoarseDamping:
    """One encoder count in one sample binds the damping."""

    asked: float
    """[N·m·s/rad]"""
    allowed: float
    """[N·m·s/rad]"""
    torque: float
    """Of a count through the damping asked for [N·m]"""
    most: float
    """The share of the torque limit that a count may command [N·m]"""
    samples: int
    """Samples of the velocity difference"""
    commanded: bool
    """As of ``StiffnessBound``"""


@dataclass(frozen=True, slots=True)
class NothingAllowed:
    """No stiffness is allowed at the commanded damping."""

    damping: float
    """Commanded [N·m·s/rad]"""
    delay: float
    """[s]"""
    highest_damping: float
    """Up to which the damping may be raised [N·m·s/rad]"""


@dataclass(frozen=True, slots=True)
class DampingTooLow:
    """The damping asked for takes away all that the servo has."""

    asked: float
    """[N·m·s/rad]"""
    allowed: float
    """[N·m·s/rad]"""
    lowest: float
    """Damping at which none is left [N·m·s/rad]"""
    commanded: bool
    """As of ``StiffnessBound``"""


@dataclass(frozen=True, slots=True)
class DampingBound:
    """The ceiling binds the damping."""

    asked: float
    """[N·m·s/rad]"""
    allowed: float
    """[N·m·s/rad]"""
    ceiling: float
    """[N·m·s/rad]"""
    share: float
    """Share of the ceiling that is allowed [1]"""
    delay: float
    """At which the ceiling was found [s]"""
    passive: bool
    """Above the ceiling the wall is not passive; else no stiffness is stable"""
    vibrates: bool
    """The ceiling is that of a load's vibration on its transmission"""
    commanded: bool
    """As of ``StiffnessBound``"""


@dataclass(frozen=True, slots=True)
class WouldRaise:
    """A change that would allow more stiffness."""

    improvement: Improvement
    stiffness: float
    """That could be commanded then [N·m/rad]"""
    damping: float
    """Commanded now [N·m·s/rad]"""
    parts: DelayParts
    """Parts of the delay now"""
    slow_replies: bool
    """A reply takes several periods"""
    belief: Belief


@dataclass(frozen=True, slots=True)
class GuardOff:
    """The guard is off: all is commanded as asked."""

    stiffness: float
    """[N·m/rad]"""
    damping: float
    """[N·m·s/rad]"""
    limit: LimitName
    value: float
    """Value of the limit, the smallest one [N·m/rad]"""


@dataclass(frozen=True, slots=True)
class Unstable:
    """The guard is off, and the wall is unstable for the believed servo."""

    only_friction: bool
    """Coulomb friction may hold small motion"""


@dataclass(frozen=True, slots=True)
class ServedSlower:
    """Samples come at a longer interval than the grid's, which counts as the period."""

    interval: float
    """[s]"""
    period: float
    """Period of the grid [s]"""
    missed: int
    """Periods"""
    failed: int
    """Readings that were lost or broken"""
    cycles: int
    """Readings asked for"""
    emulated: bool = False
    """The bus is emulated: it has no cable"""


@dataclass(frozen=True, slots=True)
class Derated:
    """An oscillation has reduced what the guard allows."""

    frequency_hz: float
    first_alarm_s: float
    """When it was noticed [s]"""
    stiffness_share: float
    """Left of the stiffness [1]"""
    damping_share: float
    """Left of the damping [1]"""


@dataclass(frozen=True, slots=True)
class WaitsForRest:
    """More stiffness is allowed, but the shaft was not where it may be raised."""

    allowed: float
    """[N·m/rad]"""


@dataclass(frozen=True, slots=True)
class FromTank:
    """A law that depends on time gives energy from a tank."""

    law: str
    absorbed: float
    """[J]"""
    given: float
    """[J]"""
    limited: int
    """Ticks in which the tank limited its torque"""


Reason = (
    StiffnessBound
    | CoarseCount
    | CoarseDamping
    | NothingAllowed
    | DampingTooLow
    | DampingBound
    | WouldRaise
    | GuardOff
    | Unstable
    | ServedSlower
    | Derated
    | WaitsForRest
    | FromTank
)
