"""Reads and writes a servo's registers by name, and tries again; every failure raises.

Replies are matched to requests elsewhere. Here a lost, late or damaged request or reply costs
another attempt, with more patience each time. Only a value that is read back counts as written.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Final, TypeVar

from haptic_wall.hw.dynamixel.codec import ErrorCode, Instruction
from haptic_wall.hw.dynamixel.exchange import Exchange
from haptic_wall.hw.dynamixel.registers import Register
from haptic_wall.hw.dynamixel.station import Station
from haptic_wall.hw.dynamixel.tables import Model
from haptic_wall.hw.errors import (
    Problem,
    ServoError,
    ServoLostError,
    ServoMissingError,
    UnfitServoError,
    wiring,
)
from haptic_wall.hw.serialport.line import Line

QUICK_NS: Final = (3_000_000, 3_000_000, 4_000_000, 6_000_000, 20_000_000)
"""Time allowed for each attempt where a torque is on [ns]: at first the servo's return delay
(0.5 ms) and the adapter's hold (1 ms); the last one outlasts an adapter's 16 ms timer"""
PATIENCE_NS: Final = (*QUICK_NS, 250_000_000)
"""The same at the start; the last one outlasts a USB link that holds everything for 200 ms"""
_PING_BYTES: Final = 3
"""Data of a reply to a ping, model number and firmware; no other reply has as many"""
_GARBLED: Final = (ErrorCode.INSTRUCTION, ErrorCode.CRC, ErrorCode.DATA_LENGTH)
"""Refusals of a request that the line has damaged"""
_REASONS: Final = {code.value: f"{code.name.lower().replace('_', ' ')} error" for code in ErrorCode}
APART: Final = "connect one of them, and give it another id with Dynamixel Wizard."
ECHOES: Final = "the adapter returns what is sent"
"""Of a half-duplex adapter; the reply comes behind the echo"""
_LATE_MS: Final = 10.0
UNHELD: Final = "set the adapter's latency timer to 1 ms, use no hub"
"""Advice where replies come late"""
_Found = TypeVar("_Found")


def lateness(station: Station) -> str:
    """Return how late replies came, as the end of a sentence; empty: all came in time."""
    late_ms = station.longest_ns * 1e-6
    return f"; replies came up to {late_ms:.0f} ms late" if late_ms > _LATE_MS else ""


def lost(station: Station, name: str, what: str, more: str = "") -> ServoLostError:
    """Return the error for a servo that stops answering; it names late replies, if any came.

    Args:
        station: The servo.
        name: Its name, which ends in "on PORT".
        what: What it did not answer.
        more: Follows the advice.
    """
    advice = f"check {wiring(name)}{more}."
    if late := lateness(station):
        what += late
        advice = f"{UNHELD}, and {advice}"
    return ServoLostError(what, advice=advice)


def confirmed(
    station: Station,
    register: Register,
    value: int,
    patience_ns: Sequence[int] = PATIENCE_NS,
) -> int | None:
    """Write a register until the value is read back.

    Args:
        station: The servo.
        register: The register.
        value: Its new value.
        patience_ns: Time allowed for each reply of each attempt [ns].

    Returns:
        The value read back, another one if the servo does not take it; None: no reply.

    Raises:
        ServoLostError: The port is gone.
    """
    found: int | None = None
    for each_ns in patience_ns:
        station.refusal = 0
        found = station.write_register(register, value, each_ns)
        if found == value:
            break
    return found


def read_patiently(
    station: Station, register: Register, patience_ns: Sequence[int] = PATIENCE_NS
) -> int | None:
    """Read a register until there is a reply; None: there was none.

    Args:
        station: The servo.
        register: The register.
        patience_ns: Time allowed for each attempt [ns].

    Raises:
        ServoLostError: The port is gone.
    """
    return _until_answered(station, lambda each: station.read_register(register, each), patience_ns)


def _until_answered(
    station: Station, ask: Callable[[int], _Found | None], patience_ns: Sequence[int] = PATIENCE_NS
) -> _Found | None:
    for each_ns in patience_ns:
        station.refusal = 0
        found = ask(each_ns)
        if found is not None:
            return found
    return None


class Table:
    """One servo's registers by name.

    Args:
        station: The servo.
        name: Its id and bus, for messages.
        registers: The registers of its model.
    """

    def __init__(self, station: Station, name: str, registers: Mapping[str, Register]) -> None:
        self.station = station
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
        exchange = Exchange(line, [servo_id], baud=baud)
        return cls(
            exchange.stations[0], f"id {servo_id} at {baud} baud on {where}", model.registers
        )

    def at(self, registers: Mapping[str, Register]) -> Table:
        """Return the same servo with other registers, those of its firmware."""
        return Table(self.station, self.name, registers)

    def ping(self) -> int:
        """Return the servo's model number.

        Raises:
            ServoMissingError: No reply.
            UnfitServoError: The servo refuses.
        """
        station = self.station
        data = _until_answered(
            station, lambda patience: station.ask(Instruction.PING, b"", _PING_BYTES, patience)
        )
        if data is not None:
            return int.from_bytes(data[:2], "little")
        failure = self._failure("a ping")
        if isinstance(failure, UnfitServoError):
            raise failure
        for_a_second = ", and for a second servo with this id" if self.station.damaged else ""
        raise ServoMissingError(
            f"No servo answers as {self.name}{self._reason()}",
            advice=f"check {wiring(self.name)}{for_a_second}; `haptic-wall scan` lists what answers"
            " at which id and baud rate, and `haptic-wall doctor CONFIG` examines the bus.",
        )

    def read(self, name: str) -> int:
        """Return the value of a register.

        Raises:
            ServoLostError: No valid reply, though it replied before.
            UnfitServoError: The servo refuses, or two have replied.
        """
        found = read_patiently(self.station, self.registers[name])
        self.be_one()
        if found is None:
            raise self._failure(f"to read {self.label(name)}")
        return found

    def write(self, name: str, value: int) -> int:
        """Write a register; return its value, which differs if the servo does not take ``value``.

        Raises:
            ServoLostError: No valid reply, though it replied before.
            UnfitServoError: The servo refuses, or two have replied.
        """
        found = confirmed(self.station, self.registers[name], value)
        self.be_one()
        if found is None or (found != value and self.station.refusal):
            raise self._failure(f"to write {value} to {self.label(name)}")
        return found

    def be_one(self) -> None:
        """Refuse two servos with this id.

        Raises:
            UnfitServoError: Two have replied.
        """
        if self.station.twins:
            raise UnfitServoError(f"Two servos answer as {self.name}", advice=APART)

    def reboot(self) -> None:
        """Restart the servo; it replies again after about a second.

        Raises:
            ServoLostError: No confirmation.
            UnfitServoError: The servo refuses.
        """
        self.station.refusal = 0
        if self.station.ask(Instruction.REBOOT, b"", 0, PATIENCE_NS[-1]) is None:
            raise self._failure("to reboot")

    def label(self, name: str) -> str:
        """Return a register's name and address as in the manual."""
        return f"{name.replace('_', ' ').title()} ({self.registers[name].address})"

    def _reason(self) -> str:
        """Describe the refusal of the last attempt, if there was one."""
        code = self.station.refusal
        if code:
            return f" ({_REASONS.get(code, f'error {code}')})"
        if self.station.echoes:
            return f" ({ECHOES})"
        return " (damaged replies came)" if self.station.damaged else ""

    def _failure(self, doing: str) -> ServoError:
        if self.station.refusal and self.station.refusal not in _GARBLED:
            return UnfitServoError(
                Problem(
                    f"The servo {self.name} refuses {doing}{self._reason()}",
                    advice="check that it is the configured model and that its torque is off.",
                )
            )
        return lost(
            self.station,
            self.name,
            f"The servo {self.name} answered before, but not the request {doing}{self._reason()}",
            ", and for a second servo with this id",
        )
