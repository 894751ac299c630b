"""One entry of a control table, and how its number stands in bytes."""

from __future__ import annotations

from typing import NamedTuple

from haptic_wall.hw.dynamixel.tables.units import EEPROM_END


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
