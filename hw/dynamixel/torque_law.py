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

_WHOLE = 1e-9
"""Tolerance, so that rounding does not take a unit from an exact torque"""
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
            return int(math.copysign(min(ratio * ratio + _WHOLE, _HUGE), ratio))
        return round(ratio)

    def within(self, torque: float) -> int:
        """Return the largest goal whose torque does not exceed this one [N·m], >= 0."""
        if self.root:
            return self.goal(torque)
        return math.floor(min(torque / self.step + _WHOLE, _HUGE))

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
    unit = model.current_unit_ma * 1e-3
    return TorqueLaw(constant * motor_current(unit, volts, 0.0, resistance(model), 0.0), True)


def resistance(model: Model) -> float:
    """Return R of winding and inverter: supply over stall current [ohm].

    For models without published figures the stall current is assumed to be their largest Current
    Limit. Where figures are published, that is 12 to 40 % too high.
    """
    return model.voltage / (
        model.stall_current or model.current_limit * model.current_unit_ma * 1e-3
    )


def supply_current(
    current: float, volts: float, speed: float, resistance: float, back_emf: float
) -> float:
    """Return the current sensed at the supply [A] when ``current`` [A] flows through the motor.

    It has the sign of the motor's, as a direction; the manual's Goal Current has one too.

    Args:
        current: Current of the motor [A].
        volts: Voltage of the supply [V].
        speed: Speed of the output [rad/s].
        resistance: R [ohm].
        back_emf: k_e at the output [V·s/rad].
    """
    return abs((resistance * current + back_emf * speed) / volts) * current


def motor_current(
    sensed: float, volts: float, speed: float, resistance: float, back_emf: float
) -> float:
    """Return the motor current [A] at which ``sensed`` [A] is measured at the supply; 0 for 0.

    Where the shaft is driven against the wanted direction, at least the current of a shorted motor
    flows:
    the supply does not see that part.

    Args:
        sensed: Current of the supply [A].
        volts: Voltage of the supply [V].
        speed: Speed of the output [rad/s].
        resistance: R [ohm].
        back_emf: k_e at the output [V·s/rad].
    """
    if sensed == 0.0:
        return sensed
    along = math.copysign(back_emf * speed, speed * sensed)
    root = math.sqrt(along * along + 4.0 * resistance * volts * abs(sensed))
    return math.copysign((root - along) / (2.0 * resistance), sensed)
