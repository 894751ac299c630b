"""Stores a control table: maps bytes to registers for reads and writes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from haptic_wall.hw.dynamixel.codec import ErrorCode
from haptic_wall.hw.dynamixel.registers import Register


class Memory:
    """The bytes of a control table, and their registers.

    Reads may cover addresses between registers, which hold zeros; writes may not.

    Args:
        registers: The table; every register is at its default.
        measured: Addresses that ``overwrite`` fills.
    """

    def __init__(self, registers: Iterable[Register], measured: range) -> None:
        self._measured = measured
        self._values: dict[str, int] = {}  # decoded values of the bytes, for quick access
        self.registers: Mapping[str, Register] = {r.name: r for r in registers}
        end = max(r.address + r.size for r in self.registers.values())
        self._bytes = bytearray(end)
        self._at: list[Register | None] = [None] * end
        for register in self.registers.values():
            for byte in range(register.address, register.address + register.size):
                self._at[byte] = register
            self[register.name] = register.default

    def __getitem__(self, name: str) -> int:
        value = self._values.get(name)
        if value is not None:
            return value
        register = self.registers[name]
        return register.decode(self._bytes[register.address : register.address + register.size])

    def __setitem__(self, name: str, value: int) -> None:
        register = self.registers[name]
        self._bytes[register.address : register.address + register.size] = register.encode(value)
        if register.address not in self._measured:
            self._values[name] = value

    def get(self, name: str) -> int:
        """Return the register's value; 0 if the model or its firmware lacks the register."""
        value = self._values.get(name)
        if value is not None:
            return value
        return self[name] if name in self.registers else 0

    def overwrite(self, data: bytes) -> None:
        """Store ``data`` in the measured registers."""
        self._bytes[self._measured.start : self._measured.stop] = data

    def read(self, address: int, size: int) -> bytes | None:
        """Return the bytes from ``address`` on; None if they reach beyond the table."""
        end = address + size
        if end > len(self._bytes):
            return None
        return bytes(self._bytes[address:end])

    def shows_measured(self, address: int, size: int) -> bool:
        """Whether these bytes contain measured values."""
        return address < self._measured.stop and address + size > self._measured.start

    def split(self, address: int, data: bytes) -> list[tuple[Register, int]] | ErrorCode:
        """Return the registers and values that a write of ``data`` sets, or the error code.

        It checks only that the write covers whole, writable registers, and that the values lie in
        their ranges.
        """
        if not data:
            return ErrorCode.DATA_LENGTH
        values = []
        done = 0
        while done < len(data):
            at = address + done
            register = self._at[at] if at < len(self._at) else None
            if register is None or not register.writable:
                return ErrorCode.ACCESS
            end = done + register.size
            if register.address != at or end > len(data):
                return ErrorCode.DATA_LENGTH
            value = register.decode(data[done:end])
            if not register.minimum <= value <= register.maximum:
                return ErrorCode.DATA_RANGE
            values.append((register, value))
            done = end
        return values
