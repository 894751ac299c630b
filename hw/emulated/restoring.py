"""Restores a servo's EEPROM: by a factory reset, or from a backup.

Source: ROBOTIS e-Manual, "DYNAMIXEL Protocol 2.0", factory reset and control table backup.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Final

from haptic_wall.hw.dynamixel.codec import ErrorCode
from haptic_wall.hw.emulated.memory import Memory

_KEPT: Final[Mapping[int, frozenset[str]]] = MappingProxyType(
    {
        0xFF: frozenset(),
        0x01: frozenset({"id"}),
        0x02: frozenset({"id", "baud_rate"}),
    }
)
"""Registers that each option of a factory reset keeps"""


def factory_reset(memory: Memory, option: int) -> ErrorCode:
    """Set the EEPROM to factory values, except those that the option keeps; power up afterwards.

    Open in the manual: the reply to an invalid option is "data range".
    """
    if option not in _KEPT:
        return ErrorCode.DATA_RANGE
    for register in memory.registers.values():
        if register.eeprom and register.writable and register.name not in _KEPT[option]:
            memory[register.name] = register.default
    return ErrorCode.NONE


class Backup:
    """Backup of a servo: EEPROM, gains, profile and indirect addresses.

    Open in the manual: a factory reset does not touch it, and the reply to a restore without one is
    "result fail".

    Args:
        memory: The servo's registers.
        gains: Names of the registers in RAM that are saved too, beside indirect addresses.
    """

    __slots__ = ("_gains", "_memory", "_values")

    def __init__(self, memory: Memory, gains: Sequence[str]) -> None:
        self._memory = memory
        self._gains = gains
        self._values: dict[str, int] | None = None

    def store(self) -> ErrorCode:
        """Save the registers; refused while torque is on."""
        memory = self._memory
        if memory["torque_enable"]:
            return ErrorCode.RESULT_FAIL
        self._values = {
            name: memory[name]
            for name, register in memory.registers.items()
            if (register.eeprom and register.writable)
            or name in self._gains
            or name.startswith("indirect_address_")
        }
        memory["backup_ready"] = 1
        return ErrorCode.NONE

    def restore_eeprom(self) -> ErrorCode:
        """Set the EEPROM to the backup; power up afterwards."""
        if self._values is None or self._memory["torque_enable"]:
            return ErrorCode.RESULT_FAIL
        self._put_back(eeprom=True)
        return ErrorCode.NONE

    def power_up(self, *, restore_ram: bool) -> None:
        """Report that there is a backup, and restore RAM if so configured."""
        if self._values is None:
            return
        self._memory["backup_ready"] = 1
        if restore_ram:
            self._put_back(eeprom=False)

    def _put_back(self, *, eeprom: bool) -> None:
        for name, value in (self._values or {}).items():
            if self._memory.registers[name].eeprom == eeprom:
                self._memory[name] = value
