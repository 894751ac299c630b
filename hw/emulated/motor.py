"""Converts between duty, current and torque of an emulated servo's motor, as seen at the output.

A DC motor without inductance at the supply voltage U: ``duty * U = R i + k_e w``,
``torque = k_t i``. ``R`` and ``k_e`` come from the published stall current and no-load speed,
``k_t`` from stall torque over stall current. The gear's losses make ``k_t`` smaller than ``k_e``
(except for XL330-M077 and XC430-W150, whose figures are less consistent). The no-load speed is that
of a motor without friction: the mechanism's own friction is a load like any other.

Models of the X330 family measure the supply current, not the motor current; see
``haptic_wall.hw.dynamixel.torque_law``. The Rhoban "bam" identification of an XL330-M288 driven by
duty (k_t 0.370 N·m/A, R 3.50 ohm, Apache-2.0) agrees with its stall figures (0.354 N·m/A, 3.40 ohm)
within 5 %.

Source: ROBOTIS e-Manual, specification and "Goal Current" of each model.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from haptic_wall.hw.dynamixel.tables import Model
from haptic_wall.hw.dynamixel.torque_law import resistance
from haptic_wall.hw.plant.current_loop import Winding


@dataclass(frozen=True, slots=True)
class Motor:
    """A motor with its gear; all values hold at the output."""

    torque_constant: float
    """k_t [N·m/A]"""
    resistance: float
    """R of winding and inverter [ohm]"""
    back_emf: float
    """k_e [V·s/rad]"""
    senses_supply: bool = False
    """Measured and requested currents are those of the supply"""

    def winding(self, volts: float) -> Winding:
        """Return stall torque and no-load speed at this supply voltage [V]."""
        stall = self.torque_constant * volts / self.resistance
        return Winding(stall, volts / self.back_emf)

    def current(self, duty: float, volts: float, speed: float) -> float:
        """Return the current through the motor [A].

        Args:
            duty: -1 to 1.
            volts: Voltage of the supply [V].
            speed: Speed of the output [rad/s].
        """
        return (duty * volts - self.back_emf * speed) / self.resistance

    def duty(self, current: float, volts: float, speed: float) -> float:
        """Return the duty for a motor current [A] at a speed [rad/s]; it may exceed 1."""
        return (self.resistance * current + self.back_emf * speed) / volts

    def sensed(self, current: float, volts: float, speed: float) -> float:
        """Return the current that the servo measures [A] at a motor current ``current`` [A].

        That of the supply has the sign of the motor's, as a direction; the manual's Goal Current
        has one too.
        """
        if not self.senses_supply:
            return current
        return abs(self.duty(current, volts, speed)) * current

    def from_sensed(self, sensed: float, volts: float, speed: float) -> float:
        """Return the motor current [A] at a measured current ``sensed`` [A]; 0 for 0.

        Where the shaft is driven against the wanted direction, at least the current of a shorted
        motor flows: the supply does not see that part.
        """
        if not self.senses_supply or sensed == 0.0:
            return sensed
        along = math.copysign(self.back_emf * speed, speed * sensed)
        root = math.sqrt(along * along + 4.0 * self.resistance * volts * abs(sensed))
        return math.copysign((root - along) / (2.0 * self.resistance), sensed)


def motor_of(model: Model, torque_constant: float) -> Motor:
    """Return the motor of this model.

    Args:
        model: The model with its published figures.
        torque_constant: k_t, in place of the model's [N·m/A].
    """
    return Motor(
        torque_constant,
        resistance(model),
        model.voltage / model.no_load_speed,
        model.senses_supply_current,
    )
