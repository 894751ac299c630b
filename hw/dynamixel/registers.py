"""Registers of a servo, with their addresses and units, and what differs between the families.

Registers below 64 live in EEPROM and are locked while torque is enabled. Position 0 rad is count 0.
Where the manual gives no number: Model Information reads 0; External Port Data takes 12 bits; goals
take any number here, since other registers limit them.

Indirect addresses are left out.

Source: ROBOTIS e-Manual, control table pages of the X series.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final, Literal, NamedTuple

Family = Literal["X430", "X540", "XW430", "XW540", "X330"]
"""Models with the same registers"""

COUNTS_PER_REV: Final = 4096
POSITION_UNIT: Final = 2 * math.pi / COUNTS_PER_REV
"""[rad] per count"""
VELOCITY_UNIT: Final = 0.229 * 2 * math.pi / 60
"""[rad/s] per unit: 0.229 rev/min"""
RETURN_DELAY_UNIT_NS: Final = 2_000
"""[ns] per unit of Return Delay Time"""
WATCHDOG_UNIT_NS: Final = 20_000_000
"""[ns] per unit of Bus Watchdog"""
WATCHDOG_TRIPPED: Final = 0xFF
"""Value of Bus Watchdog after a trip: -1"""
TICK_MODULUS: Final = 32_768
"""Realtime Tick counts milliseconds and wraps from 32767 to 0"""
EEPROM_END: Final = 64
CURRENT_MODE: Final = 0
BAUD_RATES: Final = (9600, 57600, 115200, 1_000_000, 2_000_000, 3_000_000, 4_000_000, 4_500_000)
"""Indexed by the value of the Baud Rate register [bit/s]"""


class Register(NamedTuple):
    """One entry of a control table; ``minimum`` below 0 means the number is signed.

    Numbers are little endian, signed ones in two's complement.
    """

    name: str
    address: int
    size: int
    """[bytes]"""
    writable: bool
    default: int
    minimum: int
    maximum: int

    @property
    def eeprom(self) -> bool:
        """Whether it is kept without power, and locked while torque is enabled."""
        return self.address < EEPROM_END

    def decode(self, data: bytes | bytearray) -> int:
        """Return the number in ``data``, which contains exactly this register."""
        return int.from_bytes(data, "little", signed=self.minimum < 0)

    def encode(self, value: int) -> bytes:
        """Return the bytes of ``value``.

        Raises:
            OverflowError: The value does not fit in the register.
        """
        return value.to_bytes(self.size, "little", signed=self.minimum < 0)


_ANY_8, _ANY_16 = (0, 0xFF), (-0x8000, 0x7FFF)
_ANY_32 = (-0x8000_0000, 0x7FFF_FFFF)
_GAIN = (0, 16383)
_TURNS = 1_044_479
"""Homing Offset reaches 255 turns either way [counts]"""
WATCHDOG_FIRMWARE: Final = 38
"""First firmware with Bus Watchdog and Drive Mode; the X330 always had them"""

# name, address, size, writable, default, (minimum, maximum)
COMMON: Final[tuple[tuple[str, int, int, bool, int, tuple[int, int]], ...]] = (
    ("model_number", 0, 2, False, 0, (0, 0xFFFF)),
    ("model_information", 2, 4, False, 0, (0, 0xFFFF_FFFF)),
    ("firmware_version", 6, 1, False, 0, _ANY_8),
    ("id", 7, 1, True, 1, (0, 252)),
    ("baud_rate", 8, 1, True, 1, (0, 7)),
    ("return_delay_time", 9, 1, True, 250, (0, 254)),
    ("drive_mode", 10, 1, True, 0, (0, 13)),
    ("operating_mode", 11, 1, True, 3, (0, 16)),
    ("secondary_id", 12, 1, True, 255, _ANY_8),
    ("protocol_type", 13, 1, True, 2, (1, 2)),
    ("homing_offset", 20, 4, True, 0, (-_TURNS, _TURNS)),
    ("moving_threshold", 24, 4, True, 10, (0, 1023)),
    ("temperature_limit", 31, 1, True, 80, (0, 100)),
    ("max_voltage_limit", 32, 2, True, 160, (95, 160)),
    ("min_voltage_limit", 34, 2, True, 95, (95, 160)),
    ("pwm_limit", 36, 2, True, 885, (0, 885)),
    ("current_limit", 38, 2, True, 0, (0, 0)),
    ("velocity_limit", 44, 4, True, 0, (0, 1023)),
    ("max_position_limit", 48, 4, True, 4095, (0, 4095)),
    ("min_position_limit", 52, 4, True, 0, (0, 4095)),
    ("startup_configuration", 60, 1, True, 0, (0, 3)),
    ("shutdown", 63, 1, True, 52, _ANY_8),
    ("torque_enable", 64, 1, True, 0, (0, 1)),
    ("led", 65, 1, True, 0, (0, 1)),
    ("status_return_level", 68, 1, True, 2, (0, 2)),
    ("registered_instruction", 69, 1, False, 0, (0, 1)),
    ("hardware_error_status", 70, 1, False, 0, _ANY_8),
    ("velocity_i_gain", 76, 2, True, 1920, _GAIN),
    ("velocity_p_gain", 78, 2, True, 100, _GAIN),
    ("position_d_gain", 80, 2, True, 0, _GAIN),
    ("position_i_gain", 82, 2, True, 0, _GAIN),
    ("position_p_gain", 84, 2, True, 800, _GAIN),
    ("feedforward_2nd_gain", 88, 2, True, 0, _GAIN),
    ("feedforward_1st_gain", 90, 2, True, 0, _GAIN),
    ("bus_watchdog", 98, 1, True, 0, (0, 127)),
    ("goal_pwm", 100, 2, True, 0, _ANY_16),
    ("goal_current", 102, 2, True, 0, _ANY_16),
    ("goal_velocity", 104, 4, True, 0, _ANY_32),
    ("profile_acceleration", 108, 4, True, 0, (0, 32767)),
    ("profile_velocity", 112, 4, True, 0, (0, 32767)),
    ("goal_position", 116, 4, True, 0, _ANY_32),
    ("realtime_tick", 120, 2, False, 0, (0, 32767)),
    ("moving", 122, 1, False, 0, (0, 1)),
    ("moving_status", 123, 1, False, 0, _ANY_8),
    ("present_pwm", 124, 2, False, 0, _ANY_16),
    ("present_current", 126, 2, False, 0, _ANY_16),
    ("present_velocity", 128, 4, False, 0, _ANY_32),
    ("present_position", 132, 4, False, 0, _ANY_32),
    ("velocity_trajectory", 136, 4, False, 0, _ANY_32),
    ("position_trajectory", 140, 4, False, 0, _ANY_32),
    ("present_input_voltage", 144, 2, False, 0, (0, 0xFFFF)),
    ("present_temperature", 146, 1, False, 0, _ANY_8),
    ("backup_ready", 147, 1, False, 0, (0, 1)),
)

# Per family: missing registers, other (default, minimum, maximum), additional registers.
ABSENT: Final[Mapping[str, tuple[str, ...]]] = {"XW430": ("led",), "XW540": ("led",)}
OTHERWISE: Final[Mapping[str, Mapping[str, tuple[int, int, int]]]] = {
    "X330": {
        "baud_rate": (1, 0, 6),
        # The values between 2 and 20 are unused; 20 to 22 are protocols of remote controls.
        "protocol_type": (2, 2, 22),
        "temperature_limit": (70, 0, 100),
        "velocity_limit": (0, 0, 2047),
    },
}
BESIDES: Final[Mapping[str, tuple[Register, ...]]] = {
    "X540": (
        *(Register(f"external_port_mode_{n}", 55 + n, 1, True, 3, 0, 3) for n in (1, 2, 3)),
        *(Register(f"external_port_data_{n}", 150 + 2 * n, 2, True, 0, 0, 4095) for n in (1, 2, 3)),
    ),
    "X330": (Register("pwm_slope", 62, 1, True, 140, 1, 255),),
}
