"""Defines the effects of a real servo that are fitted beside inertia, friction and delay.

The guard's model has none of them: fitted separately, they cannot be mistaken for its parameters.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

FADING = ("excess", "fading")
WEIGHT = ("sine", "cosine")
COGGING = ("cogging_sine", "cogging_cosine", "periods")
ALWAYS: tuple[tuple[str, ...], ...] = (("gear",), ("uneven",), ("drag",), ("dead_band",), WEIGHT)
"""Effects that are always tried, each with the names of its values"""
EVERY = tuple(name for group in ALWAYS for name in group)
"""The names of all of these values"""
ROUGH = ("gear", "dead_band", *WEIGHT)
"""Effects without which an inertia can be far off"""


@dataclass(frozen=True, slots=True)
class Effects:
    """Sizes of the effects; 0: there is none."""

    excess: float = 0.0
    """Friction that fades with the speed, at its largest [N·m]"""
    fading: float = 0.0
    """Speed at which it has fallen to a third [rad/s]"""
    static: float = 0.0
    """Friction at rest [N·m]; less than in slow motion: as there"""
    gear: float = 0.0
    """Fraction of the gear's load that adds to the friction"""
    uneven: float = 0.0
    """Half the difference of the damping forwards and backwards [N·m·s/rad]"""
    drag: float = 0.0
    """Friction with the square of the speed [N·m·s²/rad²]"""
    dead_band: float = 0.0
    """Torque that is missing of what is commanded [N·m]"""
    sine: float = 0.0
    """Torque of a weight, in proportion to the sine of the position [N·m]"""
    cosine: float = 0.0
    """The same with the cosine [N·m]"""
    cogging_sine: float = 0.0
    """Torque of the cogging, by the sine of its angle [N·m]"""
    cogging_cosine: float = 0.0
    """The same by the cosine [N·m]"""
    periods: float = 0.0
    """Periods of the cogging in a turn"""
    center: float = 0.0
    """Position at which the cogging's angle is zero [rad]"""
    fitted: tuple[str, ...] = ()
    """Names of the values that were fitted"""
    errors: Mapping[str, float] = field(default_factory=dict)
    """Standard error of each of them"""

    @property
    def gravity(self) -> float:
        """Return the amplitude of the torque with the angle's period [N·m]."""
        return math.hypot(self.sine, self.cosine)

    @property
    def hanging(self) -> float:
        """Return the angle at which a weight would hang [rad]."""
        return math.atan2(-self.cosine, self.sine)

    @property
    def cogging(self) -> float:
        """Return the amplitude of the cogging [N·m]."""
        return math.hypot(self.cogging_sine, self.cogging_cosine)

    def error(self, *names: str) -> float:
        """Return the standard errors of some values, added as squares."""
        return math.hypot(*(self.errors.get(name, 0.0) for name in names))


NONE = Effects()
"""No effects"""
