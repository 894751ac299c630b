"""Settings of the oscillation watch: its knowledge, and its permitted actions."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from haptic_wall.controller.detector.tuning import TUNING

Answer = Literal["report", "reduce", "trip"]


@dataclass(frozen=True, slots=True)
class WatchSettings:
    """The watch's knowledge, and its permitted actions. Torques are commanded ones."""

    period: float
    """T [s]"""
    position_step: float = 0.0
    """Encoder count [rad]; 0: none"""
    answer: Answer = "report"
    """To an alarm: only report it, reduce the wall, or end the run. ``report`` never probes."""
    side: int = 0
    """0: the wall is two-sided; +1 or -1: it fills the positions above or below it"""
    light: float = 0.0
    """Least believed inertia, in commanded torque [kg·m²]"""
    heavy: float = math.inf
    """Largest believed inertia, in commanded torque [kg·m²]"""
    lag: float = 0.0
    """Believed lag, from sending a torque until it acts [s]"""
    torque_limit: float = math.inf
    """[N·m]"""
    rest_torque: float = 0.0
    """The gains return where the change of the elastic torque is less [N·m]."""
    passive: bool = False
    """Passivity control acts: growth alone is no alarm"""
    elongation: Callable[[float], float] | None = None
    """Elongation of a law that is not linear: that of a linear spring with the same energy, over
    position [rad]. Such a law holds no load while it is softened."""
    regular_long: int = TUNING.regular_long
    """Regular half-cycles in a row that are a sustained motion if no probe is permitted [1]"""

    @property
    def acts(self) -> bool:
        """Whether the watch may change the wall, or end the run."""
        return self.answer != "report"

    def elongated(self, away: float) -> float:
        """Return the elongation of the spring at a distance from the law's position [rad]."""
        if self.side:
            return away if away * self.side > 0.0 else 0.0
        return away if self.elongation is None else self.elongation(away)

    @property
    def threshold(self) -> float:
        """Return the amplitude from which a motion is probed [rad]."""
        step = self.position_step
        return TUNING.large_counts * step if step else TUNING.large_rad

    @property
    def small(self) -> float:
        """Return the amplitude from which a steady motion is probed [rad]."""
        step = self.position_step
        return TUNING.small_counts * step if step else TUNING.small_rad
