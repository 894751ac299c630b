"""Reads and writes a servo's registers by name, and tries again; every failure raises.

``Link`` matches the replies to their requests. Here a lost, late or damaged request or reply costs
another attempt, with more patience each time: the last one outlasts an adapter's timer, and a USB
link that holds everything for 200 ms. Only a value that is read back counts as written.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final, TypeVar

from haptic_wall.hw.dynamixel.codec import ErrorCode, Instruction
from haptic_wall.hw.dynamixel.link import Link
from haptic_wall.hw.dynamixel.tables import Model, Register
from haptic_wall.hw.errors import (
    Problem,
    ServoError,
    ServoLostError,
    ServoMissingError,
    UnfitServoError,
)
from haptic_wall.hw.serialport.line import Line

PATIENCE_NS: Final = (3_000_000, 6_000_000, 20_000_000, 250_000_000)
"""Time allowed for each attempt [ns]: at first the servo's return delay (0.5 ms) and the adapter's
hold (1 ms)"""
_PING_BYTES: Final = 3
"""Data of a reply to a ping, model number and firmware; no other reply has as many"""
_GARBLED: Final = (ErrorCode.INSTRUCTION, ErrorCode.CRC, ErrorCode.DATA_LENGTH)
"""Refusals of a request that the line has damaged"""
_REASONS: Final = {code.value: f"{code.name.lower().replace('_', ' ')} error" for code in ErrorCode}
ECHOES: Final = "the adapter returns what is sent"
"""Of a half-duplex adapter; the reply comes behind the echo"""
_Found = TypeVar("_Found")


class Table:
    """One servo's registers by name.

    Args:
        link: The servo.
        name: Its id and bus, for messages.
        registers: The registers of its model.
    """

    def __init__(self, link: Link, name: str, registers: Mapping[str, Register]) -> None:
        self.link = link
        self.name = name
        self.registers = registers

    @classmethod
    def on(cls, line: Line, baud: int, servo_id: int, where: str, model: Model) -> Table:
        """Return the servo with this id on a line.

        Args:
            line: The bus.
            baud: Its rate [bit/s].
            servo_id: The servo's id.
            where: Names the bus in messages.
            model: Its model.
        """
        link = Link(line, servo_id, baud=baud)
        return cls(link, f"id {servo_id} at {baud} baud on {where}", model.registers)

    def at(self, registers: Mapping[str, Register]) -> Table:
        """Return the same servo with other registers, those of its firmware."""
        return Table(self.link, self.name, registers)

    def ping(self) -> int:
        """Return the servo's model number.

        Raises:
            ServoMissingError: No reply.
            UnfitServoError: The servo refuses.
        """
        data = self._try(
            lambda patience: self.link.ask(Instruction.PING, b"", _PING_BYTES, patience)
        )
        if data is not None:
            return int.from_bytes(data[:2], "little")
        failure = self._failure("a ping")
        if isinstance(failure, UnfitServoError):
            raise failure
        raise ServoMissingError(
            f"No servo answers as {self.name}{self._reason()}",
            advice="check its power and cable; `haptic-wall scan` lists what answers at which id"
            " and baud rate, and `haptic-wall doctor CONFIG` examines the bus.",
        )

    def read(self, name: str) -> int:
        """Return the value of a register.

        Raises:
            ServoLostError: No valid reply, though it replied before.
            UnfitServoError: The servo refuses.
        """
        register = self.registers[name]
        found = self._try(lambda patience: self.link.read_register(register, patience))
        if found is None:
            raise self._failure(f"to read {self.label(name)}")
        return found

    def write(self, name: str, value: int) -> int:
        """Write a register; return its value, which differs if the servo does not take ``value``.

        Raises:
            ServoLostError: No valid reply, though it replied before.
            UnfitServoError: The servo refuses.
        """
        register = self.registers[name]
        for patience_ns in PATIENCE_NS:
            self.link.refusal = 0
            found = self.link.write_register(register, value, patience_ns)
            if found == value:
                return found
        if found is None or self.link.refusal:
            raise self._failure(f"to write {value} to {self.label(name)}")
        return found

    def reboot(self) -> None:
        """Restart the servo; it replies again after about a second.

        Raises:
            ServoLostError: No confirmation.
            UnfitServoError: The servo refuses.
        """
        self.link.refusal = 0
        if self.link.ask(Instruction.REBOOT, b"", 0, PATIENCE_NS[-1]) is None:
            raise self._failure("to reboot")

    def label(self, name: str) -> str:
        """Return a register's name and address as in the manual."""
        return f"{name.replace('_', ' ').title()} ({self.registers[name].address})"

    def _try(self, ask: Callable[[int], _Found | None]) -> _Found | None:
        """Return the first answer of several attempts; None: there was none."""
        for patience_ns in PATIENCE_NS:
            self.link.refusal = 0
            found = ask(patience_ns)
            if found is not None:
                return found
        return None

    def _reason(self) -> str:
        """Describe the refusal of the last attempt, if there was one."""
        code = self.link.refusal
        if code:
            return f" ({_REASONS.get(code, f'error {code}')})"
        return f" ({ECHOES})" if self.link.echoes else ""

    def _failure(self, doing: str) -> ServoError:
        if self.link.refusal and self.link.refusal not in _GARBLED:
            return UnfitServoError(
                Problem(
                    f"The servo {self.name} refuses {doing}{self._reason()}",
                    advice="check that it is the configured model and that its torque is off.",
                )
            )
        return ServoLostError(
            f"The servo {self.name} answered before, but not the request {doing}{self._reason()}",
            advice="check the cable and for a second servo with this id.",
        )
