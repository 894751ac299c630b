"""The believed servo values, each with bounds; kept apart from the true (simulated) values."""

from __future__ import annotations

from dataclasses import dataclass

from haptic_wall.hw.settings import EncoderSide


@dataclass(frozen=True, slots=True)
class Bounded:
    """A believed value with its bounds: low <= value <= high."""

    value: float
    low: float
    high: float

    @classmethod
    def exactly(cls, value: float) -> Bounded:
        """Return a value whose bounds coincide with it."""
        return cls(value, value, value)


@dataclass(frozen=True, slots=True)
class Belief:
    """The servo parameters as the controller believes them to be."""

    inertia: Bounded
    """[kg·m²]"""
    damping: Bounded
    """Viscous friction [N·m·s/rad]"""
    coulomb: Bounded
    """Coulomb friction [N·m]; the guard counts it as zero, reports name it"""
    delay: Bounded
    """The device's own lag [s]: from sending a torque until it acts"""
    torque_gain: Bounded
    """Ratio of the acting torque to the commanded torque [1]"""
    backlash: Bounded = Bounded(0.0, 0.0, 0.0)
    """Between shaft and encoder, full width [rad]; the guard counts the most of it, 0: none"""
    load_inertia: Bounded = Bounded(0.0, 0.0, 0.0)
    """Behind a flexible transmission, beside ``inertia``, the motor's [kg·m²]; 0: rigid"""
    flexible_hz: Bounded = Bounded(0.0, 0.0, 0.0)
    """Frequency of its vibration with both ends free [Hz]; 0: rigid"""
    flexible_damping_ratio: Bounded = Bounded(0.0, 0.0, 0.0)
    """Damping ratio of that vibration [1]"""
    encoder: EncoderSide = "output"
    """Side of the transmission that the encoder measures"""

    @property
    def is_flexible(self) -> bool:
        """Whether a load behind a flexible transmission is believed."""
        return self.load_inertia.high > 0.0 and self.flexible_hz.high > 0.0

    @property
    def is_known(self) -> bool:
        """Whether every parameter that the guard uses has coinciding bounds."""
        counted = (self.inertia, self.damping, self.delay, self.torque_gain)
        return all(each.low == each.high for each in counted)
