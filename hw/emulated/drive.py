"""Simulates the drive of an emulated servo: control and motor that act on its mechanism.

In current mode the motor's torque is Goal Current times the torque constant, held between
instructions; ``haptic_wall.hw.plant.current_loop`` computes what a loop of current control makes of
it. Position control runs once a millisecond, and so does current mode where the supply's current is
sensed or Goal PWM limits it; the motion in between is exact. The computation catches up on every
access, so that the result does not depend on how often that happens.

Position control is proportional, with the XM430's factory gain in every model: 6.25 units of PWM
for a count. A goal acts at once, as with the factory's profile of 0.

Source: ROBOTIS e-Manual, "Position PID Gain".
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from operator import attrgetter
from typing import Final

from haptic_wall.hw.dynamixel.registers import COUNTS_PER_REV, CURRENT_MODE, VELOCITY_UNIT
from haptic_wall.hw.dynamixel.tables import Model
from haptic_wall.hw.emulated.motor import Motor
from haptic_wall.hw.emulated.rules import POSITION_MODE, ControlTable
from haptic_wall.hw.plant.mechanism import Mechanism

STEP_NS: Final = 1_000_000
"""Period of the control [ns]"""
PWM_FULL: Final = 885
"""Units of PWM at which the motor has the full supply voltage"""
_PWM_PER_COUNT: Final = 800 / 128
"""Proportional gain of position control"""
SLOPE_UNIT: Final = 1.977
"""[V/s] per unit of PWM Slope"""
_NEVER_NS: Final = 1 << 62
_next_ns = attrgetter("next_ns")
_PRESENT = struct.Struct("<HBBhhiiiiHB")
"""Realtime Tick to Present Temperature, in the order of their addresses"""
_LOWEST, _HIGHEST = -0x8000_0000, 0x7FFF_FFFF


class Drive:
    """Control and motor of one servo.

    Args:
        table: Its registers.
        motor: Its motor.
        mechanism: The mechanism that the motor moves.
        model: The servo's model.
    """

    def __init__(
        self,
        table: ControlTable,
        motor: Motor,
        mechanism: Mechanism,
        model: Model,
    ) -> None:
        self.table = table
        self._memory = table.memory
        self.stuck_at: int | None = None
        """Counts at which the encoder stands still; None: it follows the shaft"""
        self.shifted = 0
        """Counts by which it is off"""
        self.current_unit = model.current_unit_ma * 1e-3
        """[A] per unit of current"""
        self._stepped_current = motor.senses_supply
        self._on = False
        """Whether a current is held in current mode, be it 0; otherwise the motor is limp there"""
        self._active: int | None = None
        self._goal = 0
        self._duty = 0.0
        self._lost = 0
        self.mechanism = mechanism
        self.motor = motor
        self.next_ns = _NEVER_NS
        """Time of the next computation [ns]"""
        self.together: Sequence[Drive] = (self,)
        """The drives of the bus, which advance together: an arm may couple their shafts"""

    def due(self, now_ns: int) -> bool:
        """Whether something must be computed before a request of ``now_ns`` [ns] may act."""
        return now_ns >= self.next_ns or len(self.together) > 1

    def advance(self, now_ns: int) -> None:
        """Advance to ``now_ns`` [ns], and with it all drives of the bus."""
        together = self.together
        while (first := min(together, key=_next_ns)).next_ns <= now_ns:
            first.compute()
        for each in together:
            each.mechanism.advance(now_ns)

    def compute(self) -> None:
        """Compute the next period of the control, at its time."""
        time_ns = max(self.next_ns, self.mechanism.time_ns)
        self.mechanism.advance(time_ns)
        self.next_ns = time_ns + STEP_NS
        self._step(time_ns)

    def update(self, now_ns: int) -> None:
        """Set the motor to the registers' present request; call ``advance`` first."""
        memory = self._memory
        mode = memory["operating_mode"]
        unlimited = abs(memory["goal_pwm"]) >= PWM_FULL
        if not memory["torque_enable"] or (self.table.tripped and mode == CURRENT_MODE):
            self.release(now_ns)
            if self._on:
                self._on = False
                self._goal = 0
                self.mechanism.release(now_ns)
            return
        if mode == CURRENT_MODE and unlimited and not self._stepped_current:
            if self._active is not None:
                self.release(now_ns)
            current = self.table.current
            if current != self._goal or not self._on:
                self._hold(current, now_ns)
            return
        if self._active != mode:
            self._active = mode
            self._goal = 0  # the control runs in steps from now on
            self._on = False
            if mode == POSITION_MODE:
                self.forget_turns()
            if mode != CURRENT_MODE:  # so that enabling torque moves nothing: an assumption
                memory["goal_position"] = self.position()
            self.next_ns = now_ns
            self.compute()

    def stop(self, now_ns: int) -> None:
        """React to a trip of the Bus Watchdog: limp in current mode, else hold the position."""
        if self._active not in (None, CURRENT_MODE):
            self._memory["goal_position"] = self.position()
        self.update(now_ns)

    def counts(self) -> int:
        """Return the encoder's multi-turn counts, at the present time."""
        if self.stuck_at is not None:
            return self.stuck_at
        return self.mechanism.measured()[1] + self.shifted

    def position(self) -> int:
        """Return Present Position [counts], at the present time."""
        return self.counts() - self._lost + self._memory["homing_offset"]

    def forget_turns(self) -> None:
        """Reduce Present Position to one turn, without the homing offset."""
        self._lost = self.counts() // COUNTS_PER_REV * COUNTS_PER_REV

    def measured(self, tick: int) -> bytes:
        """Return the bytes of the measured registers at the present time, with this Realtime Tick.

        The velocity is the true one, unfiltered. Moving Status and the trajectories are 0.
        """
        table = self.table
        # An unlimited motion may exceed the registers' range.
        position = min(max(self.position(), _LOWEST), _HIGHEST)
        velocity = 0
        if self.stuck_at is None:
            velocity = min(max(round(self.mechanism.velocity / VELOCITY_UNIT), -_HIGHEST), _HIGHEST)
        amperes, duty = self._electrical()
        current = round(amperes / self.current_unit)
        return _PRESENT.pack(
            tick,
            abs(velocity) > table.memory["moving_threshold"],
            0,
            round(duty * PWM_FULL),
            min(max(current, -0x8000), 0x7FFF),
            velocity,
            position,
            0,
            0,
            table.volts,
            min(max(round(table.temperature), 0), 0xFF),
        )

    def _electrical(self) -> tuple[float, float]:
        """Return the measured current [A], and the duty (fraction of the supply on the motor).

        Both in the motor's direction, and 0 while the motor is limp.
        """
        mechanism, motor = self.mechanism, self.motor
        torque = mechanism.torque
        active = self._active is not None
        if torque == 0.0 and not active:
            return 0.0, 0.0
        speed, volts = mechanism.motor_velocity, self.table.supply
        duty = self._duty
        if not active and (self._on or torque != 0.0):
            duty = motor.duty(torque / motor.torque_constant, volts, speed)
        current = torque / motor.torque_constant
        if motor.senses_supply:
            current = motor.sensed(current, volts, speed)
        return current, min(max(duty, -1.0), 1.0)

    def release(self, now_ns: int) -> None:
        """End every control action; the motor is limp."""
        if self._active is not None:
            self._active = None
            self._duty = 0.0
            self.next_ns = _NEVER_NS
            self.mechanism.release(now_ns)

    def _hold(self, current: int, now_ns: int) -> None:
        """Hold this current [units] from now on, in current mode."""
        self._goal = current
        self._on = True
        torque = current * self.current_unit * self.motor.torque_constant
        self.mechanism.command(torque, now_ns)

    def _step(self, now_ns: int) -> None:
        """Compute one period of the control."""
        memory, motor, volts = self._memory, self.motor, self.table.supply
        speed = self.mechanism.motor_velocity
        if self._active == CURRENT_MODE:
            wanted = motor.from_sensed(self.table.current * self.current_unit, volts, speed)
            asked = motor.duty(wanted, volts, speed)
        else:
            asked = (memory["goal_position"] - self.position()) * _PWM_PER_COUNT / PWM_FULL
        duty = self._sloped(_clamp(asked, abs(memory["goal_pwm"]) / PWM_FULL), volts)
        self._duty = duty
        # A current loop leads to what a limited duty makes, too: it is not passed by.
        current = motor.current(duty, volts, speed)
        self.mechanism.command(motor.torque_constant * current, now_ns)

    def _sloped(self, duty: float, volts: float) -> float:
        """Return the duty that PWM Slope allows; models without one follow at once."""
        slope = self._memory.get("pwm_slope")
        if not slope:
            return duty
        change = slope * SLOPE_UNIT / volts * STEP_NS * 1e-9
        return self._duty + _clamp(duty - self._duty, change)


def _clamp(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)
