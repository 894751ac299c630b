"""The rules of an emulated servo's control table: permitted writes and their consequences.

It does not handle time and motion. Where the manual is silent, the code states the chosen
behaviour.

Source: ROBOTIS e-Manual, control table pages of the X series.
"""

from __future__ import annotations

from haptic_wall.hw.dynamixel.codec import ErrorCode
from haptic_wall.hw.dynamixel.registers import CURRENT_MODE, WATCHDOG_TRIPPED, Register
from haptic_wall.hw.dynamixel.tables import Model
from haptic_wall.hw.emulated.memory import Memory

_TORQUE_ON_BY_GOAL = 0x08
_VOLTAGE_ERROR, _OVERHEATING_ERROR = 0x01, 0x04
POSITION_MODE, EXTENDED_MODE = 3, 4
_FARTHEST = 1_048_575
"""Largest Goal Position in extended position mode: 256 turns either way [counts]"""
_TORQUE_ON = 0x01
"""Bit of Startup Configuration"""
MEASURED = range(120, 147)
"""Addresses of the measured registers, Realtime Tick to Present Temperature"""
AMBIENT = 32.0
"""Temperature of an idle servo [°C]"""
_GOALS = frozenset({"goal_pwm", "goal_current", "goal_velocity", "goal_position"})
_LIMIT_OF = {
    "goal_pwm": "pwm_limit",
    "goal_current": "current_limit",
    "goal_velocity": "velocity_limit",
}


class ControlTable:
    """A servo's registers with their rules.

    Args:
        model: The servo's model.
        firmware: Decides the available features.
    """

    def __init__(self, model: Model, firmware: int) -> None:
        """Create the registers at their defaults, before power-up."""
        # Torque-on-by-goal-update came with the same firmware as fast sync read.
        self._torque_on_by_goal_known = firmware >= model.fast_sync_read_firmware
        self.memory = Memory(model.registers_at(firmware).values(), MEASURED)
        self.supply = model.voltage
        """Supply voltage [V]; ``feed`` sets it"""
        self.volts = round(self.supply * 10)
        """Present Input Voltage [0.1 V]"""
        self.temperature = AMBIENT
        """Inside [°C]"""

    @property
    def tripped(self) -> bool:
        """Whether the Bus Watchdog has tripped and was not cleared."""
        return self.memory.get("bus_watchdog") == WATCHDOG_TRIPPED

    @property
    def shut_down(self) -> bool:
        """Whether a latched hardware error keeps torque off; only a reboot recovers."""
        return bool(self.memory["hardware_error_status"] & self.memory["shutdown"])

    @property
    def current(self) -> int:
        """Return the current requested in current mode [current units], within Current Limit."""
        memory = self.memory
        if not memory["torque_enable"] or memory.get("bus_watchdog") == WATCHDOG_TRIPPED:
            return 0
        limit = memory["current_limit"]
        return min(max(memory["goal_current"], -limit), limit)

    def write(self, address: int, data: bytes) -> ErrorCode:
        """Store the data, with its consequences for other registers; all of it or nothing."""
        values = self.memory.split(address, data)
        if isinstance(values, ErrorCode):
            return values
        for register, value in values:
            if error := self._refusal(register, value):
                return error
        for register, value in values:
            self._store(register.name, value)
        return ErrorCode.NONE

    def trip(self) -> None:
        """Set the registers as the Bus Watchdog does when it trips.

        Open in the manual: in current mode Goal Current becomes 0, so that the old torque does not
        return when the error is cleared.
        """
        self.memory["bus_watchdog"] = WATCHDOG_TRIPPED
        if self.memory["operating_mode"] == CURRENT_MODE:
            self.memory["goal_current"] = 0

    def feed(self, volts: float) -> None:
        """Set the supply voltage [V]; outside its limits it causes an error."""
        self.supply = volts
        self.volts = round(volts * 10)
        self.check_health()

    def latch(self, bits: int) -> None:
        """Set bits of Hardware Error Status; those in Shutdown switch the torque off."""
        self.memory["hardware_error_status"] |= bits
        if self.shut_down:
            self.memory["torque_enable"] = 0

    def power_up(self) -> None:
        """Set RAM to its defaults, goals to their limits, and torque on if so configured."""
        memory = self.memory
        for register in memory.registers.values():
            if not register.eeprom:
                memory[register.name] = register.default
        self._reset_with_mode()
        self.check_health()
        if memory.get("startup_configuration") & _TORQUE_ON and not self.shut_down:
            memory["torque_enable"] = 1

    def _refusal(self, register: Register, value: int) -> ErrorCode:
        """Return why this value must not be stored now, beyond the register's own range.

        Open in the manual: the reply to enabling torque while shut down is "result fail"; a tripped
        watchdog accepts nothing but 0.
        """
        memory, name = self.memory, register.name
        if register.eeprom and memory["torque_enable"]:
            return ErrorCode.ACCESS
        if (name in _GOALS or (name == "bus_watchdog" and value)) and self.tripped:
            return ErrorCode.DATA_RANGE
        if name == "operating_mode" and value not in (CURRENT_MODE, POSITION_MODE, EXTENDED_MODE):
            return ErrorCode.DATA_RANGE
        if name in _LIMIT_OF and abs(value) > memory[_LIMIT_OF[name]]:
            return ErrorCode.DATA_LIMIT
        if name == "goal_position" and memory["operating_mode"] == POSITION_MODE:
            low, high = memory["min_position_limit"], memory["max_position_limit"]
            return ErrorCode.NONE if low <= value <= high else ErrorCode.DATA_LIMIT
        if name == "goal_position" and memory["operating_mode"] == EXTENDED_MODE:
            return ErrorCode.NONE if abs(value) <= _FARTHEST else ErrorCode.DATA_RANGE
        if name == "torque_enable" and value and self.shut_down:
            return ErrorCode.RESULT_FAIL
        return ErrorCode.NONE

    def _store(self, name: str, value: int) -> None:
        memory = self.memory
        mode_changes = name == "operating_mode" and value != memory[name]
        memory[name] = value
        if mode_changes:
            self._reset_with_mode()
        elif name in ("max_voltage_limit", "min_voltage_limit", "temperature_limit"):
            self.check_health()
        elif (
            name in _GOALS
            and self._torque_on_by_goal_known
            and memory.get("drive_mode") & _TORQUE_ON_BY_GOAL
            and not self.shut_down
            and not memory["torque_enable"]
        ):
            memory["torque_enable"] = 1

    def _reset_with_mode(self) -> None:
        """Set goals to their limits, as power-up and a change of the operating mode do.

        Goal Current becomes Current Limit. Torque that is enabled next in current mode is therefore
        the largest possible, unless 0 is written in between.
        """
        memory = self.memory
        memory["goal_pwm"] = memory["pwm_limit"]
        memory["goal_current"] = memory["current_limit"]

    def check_health(self) -> None:
        """Latch the errors of the present voltage and temperature; shut down if configured."""
        memory = self.memory
        bits = 0
        if not memory["min_voltage_limit"] <= self.volts <= memory["max_voltage_limit"]:
            bits |= _VOLTAGE_ERROR
        if memory["temperature_limit"] < self.temperature:
            bits |= _OVERHEATING_ERROR
        if bits:
            self.latch(bits)
