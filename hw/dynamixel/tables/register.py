"""One entry of a control table, and the encoding of its number."""

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
        """Whether it is kept without power, and locked while torque is enabled."""
        return self.address < EEPROM_END

    @property
    def signed(self) -> bool:
        """Whether it is in two's complement."""
        return self.minimum < 0

    def decode(self, data: bytes | bytearray) -> int:
        """Return the number in ``data``, which contains exactly this register."""
        return int.from_bytes(data, "little", signed=self.signed)

    def encode(self, value: int) -> bytes:
        """Return the bytes of ``value``.

        Raises:
            OverflowError: The value does not fit in the register.
        """
        return value.to_bytes(self.size, "little", signed=self.signed)
