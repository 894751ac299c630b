"""The models of the X series with current control: numbers, units, limits, factory settings.

Source: ROBOTIS e-Manual, specification and control table page of each model. Where editions of a
page differ (velocity limits, the XH540-V's current limit), the latest one is used. Unknown values
are left out: stall and no-load figures of XD430, XD540, XW430 and XW540-H260 (their torque constant
must be configured). The gains are the family's in every model. The XW430's page prints a Protocol
Type of 1 from the factory, with which it could not be talked to as the page describes; 2 is taken.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import Final

from haptic_wall.hw.dynamixel.registers import (
    ABSENT,
    BESIDES,
    COMMON,
    OTHERWISE,
    VELOCITY_UNIT,
    WATCHDOG_FIRMWARE,
    Family,
    Register,
)

_FACTORY: Final[Mapping[str, Mapping[str, int]]] = {
    "XL330-M077": {"shutdown": 53},
    "XL330-M288": {"shutdown": 53},
    "XC330-T181": {"pwm_slope": 255},
    "XC330-T288": {"pwm_slope": 255},
}
"""Settings from the factory that are not the family's, by the model's name"""
NO_CURRENT_MODE: Final[dict[int, str]] = {
    1060: "XL430-W250",
    1070: "XC430-W150",
    1080: "XC430-W240",
    1090: "2XL430-W250",
    1160: "2XC430-W250",
}
"""Models that cannot be commanded in torque, by their numbers: nothing else is known of them"""


@dataclass(frozen=True, slots=True)
class Model:
    """Properties common to every servo of one model."""

    name: str
    number: int
    """Model Number register"""
    family: Family
    voltage: float
    """At which the stall figures hold [V]"""
    velocity_limit: int
    """Velocity Limit from the factory"""
    current_unit_ma: float
    """[mA] per unit of current"""
    current_limit: int
    """Largest value of Current Limit, also the factory's [current units]"""
    stall_torque: float | None = None
    """[N·m]"""
    stall_current: float | None = None
    """[A]"""
    no_load_rpm: float | None = None
    """No-load speed [rev/min]"""

    @property
    def torque_constant(self) -> float | None:
        """Return stall torque over stall current [N·m/A]; None where they are not published.

        A default only: published figures for one model differ by a third.
        """
        if self.stall_torque is None or self.stall_current is None:
            return None
        return self.stall_torque / self.stall_current

    @property
    def no_load_speed(self) -> float:
        """Return the speed without a load at ``voltage`` [rad/s].

        Where it is not published, the factory's Velocity Limit: an assumption. Where both are known
        they agree within 14 %.
        """
        if self.no_load_rpm is None:
            return self.velocity_limit * VELOCITY_UNIT
        return self.no_load_rpm * math.tau / 60.0

    def no_load_at(self, volts: float) -> float:
        """Return the speed without a load at this supply [rad/s], in proportion to it."""
        return self.no_load_speed * volts / self.voltage

    @property
    def senses_supply_current(self) -> bool:
        """Whether it measures the supply's current: its torque is not proportional to it."""
        return self.family == "X330"

    @property
    def fast_sync_read_firmware(self) -> int:
        """Return the first firmware with fast reads, torque-on-by-goal-update and backup."""
        return 46 if self.family == "X330" else 45

    def knows_fast_reads(self, firmware: int) -> bool:
        """Whether it replies to fast sync and fast bulk reads."""
        return firmware >= self.fast_sync_read_firmware

    @property
    def supply(self) -> tuple[float, float]:
        """Return the lowest and highest supply, as limited from the factory [V]."""
        low, high = (self.registers[f"{end}_voltage_limit"].default for end in ("min", "max"))
        return low / 10, high / 10

    @property
    def registers(self) -> Mapping[str, Register]:
        """Return the control table at ``fast_sync_read_firmware``, by name, in address order."""
        return self.registers_at(self.fast_sync_read_firmware)

    def registers_at(self, firmware: int) -> Mapping[str, Register]:
        """Return the control table at this firmware, by name, in the order of addresses.

        Args:
            firmware: Firmware Version register.
        """
        return _control_table(self, firmware)


@cache
def _control_table(model: Model, firmware: int) -> Mapping[str, Register]:
    family, limit = model.family, model.current_limit
    highest, lowest, low, high = _voltage_limits(family, model.voltage)
    otherwise = {
        **OTHERWISE.get(family, {}),
        "current_limit": (limit, 0, limit),
        "drive_mode": (0, 0, 15 if family == "X540" else 13),
        "max_voltage_limit": (highest, low, high),
        "min_voltage_limit": (lowest, low, high),
    }
    absent = {*ABSENT.get(family, ())}
    if not model.knows_fast_reads(firmware):
        absent |= {"startup_configuration", "backup_ready"}
    if firmware < WATCHDOG_FIRMWARE and family != "X330":
        absent |= {"bus_watchdog", "drive_mode"}
    table = [*BESIDES.get(family, ())]
    for name, address, size, writable, default, (minimum, maximum) in COMMON:
        if name not in absent:
            values = otherwise.get(name, (default, minimum, maximum))
            table.append(Register(name, address, size, writable, *values))
    factory = {"model_number": model.number, "velocity_limit": model.velocity_limit}
    factory |= _FACTORY.get(model.name, {})
    table = [r._replace(default=factory.get(r.name, r.default)) for r in table]
    table.sort(key=lambda register: register.address)
    return MappingProxyType({register.name: register for register in table})


def _voltage_limits(family: Family, voltage: float) -> tuple[int, int, int, int]:
    """Return Max and Min Voltage Limit from the factory, and the range of both [0.1 V]."""
    if family == "X330":
        return (140, 55, 55, 140) if voltage > 10 else (70, 35, 31, 70)
    return (300, 110, 110, 300) if voltage > 20 else (160, 95, 95, 160)


_ALL: Final = (
    Model("XL330-M077", 1190, "X330", 5.0, 1620, 1.0, 1750, 0.215, 1.47, 383),
    Model("XL330-M288", 1200, "X330", 5.0, 445, 1.0, 1750, 0.52, 1.47, 103),
    Model("XC330-M181", 1230, "X330", 5.0, 545, 1.0, 2352, 0.6, 1.8, 129),
    Model("XC330-M288", 1240, "X330", 5.0, 350, 1.0, 2352, 0.93, 1.8, 81),
    Model("XC330-T181", 1210, "X330", 11.1, 510, 1.0, 910, 0.76, 0.8, 104),
    Model("XC330-T288", 1220, "X330", 11.1, 320, 1.0, 910, 0.92, 0.8, 65),
    Model("XM430-W210", 1030, "X430", 12.0, 330, 2.69, 1193, 3.0, 2.3, 77),
    Model("XM430-W350", 1020, "X430", 12.0, 200, 2.69, 1193, 4.1, 2.3, 46),
    Model("XH430-W210", 1010, "X430", 12.0, 210, 2.69, 648, 2.5, 1.3, 50),
    Model("XH430-W350", 1000, "X430", 12.0, 130, 2.69, 648, 3.4, 1.3, 30),
    Model("XH430-V210", 1050, "X430", 24.0, 230, 1.34, 689, 2.6, 0.7, 52),
    Model("XH430-V350", 1040, "X430", 24.0, 135, 1.34, 689, 3.3, 0.7, 31),
    Model("XD430-T210", 1011, "X430", 12.0, 210, 2.69, 648),
    Model("XD430-T350", 1001, "X430", 12.0, 130, 2.69, 648),
    Model("XM540-W150", 1130, "X540", 12.0, 230, 2.69, 2047, 7.3, 4.4, 53),
    Model("XM540-W270", 1120, "X540", 12.0, 128, 2.69, 2047, 10.6, 4.4, 30),
    Model("XH540-W150", 1110, "X540", 12.0, 300, 2.69, 2047, 7.1, 4.9, 70),
    Model("XH540-W270", 1100, "X540", 12.0, 167, 2.69, 2047, 9.9, 4.9, 39),
    Model("XH540-V150", 1150, "X540", 24.0, 230, 2.69, 1188, 6.4, 2.4, 60),
    Model("XH540-V270", 1140, "X540", 24.0, 128, 2.69, 1188, 9.2, 2.4, 34),
    Model("XD540-T150", 1111, "X540", 12.0, 300, 2.69, 2047),
    Model("XD540-T270", 1101, "X540", 12.0, 167, 2.69, 2047),
    Model("XW430-T200", 1280, "XW430", 12.0, 235, 2.69, 2047),
    Model("XW430-T333", 1270, "XW430", 12.0, 139, 2.69, 2047),
    Model("XW540-T140", 1180, "XW540", 12.0, 304, 2.69, 2047, 6.9, 4.9, 72),
    Model("XW540-T260", 1170, "XW540", 12.0, 167, 2.69, 2047, 9.5, 4.9, 40),
    Model("XW540-H260", 1310, "XW540", 24.0, 145, 2.69, 1188),
)

MODELS: Final[Mapping[str, Model]] = MappingProxyType({model.name: model for model in _ALL})
"""Every known model, by name."""

REGISTERS: Final = MODELS["XM430-W350"].registers
"""Registers that are the same in every model that has them: torque, its goal, watchdog, errors."""


def model_by_number(number: int) -> Model | None:
    """Return the model with this Model Number; None when it is not known."""
    for model in _ALL:
        if model.number == number:
            return model
    return None
