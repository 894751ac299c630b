"""The memory behind a control table: which bytes belong to which register, read and written."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from hw.dynamixel.codec import ErrorCode
from hw.dynamixel.tables import Register


class Memory:
    """Bytes at addresses, and the registers that lie there.

    Reads may cover addresses between registers, which hold zeros; writes may not.

    Args:
        registers: The table; every register is at its default.
        measured: Addresses that ``overwrite`` fills.
    """

    __slots__ = ("_at", "_bytes", "_measured", "_values", "registers")

    def __init__(self, registers: Iterable[Register], measured: range) -> None:
        self._measured = measured
        self._values: dict[str, int] = {}  # what is in the bytes, to be had quickly
        self.registers: Mapping[str, Register] = {r.name: r for r in registers}
        end = max(r.address + r.size for r in self.registers.values())
        self._bytes = bytearray(end)
        self._at: list[Register | None] = [None] * end
        for register in self.registers.values():
            for byte in range(register.address, register.address + register.size):
                self._at[byte] = register
            self[register.name] = register.default

    def __contains__(self, name: str) -> bool:
        return name in self.registers

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

    def overwrite(self, data: bytes) -> None:
        """Put ``data`` where the measured registers are."""
        self._bytes[self._measured.start : self._measured.stop] = data

    def read(self, address: int, size: int) -> bytes | None:
        """The bytes there; None when they reach beyond the table."""
        if address + size > len(self._bytes):
            return None
        return bytes(self._bytes[address : address + size])

    def split(self, address: int, data: bytes) -> list[tuple[Register, int]] | ErrorCode:
        """The registers ``data`` would be written to, with their values, or why it cannot be.

        Only what depends on the table alone is checked: that whole, writable registers are hit,
        and that the values lie in their ranges.
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
            part = data[done : done + register.size]
            if at != register.address or len(part) < register.size:
                return ErrorCode.DATA_LENGTH
            value = register.decode(part)
            if not register.minimum <= value <= register.maximum:
                return ErrorCode.DATA_RANGE
            values.append((register, value))
            done += register.size
        return values
