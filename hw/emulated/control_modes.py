"""Simulates the servo's own controllers: a duty from goals, gains and profiles each millisecond.

The manual gives the structure (a profile leads, a PID or PI follows, Goal PWM limits) and the
scales of the gains. Assumptions, where it is silent:

- The controllers run every millisecond, errors are in counts and units of velocity, outputs in
  units of PWM; "the constants include the sampling time". With the factory gains and the published
  motor an XM430 then settles with a damping ratio of about 0.9.
- The derivative acts on the velocity, not on differences of counts.
- Feedforward multiplies counts per millisecond and counts per millisecond squared.
- Anti-windup: the integral is held while the output is at its limit.
- Current-based position: the same controller, its output limited to what Goal Current allows (the
  scale from its output to a current is not given).

Source: ROBOTIS e-Manual, "Position PID Gain", "Velocity PI Gain", "Moving Status".
"""

from __future__ import annotations

from typing import NamedTuple

from haptic_wall.hw.dynamixel.tables import COUNTS_PER_REV
from haptic_wall.hw.emulated.profile import Plan, Point, by_time, by_velocity, ramp_to
from haptic_wall.hw.emulated.rules import ControlTable

PWM_FULL = 885
"""Units of PWM at which the motor has the full supply voltage"""
VELOCITY_MODE, POSITION_MODE, EXTENDED_MODE, CURRENT_POSITION_MODE, PWM_MODE = 1, 3, 4, 5, 16
POSITION_MODES = frozenset({POSITION_MODE, EXTENDED_MODE, CURRENT_POSITION_MODE})
SAMPLE_S = 0.001

COUNTS_PER_VELOCITY = 0.229 * COUNTS_PER_REV / 60.0
"""[counts/s] per unit of velocity"""
COUNTS_PER_ACCELERATION = 214.577 * COUNTS_PER_REV / 3600.0
"""[counts/s²] per unit of acceleration"""

IN_POSITION = 20
"""Distance at which the servo counts as arrived [counts]: the manual only says "predefined"."""
FOLLOWING = 200
"""Lag behind the profile at which the servo no longer counts as following [counts]; not published
"""
_ARRIVED, _ONGOING, _BEHIND = 0x01, 0x02, 0x08
_TIME_BASED = 0x04


class Motion(NamedTuple):
    """The state of motion that a servo's registers report."""

    status: int
    """Moving Status"""
    ongoing: bool
    """A profile to a position is in progress"""
    velocity: int
    """Velocity Trajectory [units of velocity]"""
    position: int
    """Position Trajectory [counts]"""


class Controllers:
    """The controllers of one servo, in the units and directions of its registers."""

    def __init__(self, table: ControlTable) -> None:
        self._table = table
        self._memory = table.memory
        self.mode = POSITION_MODE
        self._goal = 0
        self._integral = 0.0
        self._plan = ramp_to(0.0, 0.0, 0.0)
        self._since_ns = 0

    def engage(self, mode: int, position: int, *, hold: bool, now_ns: int) -> None:
        """Start with the shaft at ``position`` [counts] and zero integral.

        Args:
            mode: Operating Mode.
            position: Present Position.
            hold: In a position mode, Goal Position becomes Present Position, so that enabling
                torque moves nothing. The manual does not say so; otherwise the first motion would
                be to an earlier goal.
            now_ns: The time [ns].
        """
        self.mode = mode
        self._integral = 0.0
        if mode in POSITION_MODES:
            if hold:
                self._memory["goal_position"] = position
            self._goal = position
            self._plan = Plan(position, position, 0, ())
        else:
            self._goal = 0
            self._plan = ramp_to(0.0, 0.0, 0.0)
        self._since_ns = now_ns
        self.follow(now_ns)

    def follow(self, now_ns: int) -> None:
        """Make a new plan if the goal has changed."""
        memory = self._memory
        if self.mode in POSITION_MODES:
            goal = memory["goal_position"]
            if goal != self._goal:
                point = self.point(now_ns)
                self._start(goal, self._to_position(point, goal), now_ns)
        elif self.mode == VELOCITY_MODE:
            goal = memory["goal_velocity"]
            if goal != self._goal:
                present = self.point(now_ns).velocity
                wanted = goal * COUNTS_PER_VELOCITY
                self._start(goal, ramp_to(present, wanted, self._ramp_s(wanted - present)), now_ns)

    def stop(self, position: int, now_ns: int) -> None:
        """Hold the present position without a profile, as after a trip of the Bus Watchdog.

        The manual says "stop". The change of the goals is an assumption; it avoids a motion when
        the watchdog is cleared.
        """
        memory = self._memory
        if self.mode in POSITION_MODES:
            memory["goal_position"] = self._goal = position
            self._plan = Plan(position, position, 0, ())
        elif self.mode == VELOCITY_MODE:
            memory["goal_velocity"] = self._goal = 0
            self._plan = ramp_to(0.0, 0.0, 0.0)
        elif self.mode == PWM_MODE:
            memory["goal_pwm"] = 0
        self._since_ns = now_ns

    def renumber(self, counts: int, now_ns: int) -> None:
        """Shift the goals by ``counts``, because the zero of Present Position has shifted.

        The manual is silent about Goal Position when turns are cleared. An unchanged goal would
        turn the servo by as many turns as were cleared.
        """
        self._memory["goal_position"] = self._goal = self._goal + counts
        self._plan = Plan(self._goal, self._goal, 0, ())
        self._since_ns = now_ns

    def point(self, now_ns: int) -> Point:
        """Return the profile's point at ``now_ns`` [counts, counts/s, counts/s²]."""
        return self._plan.at((now_ns - self._since_ns) * 1e-9)

    def motion(self, position: int, now_ns: int) -> Motion:
        """Return the state of motion for the registers, with the shaft at ``position`` [counts]."""
        point = self.point(now_ns)
        velocity = round(point.velocity / COUNTS_PER_VELOCITY)
        status = self._plan.kind << 4
        if self.mode not in POSITION_MODES:
            return Motion(status, False, velocity, position)
        ongoing = (now_ns - self._since_ns) * 1e-9 < self._plan.duration
        if ongoing:
            status |= _ONGOING
        if abs(self._goal - position) <= IN_POSITION:
            status |= _ARRIVED
        if abs(point.position - position) > FOLLOWING:
            status |= _BEHIND
        return Motion(status, ongoing, velocity, round(point.position))

    def output(self, position: int, velocity: float, now_ns: int) -> float:
        """Return the wanted PWM [units], limited by Goal PWM.

        Args:
            position: Present Position [counts].
            velocity: In the direction of Present Position, or in velocity mode of Present Velocity
                [counts/s].
            now_ns: The time [ns].
        """
        memory = self._memory
        if self.mode == PWM_MODE:
            return float(memory["goal_pwm"])
        point = self.point(now_ns)
        if self.mode == VELOCITY_MODE:
            error = (point.velocity - velocity) / COUNTS_PER_VELOCITY
            gain = memory["velocity_i_gain"] / 65_536.0
            wanted = error * (memory["velocity_p_gain"] / 128.0)
        else:
            error = point.position - position
            gain = memory["position_i_gain"] / 65_536.0
            wanted = (
                error * (memory["position_p_gain"] / 128.0)
                + (point.velocity - velocity) * SAMPLE_S * (memory["position_d_gain"] / 16.0)
                + point.velocity * SAMPLE_S * (memory["feedforward_1st_gain"] / 4.0)
                + point.acceleration * SAMPLE_S * SAMPLE_S * (memory["feedforward_2nd_gain"] / 4.0)
            )
        limit = float(abs(memory["goal_pwm"]))
        total = wanted + self._integral + gain * error
        if abs(total) <= limit or total * error < 0.0:
            self._integral += gain * error
        return min(max(total, -limit), limit)

    def _start(self, goal: int, plan: Plan, now_ns: int) -> None:
        self._goal, self._plan, self._since_ns = goal, plan, now_ns

    def _to_position(self, point: Point, goal: int) -> Plan:
        speed, acceleration = self._memory["profile_velocity"], self._memory["profile_acceleration"]
        position, velocity = point.position, point.velocity
        if self._time_based:
            return by_time(position, velocity, goal, speed * 1e-3, acceleration * 1e-3)
        return by_velocity(
            position,
            velocity,
            goal,
            speed * COUNTS_PER_VELOCITY,
            acceleration * COUNTS_PER_ACCELERATION,
        )

    def _ramp_s(self, change: float) -> float:
        """Return the duration of a change of velocity [counts/s] [s]."""
        acceleration = self._memory["profile_acceleration"]
        if self._time_based:
            return acceleration * 1e-3
        return abs(change) / (acceleration * COUNTS_PER_ACCELERATION) if acceleration else 0.0

    @property
    def _time_based(self) -> bool:
        return bool(self._memory.get("drive_mode") & _TIME_BASED)
