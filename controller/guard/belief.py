"""Belief of the controller about the servo, with bounds; apart from the servo's truth."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Bounded:
    """A believed value and the range the truth is believed to lie in: low <= value <= high."""

    value: float
    low: float
    high: float

    @classmethod
    def exactly(cls, value: float) -> Bounded:
        """A value believed without doubt."""
        return cls(value, value, value)


@dataclass(frozen=True, slots=True)
class Belief:
    """The servo as the controller believes it to be."""

    inertia: Bounded
    """[kg·m²]"""
    damping: Bounded
    """Viscous friction [N·m·s/rad]"""
    coulomb: Bounded
    """Coulomb friction [N·m]; the guard counts it as zero, reports name it"""
    delay: Bounded
    """From a torque being sent to its action [s]: the device's own lag"""
    torque_gain: Bounded
    """Torque that acts per torque commanded [1]"""

    @property
    def is_known(self) -> bool:
        """Whether all that the guard counts with is known exactly."""
        counted = (self.inertia, self.damping, self.delay, self.torque_gain)
        return all(each.low == each.high for each in counted)
