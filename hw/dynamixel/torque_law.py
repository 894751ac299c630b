"""Converts torque to Goal Current and back: linear, or a square root for X330 servos.

Most models regulate the current of their motor, and torque is in proportion to it. Those of the
X330 family measure the current of the supply. Through the inverter ``U i_s = (duty U) i``, so
``i_s = duty i``, with ``duty U = R i + k_e w``: at a standstill the torque is proportional to the
square root of the sensed current.

Source: ROBOTIS e-Manual, "Goal Current" of the XL330 and XC330 (that it is the supply's current);
the law is the balance of power of an ideal inverter.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from haptic_wall.hw.dynamixel.tables import Model
from haptic_wall.hw.servo import WHOLE

_HUGE = 1e9
"""More than any limit, and still a whole number where a ratio or its square is infinite"""


@dataclass(frozen=True, slots=True)
class TorqueLaw:
    """Relation of goal currents [current units] and torques [N·m]; odd in both.

    Of a servo that senses its motor's current it is proportional. Of one that senses its supply's,
    at a standstill, it is a root: one unit of current makes ``step``, four make twice that, and
    torques between zero and ``step`` are not possible. There goals are rounded toward zero, so that
    no more acts than was requested.
    """

    step: float
    """Torque of the smallest goal, the largest difference of neighbours [N·m]"""
    root: bool = False
    """The servo senses its supply's current"""

    def goal(self, torque: float) -> int:
        """Return the goal for a torque within a servo's limit [N·m]."""
        ratio = torque / self.step
        if self.root:
            return int(math.copysign(min(ratio * ratio + WHOLE, _HUGE), ratio))
        return round(ratio)

    def within(self, torque: float) -> int:
        """Return the largest goal whose torque does not exceed this one [N·m], >= 0."""
        if self.root:
            return self.goal(torque)
        return math.floor(min(torque / self.step + WHOLE, _HUGE))

    def torque(self, goal: int) -> float:
        """Return the torque of a goal, or of a measured current, at a standstill [N·m]."""
        if self.root:
            return math.copysign(math.sqrt(abs(goal)), goal) * self.step
        return goal * self.step


def torque_law(model: Model, constant: float, volts: float) -> TorqueLaw:
    """Return the law of a model.

    Args:
        model: Its unit of current, the sensed current, and its published stall current.
        constant: k_t, torque per current of the motor [N·m/A].
        volts: Voltage of the supply [V], where the supply's current is sensed.
    """
    if not model.senses_supply_current:
        return TorqueLaw(constant * model.current_unit_ma * 1e-3)
    ohms = resistance(model)
    current = math.sqrt(4.0 * ohms * volts * (model.current_unit_ma * 1e-3)) / (2.0 * ohms)
    return TorqueLaw(constant * current, True)  # R i² = U i_s


def resistance(model: Model) -> float:
    """Return R of winding and inverter: supply over stall current [ohm].

    For models without published figures the stall current is assumed to be their largest Current
    Limit. Where figures are published, that is 12 to 40 % too high.
    """
    return model.voltage / (
        model.stall_current or model.current_limit * model.current_unit_ma * 1e-3
    )
