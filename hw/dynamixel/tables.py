"""Control tables and models of the Dynamixel X series: facts as data.

Registers below 64 live in EEPROM and are locked while torque is enabled; all numbers are little
endian, signed ones in two's complement. Position 0 rad is count 0.

The XM430-W350, XL330-M288 and XL430-W250 carry the defaults and ranges of their own manual pages.
The other models have the addresses of their family, which are the same, and its defaults.

Source: ROBOTIS e-Manual, control table and specification page of each model.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import Final, Literal, NamedTuple

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
"""What Bus Watchdog reads once it has tripped: -1"""
TICK_MODULUS: Final = 32_768
"""Realtime Tick counts milliseconds and wraps from 32767 to 0"""
EEPROM_END: Final = 64
CURRENT_MODE: Final = 0
BAUD_RATES: Final = (9600, 57600, 115200, 1_000_000, 2_000_000, 3_000_000, 4_000_000, 4_500_000)
"""Indexed by the value of the Baud Rate register [bit/s]"""

Family = Literal["X430", "X540", "XW430", "XW540", "X330", "XL430"]


class Register(NamedTuple):
    """One entry of a control table; ``minimum`` below 0 means the number is signed."""

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
        """Kept without power, and locked while torque is enabled."""
        return self.address < EEPROM_END

    @property
    def signed(self) -> bool:
        """In two's complement."""
        return self.minimum < 0

    def decode(self, data: bytes | bytearray) -> int:
        """The number in ``data``, which holds this register and nothing else."""
        return int.from_bytes(data, "little", signed=self.signed)

    def encode(self, value: int) -> bytes:
        """The bytes of ``value``.

        Raises:
            OverflowError: The value does not fit in the register.
        """
        return value.to_bytes(self.size, "little", signed=self.signed)


@dataclass(frozen=True, slots=True)
class Model:
    """What is the same for every servo of one model."""

    name: str
    number: int
    """Model Number register"""
    family: Family
    voltage: float
    """At which the stall figures hold [V]"""
    current_unit_ma: float = 0.0
    """[mA] per unit of current; 0 where there is no current control"""
    current_limit: int = 0
    """Largest (and factory) value of Current Limit [current units]"""
    stall_torque: float | None = None
    """[N·m]"""
    stall_current: float | None = None
    """[A]"""

    @property
    def current_mode(self) -> bool:
        """Whether it can be commanded in current, that is in torque."""
        return self.current_unit_ma > 0

    @property
    def torque_constant(self) -> float | None:
        """Stall torque over stall current [N·m/A]; None where they are not published.

        A default only: published figures for one model differ by a third.
        """
        if self.stall_torque is None or self.stall_current is None:
            return None
        return self.stall_torque / self.stall_current

    @property
    def senses_supply_current(self) -> bool:
        """Measures the supply's current, not the motor's: torque is not in proportion to it."""
        return self.family == "X330"

    @property
    def fast_sync_read_firmware(self) -> int:
        """First firmware that knows fast sync read."""
        return 46 if self.family == "X330" else 45

    @property
    def modes(self) -> frozenset[int]:
        """Operating modes it has: 0 current, 1 velocity, 3 position, 4 extended, 5, 16 PWM."""
        return frozenset({0, 1, 3, 4, 5, 16} if self.current_mode else {1, 3, 4, 16})

    @property
    def registers(self) -> Mapping[str, Register]:
        """The control table, by name, in the order of addresses."""
        return _registers(self)


_ANY_8, _ANY_16 = (0, 0xFF), (-0x8000, 0x7FFF)
_ANY_32 = (-0x8000_0000, 0x7FFF_FFFF)
_GAIN = (0, 16383)
_TURNS = 1_044_479
"""Homing Offset reaches 255 turns either way [counts]"""

# name, address, size, writable, default, (minimum, maximum); the XM430-W350's
_COMMON: Final[tuple[tuple[str, int, int, bool, int, tuple[int, int]], ...]] = (
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
    ("current_limit", 38, 2, True, 1193, (0, 1193)),
    ("velocity_limit", 44, 4, True, 200, (0, 1023)),
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

# What differs from the table above: (default, minimum, maximum), or None where it does not exist.
_Changes = Mapping[str, tuple[int, int, int] | None]
_FAMILY_CHANGES: Final[Mapping[str, _Changes]] = {
    "X430": {},
    "X540": {"drive_mode": (0, 0, 15)},
    "XW430": {"led": None},
    "XW540": {"led": None},
    "X330": {
        "baud_rate": (1, 0, 6),
        "protocol_type": (2, 2, 22),
        "temperature_limit": (70, 0, 100),
        "max_voltage_limit": (70, 31, 70),
        "min_voltage_limit": (35, 31, 70),
        "velocity_limit": (445, 0, 2047),
        "shutdown": (53, 0, 255),
        "velocity_i_gain": (1600, *_GAIN),
        "velocity_p_gain": (180, *_GAIN),
        "position_p_gain": (400, *_GAIN),
    },
    "XL430": {
        "current_limit": None,
        "goal_current": None,
        "present_current": None,
        "temperature_limit": (72, 0, 100),
        "max_voltage_limit": (140, 60, 140),
        "min_voltage_limit": (60, 60, 140),
        "velocity_limit": (265, 0, 1023),
        "velocity_i_gain": (1000, *_GAIN),
        "position_d_gain": (4000, *_GAIN),
        "position_p_gain": (640, *_GAIN),
    },
}
_FAMILY_EXTRAS: Final[Mapping[str, tuple[Register, ...]]] = {
    "X540": (
        *(Register(f"external_port_mode_{n}", 55 + n, 1, True, 3, 0, 3) for n in (1, 2, 3)),
        *(Register(f"external_port_data_{n}", 150 + 2 * n, 2, True, 0, 0, 4095) for n in (1, 2, 3)),
    ),
    "X330": (Register("pwm_slope", 62, 1, True, 140, 1, 255),),
    "XL430": (Register("present_load", 126, 2, False, 0, -1000, 1000),),
}


def _indirect(first: int, count: int, addresses: int, data: int, last: int) -> Iterable[Register]:
    """Registers that stand for others: entry n of ``data`` shows the byte its address names."""
    for n in range(count):
        at = data + n
        yield Register(
            f"indirect_address_{first + n}", addresses + 2 * n, 2, True, at, EEPROM_END, last
        )
        yield Register(f"indirect_data_{first + n}", at, 1, True, 0, *_ANY_8)


@cache
def _registers(model: Model) -> Mapping[str, Register]:
    changes: dict[str, tuple[int, int, int] | None] = dict(_FAMILY_CHANGES[model.family])
    changes["model_number"] = (model.number, 0, 0xFFFF)
    if model.current_mode:
        changes["current_limit"] = (model.current_limit, 0, model.current_limit)
    if model.voltage > 20:
        changes["max_voltage_limit"] = (300, 110, 300)
        changes["min_voltage_limit"] = (110, 110, 300)
    elif model.family == "X330" and model.voltage > 10:  # XC330-T, among relatives of 5 V
        changes["max_voltage_limit"] = (140, 55, 140)
        changes["min_voltage_limit"] = (55, 55, 140)
    table = []
    for name, address, size, writable, default, (minimum, maximum) in _COMMON:
        change = changes.get(name, (default, minimum, maximum))
        if change is not None:
            table.append(Register(name, address, size, writable, *change))
    table += _FAMILY_EXTRAS.get(model.family, ())
    if model.family == "X330":
        # The layout up to firmware 52; later ones move the data to 224.
        table += _indirect(1, 20, 168, 208, 227)
    else:
        table += _indirect(1, 28, 168, 224, 661)
        table += _indirect(29, 28, 578, 634, 661)
    table.sort(key=lambda register: register.address)
    return MappingProxyType({register.name: register for register in table})


_ALL: Final = (
    Model("XL330-M077", 1190, "X330", 5.0, 1.0, 1750, 0.215, 1.47),
    Model("XL330-M288", 1200, "X330", 5.0, 1.0, 1750, 0.52, 1.47),
    Model("XC330-M181", 1230, "X330", 5.0, 1.0, 2352, 0.60, 1.80),
    Model("XC330-M288", 1240, "X330", 5.0, 1.0, 2352, 0.93, 1.80),
    Model("XC330-T181", 1210, "X330", 11.1, 1.0, 910, 0.76, 0.80),
    Model("XC330-T288", 1220, "X330", 11.1, 1.0, 910, 0.92, 0.80),
    Model("XM430-W210", 1030, "X430", 12.0, 2.69, 1193, 3.0, 2.3),
    Model("XM430-W350", 1020, "X430", 12.0, 2.69, 1193, 4.1, 2.3),
    Model("XH430-W210", 1010, "X430", 12.0, 2.69, 648, 2.5, 1.3),
    Model("XH430-W350", 1000, "X430", 12.0, 2.69, 648, 3.4, 1.3),
    Model("XH430-V210", 1050, "X430", 24.0, 1.34, 689, 2.6, 0.7),
    Model("XH430-V350", 1040, "X430", 24.0, 1.34, 689, 3.3, 0.7),
    Model("XM540-W150", 1130, "X540", 12.0, 2.69, 2047, 7.3, 4.4),
    Model("XM540-W270", 1120, "X540", 12.0, 2.69, 2047, 10.6, 4.4),
    Model("XH540-W150", 1110, "X540", 12.0, 2.69, 2047, 7.1, 4.9),
    Model("XH540-W270", 1100, "X540", 12.0, 2.69, 2047, 9.9, 4.9),
    Model("XH540-V270", 1140, "X540", 24.0, 2.69, 2047, 9.2, 2.4),
    Model("XD540-T270", 1101, "X540", 12.0, 2.69, 2047),
    Model("XD540-T150", 1111, "X540", 12.0, 2.69, 2047),
    Model("XW430-T333", 1270, "XW430", 12.0, 2.69, 2047),
    Model("XW540-T260", 1170, "XW540", 12.0, 2.69, 2047, 9.5, 4.9),
    Model("XW540-T140", 1180, "XW540", 12.0, 2.69, 2047, 6.9, 4.9),
    Model("XL430-W250", 1060, "XL430", 11.1, stall_torque=1.4, stall_current=1.3),
)

MODELS: Final[Mapping[str, Model]] = MappingProxyType({model.name: model for model in _ALL})
"""Every model known, by name."""


def model_by_number(number: int) -> Model | None:
    """The model with this Model Number; None when it is not known."""
    for model in _ALL:
        if model.number == number:
            return model
    return None
