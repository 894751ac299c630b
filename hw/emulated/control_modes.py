"""Simulates the servo's own controllers: a duty from goals and gains each millisecond.

The manual gives the structure (a PID or PI follows the goal, Goal PWM limits) and the scales of the
gains. Profiles are not simulated: a goal acts at once, as with the factory's Profile Velocity and
Profile Acceleration of 0, and the feedforward gains, which act on a profile, do nothing.
Assumptions, where the manual is silent:

- The controllers run every millisecond, errors are in counts and units of velocity, outputs in
  units of PWM; "the constants include the sampling time". With the factory gains and the published
  motor an XM430 then settles with a damping ratio of about 0.9.
- The derivative acts on the velocity, not on differences of counts.
- Anti-windup: the integral is held while the output is at its limit.
- Current-based position: the same controller, its output limited to what Goal Current allows (the
  scale from its output to a current is not given).

Source: ROBOTIS e-Manual, "Position PID Gain", "Velocity PI Gain", "Moving Status".
"""

from __future__ import annotations

from typing import NamedTuple

from haptic_wall.hw.dynamixel.registers import COUNTS_PER_REV
from haptic_wall.hw.emulated.rules import ControlTable

PWM_FULL = 885
"""Units of PWM at which the motor has the full supply voltage"""
VELOCITY_MODE, POSITION_MODE, EXTENDED_MODE, CURRENT_POSITION_MODE, PWM_MODE = 1, 3, 4, 5, 16
POSITION_MODES = frozenset({POSITION_MODE, EXTENDED_MODE, CURRENT_POSITION_MODE})
_SAMPLE_S = 0.001
_COUNTS_PER_VELOCITY = 0.229 * COUNTS_PER_REV / 60.0
"""[counts/s] per unit of velocity"""
_IN_POSITION = 20
"""Distance at which the servo counts as arrived [counts]: the manual only says "predefined"."""
_FOLLOWING = 200
"""Distance from the goal at which the servo no longer counts as following [counts]; not published
"""
_ARRIVED, _BEHIND = 0x01, 0x08


class Motion(NamedTuple):
    """The state of motion that a servo's registers report."""

    status: int
    """Moving Status"""
    velocity: int
    """Velocity Trajectory [units of velocity]"""
    position: int
    """Position Trajectory [counts]"""


class Controllers:
    """The controllers of one servo, in the units and directions of its registers."""

    def __init__(self, table: ControlTable) -> None:
        self._memory = table.memory
        self.mode = POSITION_MODE
        self._integral = 0.0

    def engage(self, mode: int, position: int, *, hold: bool) -> None:
        """Start with zero integral.

        Args:
            mode: Operating Mode.
            position: Present Position [counts].
            hold: In a position mode, Goal Position becomes Present Position, so that enabling
                torque moves nothing. The manual does not say so; otherwise the first motion would
                be to an earlier goal.
        """
        self.mode = mode
        self._integral = 0.0
        if hold and mode in POSITION_MODES:
            self._memory["goal_position"] = position

    def stop(self, position: int) -> None:
        """Hold the present position [counts], as after a trip of the Bus Watchdog.

        The manual says "stop". The change of the goals is an assumption; it avoids a motion when
        the watchdog is cleared.
        """
        if self.mode in POSITION_MODES:
            self._memory["goal_position"] = position
        elif self.mode == VELOCITY_MODE:
            self._memory["goal_velocity"] = 0
        elif self.mode == PWM_MODE:
            self._memory["goal_pwm"] = 0

    def motion(self, position: int) -> Motion:
        """Return the state of motion for the registers, with the shaft at ``position`` [counts]."""
        if self.mode == VELOCITY_MODE:
            return Motion(0, self._memory["goal_velocity"], position)
        goal = self._memory["goal_position"]
        away = abs(goal - position)
        return Motion(_ARRIVED * (away <= _IN_POSITION) | _BEHIND * (away > _FOLLOWING), 0, goal)

    def output(self, position: int, velocity: float) -> float:
        """Return the wanted PWM [units], limited by Goal PWM.

        Args:
            position: Present Position [counts].
            velocity: In the direction of Present Position, or in velocity mode of Present Velocity
                [counts/s].
        """
        memory = self._memory
        if self.mode == PWM_MODE:
            return float(memory["goal_pwm"])
        if self.mode == VELOCITY_MODE:
            error = memory["goal_velocity"] - velocity / _COUNTS_PER_VELOCITY
            gain = memory["velocity_i_gain"] / 65_536.0
            wanted = error * (memory["velocity_p_gain"] / 128.0)
        else:
            error = float(memory["goal_position"] - position)
            gain = memory["position_i_gain"] / 65_536.0
            damped = velocity * _SAMPLE_S * (memory["position_d_gain"] / 16.0)
            wanted = error * (memory["position_p_gain"] / 128.0) - damped
        limit = float(abs(memory["goal_pwm"]))
        total = wanted + self._integral + gain * error
        if abs(total) <= limit or total * error < 0.0:
            self._integral += gain * error
        return min(max(total, -limit), limit)
