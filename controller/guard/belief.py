"""The believed servo values, each with bounds; kept apart from the true (simulated) values."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from haptic_wall.hw.truth import EncoderSide

LIGHTEST = 1e-3
"""Least load that is counted, as a fraction of the greatest"""
HEAVIEST = 0.99
"""Heaviest load that is counted, as a fraction of all that the servo turns: 99 times the motor"""
_FAST = 0.5
"""Cycles per period from which a vibration is fast"""
_LIGHT = 0.03
"""Largest load of which a fast vibration is counted by a formula, over the whole inertia"""


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
    """Inertia of everything that the servo turns, or of the motor alone if ``bare`` [kg·m²]"""
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
    """The part of ``inertia``, or beside it, behind a flexible transmission [kg·m²]; 0: rigid"""
    flexible_hz: Bounded = Bounded(0.0, 0.0, 0.0)
    """Frequency of its vibration with both ends free [Hz]; 0: rigid"""
    flexible_damping_ratio: Bounded = Bounded(0.0, 0.0, 0.0)
    """Damping ratio of that vibration [1]"""
    encoder: EncoderSide = "output"
    """Side of the transmission that the encoder measures"""
    transmission_stiffness: Bounded = Bounded(0.0, 0.0, 0.0)
    """Transmission stiffness of gear train and horn, where ``flexible_hz`` was derived from it
    [N·m/rad]; 0: it was not"""
    bare: bool = False
    """``inertia`` is that of the motor alone, and ``load_inertia`` is added: an arm's joint"""

    @property
    def is_flexible(self) -> bool:
        """Whether a load behind a flexible transmission is believed."""
        return self.load_inertia.high > 0.0 and self.flexible_hz.high > 0.0

    def is_fast(self, period: float) -> bool:
        """Whether a light load vibrates too fast to be sampled: a bare horn [period in s]."""
        return self.is_flexible and self.is_light and self.flexible_hz.low * period > _FAST

    @property
    def is_light(self) -> bool:
        """Whether a load is so light that a contact hardly makes it vibrate."""
        return self.load_inertia.high <= _LIGHT * self.inertia.low

    @property
    def lightest_motor(self) -> float:
        """Return the least inertia of the motor's side [kg·m²]."""
        if self.bare:
            return self.inertia.low
        return motor_side(self.inertia.low, self.load_inertia.high)

    @property
    def is_known(self) -> bool:
        """Whether every parameter of a rigid servo that the guard uses has coinciding bounds."""
        counted = (self.inertia, self.damping, self.delay, self.torque_gain)
        return all(each.low == each.high for each in counted)

    @property
    def nominal(self) -> Belief:
        """Return the belief with these parameters at their believed values, without bounds."""
        return replace(
            self,
            inertia=Bounded.exactly(self.inertia.value),
            damping=Bounded.exactly(self.damping.value),
            delay=Bounded.exactly(self.delay.value),
            torque_gain=Bounded.exactly(self.torque_gain.value),
        )


def motor_side(whole: float, load: float) -> float:
    """Return the inertia of the motor's side, of a whole with a load [kg·m²]."""
    return whole - min(load, HEAVIEST * whole)


def lightest_load(inertia: Bounded, load_inertia: Bounded, bare: bool) -> float:
    """Return the least load that is counted [kg·m²]; arguments as for ``vibration``."""
    most = min(load_inertia.high, inertia.low) if bare else load_inertia.high
    return max(load_inertia.low, LIGHTEST * most)


def vibration(
    inertia: Bounded, load_inertia: Bounded, stiffness: Bounded, bare: bool = False
) -> Bounded:
    """Return the frequency of the vibration of a load on a transmission, both ends free [Hz].

    Args:
        inertia: Inertia of everything that the servo turns [kg·m²].
        load_inertia: The part of it that is behind the transmission [kg·m²].
        stiffness: Stiffness of the transmission [N·m/rad].
        bare: ``inertia`` is that of the motor alone, without the load.
    """

    def hz(whole: float, load: float, k: float) -> float:
        if bare:
            whole += load
        else:
            load = min(load, HEAVIEST * whole)
        return math.sqrt(k * whole / (load * (whole - load))) / math.tau

    wholes = (inertia.low, inertia.high)
    lightest = lightest_load(inertia, load_inertia, bare)
    # slowest where motor and load are alike, or, beside a motor alone, with the greatest load
    loads = [
        min(max(load, lightest), load_inertia.high)
        for load in (lightest, load_inertia.high, 0.5 * inertia.low, 0.5 * inertia.high)
    ]
    middle = hz(inertia.value, max(load_inertia.value, lightest), stiffness.value)
    slowest = min(hz(whole, load, stiffness.low) for whole in wholes for load in loads)
    fastest = max(hz(whole, load, stiffness.high) for whole in wholes for load in loads)
    return Bounded(middle, min(slowest, middle), max(fastest, middle))
