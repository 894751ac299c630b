"""True parameters of a trial's servo, which the controller under test must not know."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final, Literal

BackEmf = Literal["none", "current", "voltage"]
Encoder = Literal["output", "motor"]
COUNTS_PER_REV: Final = 4096
"""Of the encoder of an X-series servo"""
COUNT: Final = math.tau / COUNTS_PER_REV
"""The angle of a count [rad]"""


@dataclass(frozen=True, slots=True)
class Truth:
    """A servo: rigid, or a motor and a load joined by a flexible transmission."""

    inertia: float
    """Motor and load together [kg·m²], > 0"""
    damping: float = 0.0
    """Viscous friction [N·m·s/rad], >= 0"""
    coulomb: float = 0.0
    """Coulomb friction, equal to static friction [N·m], >= 0"""
    torque_gain: float = 1.0
    """Acting torque per commanded torque [1], > 0"""
    delay: float = 0.0
    """From sending a torque until it acts, or the current loop takes it over [s], >= 0"""
    current_bandwidth: float = 0.0
    """Bandwidth of the current loop [Hz], first order; 0: a torque acts at once. ``real`` has its
    own"""
    torque_limit: float = 4.1
    """Limit of the commanded torque [N·m], > 0"""
    torque_step: float = 0.0
    """Commanded torques are rounded to multiples of it [N·m]; 0: none"""
    counts_per_rev: int = COUNTS_PER_REV
    """Encoder counts per revolution; 0: the position is not quantised"""
    backlash: float = 0.0
    """Full width [rad], >= 0: between shaft and encoder; with a transmission inside that"""
    back_emf: BackEmf = "none"
    """``current``: the drive holds the torque until the supply's voltage runs out, so that it lies
    between ``-stall (1 + v / v0)`` and ``stall (1 - v / v0)``. ``voltage``: the torque always
    loses ``stall / v0`` times the speed, as under a held duty"""
    stall_torque: float = 4.1
    """True torque at full voltage and no speed [N·m], > 0"""
    no_load_speed: float = 4.8
    """v0 [rad/s], > 0"""
    load_inertia: float = 0.0
    """Part of ``inertia`` behind the transmission [kg·m²]; 0: the servo is rigid"""
    transmission_stiffness: float = 0.0
    """[N·m/rad], > 0 where there is a load"""
    transmission_damping: float = 0.0
    """[N·m·s/rad], >= 0; acts while the transmission is in contact"""
    encoder: Encoder = "output"
    """Side of the transmission with the encoder. An operator and the output are on the load"""
    real: dict[str, int | float] | None = None
    """Further values of ``haptic_wall.hw.truth``, a current bandwidth above 0 among them"""

    @property
    def flexible(self) -> bool:
        """Whether there are two masses."""
        return self.load_inertia > 0.0

    @property
    def position_step(self) -> float:
        """Return one count of the encoder [rad]; 0: the position is not quantised."""
        return math.tau / self.counts_per_rev if self.counts_per_rev else 0.0

    @property
    def braking(self) -> float:
        """Return the loss of torque per speed by back-EMF while it acts [N·m·s/rad]."""
        return self.stall_torque / self.no_load_speed

    def with_mode(self, hertz: float, damping_ratio: float, load: float) -> Truth:
        """Return the servo with a flexible transmission.

        Args:
            hertz: Natural frequency with both ends free [Hz].
            damping_ratio: Damping ratio of that mode [1].
            load: Fraction of the inertia that is behind the transmission, 0 < load < 1.
        """
        inertia = load * self.inertia
        moving = (1.0 - load) * inertia
        rate = math.tau * hertz
        return replace(
            self,
            load_inertia=inertia,
            transmission_stiffness=moving * rate * rate,
            transmission_damping=2.0 * damping_ratio * moving * rate,
        )
