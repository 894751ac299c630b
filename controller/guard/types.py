"""The guard's input and output as plain values: request, settings, situation, decision."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from haptic_wall.controller.guard.belief import Belief
from haptic_wall.controller.laws.wall import Side

if TYPE_CHECKING:
    from haptic_wall.controller.theory.velocity_filter import VelocityFilter

Mode = Literal["stable", "passive", "off"]

WITHIN = 1.05
"""A decision also covers intervals between ticks that are longer by up to this factor: jitter of
22 % of a period adds 5 %, one lost reading in fifty adds 4 %."""
OF_ENCODER = 0.8
"""Fraction that may be commanded of the damping at which one encoder count commands all that it
may: the rest is left for a spring"""


@dataclass(frozen=True, slots=True)
class Request:
    """The requested wall."""

    stiffness: float
    """K >= 0, without an upper end [N·m/rad]"""
    damping: float
    """Virtual damping B, any sign [N·m·s/rad]"""
    side: Side
    velocity_samples: int = 1
    """N of the velocity difference"""
    law: str = ""
    """Another law than a wall, with its steepest part, for people; K is the slope there"""
    linear: bool = True
    """The law has one slope wherever it is in contact"""
    resolved: float = math.inf
    """K up to which the encoder resolves the law [N·m/rad]"""
    velocity_filter: VelocityFilter | None = None
    """Filter of the velocity that damps; only of a two-sided wall, and not in mode
    ``passive``"""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.stiffness) and self.stiffness >= 0):
            raise ValueError(f"stiffness must be finite and >= 0, got {self.stiffness:g}")
        if self.velocity_filter is not None and self.side != "both":
            raise ValueError("the limits of a one-sided wall with a velocity filter are not known")
        if not math.isfinite(self.damping):
            raise ValueError(f"damping must be finite, got {self.damping:g}")


@dataclass(frozen=True, slots=True)
class GuardSettings:
    """Settings of the guard: mode, margin and fractions."""

    mode: Mode = "stable"
    margin: float = 0.8
    """Fraction of the smallest limit that may be commanded, 0 < margin < 1"""
    damping_cap: float = 0.7
    """Fraction of the damping ceiling that may be commanded, 0 < cap < 1"""
    quantisation_share: float = 0.1
    """Fraction of the torque limit that one encoder count may command"""

    def __post_init__(self) -> None:
        for name in ("margin", "damping_cap"):
            value = getattr(self, name)
            if not 0 < value < 1:
                raise ValueError(f"{name} must be between 0 and 1, got {value:g}")
        if not self.quantisation_share > 0:
            raise ValueError(f"quantisation_share must be > 0, got {self.quantisation_share:g}")


@dataclass(frozen=True, slots=True)
class Situation:
    """The servo and the loop that render the wall."""

    belief: Belief
    period: float
    """Sampling period, the longest expected [s]"""
    torque_limit: float
    """[N·m]"""
    position_step: float
    """Encoder step [rad]; 0: the position is not quantised"""
    inserted: tuple[float, float] = (0.0, 0.0)
    """Shortest and longest part of the delay that is neither the sample's age nor the device's own
    lag [s]: an age may be shorter than what is counted"""
    sampled: float = math.inf
    """Shortest interval between two samples, where it is shorter than ``period`` [s]: a velocity is
    their difference over it"""
    served: tuple[float, float] = (1.0, WITHIN)
    """Shortest and longest interval between ticks that a decision must hold for, over ``period``.
    Only a flexible servo needs it: for a rigid one the longest is the least safe"""

    def __post_init__(self) -> None:
        if not self.torque_limit > 0:
            raise ValueError(f"torque_limit must be > 0, got {self.torque_limit:g}")
        if not self.position_step >= 0:
            raise ValueError(f"position_step must be >= 0, got {self.position_step:g}")
        if not self.belief.inertia.low > 0:
            raise ValueError(f"inertia must be > 0, got {self.belief.inertia.low:g}")
        if not self.belief.torque_gain.low > 0:
            raise ValueError(f"torque_gain must be > 0, got {self.belief.torque_gain.low:g}")


@dataclass(frozen=True, slots=True)
class Decision:
    """The stiffness and damping that may be commanded at one delay, with the reasons."""

    request: Request
    delay: float
    """Total t_d that was used, the device's own highest lag included [s]"""
    period: float
    """The sampling period that was used: the served interval [s]"""
    stiffness: float
    """Commanded K [N·m/rad]"""
    damping: float
    """Commanded B [N·m·s/rad]"""
    limits: Mapping[str, float | None]
    """Each of the limits at the commanded damping, by name; None: it does not apply [N·m/rad]"""
    encoder_damping: float
    """Commanded damping, either way, above which one encoder count commands too much torque; inf
    without an encoder [N·m·s/rad]"""
    damping_ceiling: float
    """Commanded damping above which no stiffness fulfils the mode's promise [N·m·s/rad]"""
    margin: float
    binding: str | None
    """Name of the limit that bound K; None: no limit did"""
    reasons: tuple[str, ...]
    """Why less than requested is commanded; empty where nothing was clamped"""
    only_friction: bool
    """The nominal belief would be unstable without Coulomb friction (mode off only)"""
    vibrates: bool = False
    """The ceiling is that of the load's vibration on its transmission"""
    inserted: float = 0.0
    """The part of ``delay`` that was inserted [s]"""

    @property
    def is_coarse(self) -> bool:
        """Whether one encoder count binds the damping."""
        reduced = self.damping != self.request.damping
        return reduced and abs(self.damping) >= OF_ENCODER * self.encoder_damping
