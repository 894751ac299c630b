"""Reads and writes a servo's registers by name, and tries again.

Each register is read in a block whose size no request to this servo of the last 0.5 s had, and no
sample has: so a late reply is not taken for the answer. A lost, late or damaged request or reply
costs another attempt, with more patience each time. Writes are sync writes, which have no reply:
what counts is what is read back.

A second reply of the same length is a copy, or that of a second servo with this id: then its EEPROM
differs.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping, Sequence
from typing import Final, TypeVar

from haptic_wall.hw.dynamixel.codec import BROADCAST, ErrorCode, Instruction, encode
from haptic_wall.hw.dynamixel.exchange import REFUSED, Exchange
from haptic_wall.hw.dynamixel.registers import EEPROM_END, Register
from haptic_wall.hw.dynamixel.station import Station
from haptic_wall.hw.dynamixel.tables import Model
from haptic_wall.hw.dynamixel.wire import ASKING_BYTES
from haptic_wall.hw.errors import (
    WIRING,
    Problem,
    ServoError,
    ServoLostError,
    ServoMissingError,
    UnfitServoError,
)
from haptic_wall.hw.serialport.line import Line

QUICK_NS: Final = (3_000_000, 3_000_000, 4_000_000, 6_000_000, 20_000_000)
"""Time allowed for each attempt where a torque is on [ns]: at first the servo's return delay
(0.5 ms) and the adapter's hold (1 ms); the last one outlasts an adapter's 16 ms timer"""
PATIENCE_NS: Final = (*QUICK_NS, 50_000_000, 250_000_000)
"""The same at the start: all but the last bear a servo that stores EEPROM for 80 ms, and the last
one a USB link that holds everything for 200 ms"""
SIZES: Final = range(49, 147)
"""Sizes of the blocks that read a register; samples are shorter"""
_TABLE_END: Final = 147
"""After Present Temperature"""
_LATEST_NS: Final = 500_000_000
"""Time after a request without its reply or a copy of it [ns]: either may be 200 ms late"""
_LISTENINGS: Final = 3
_LISTEN_NS: Final = 20_000_000
"""Wait for a second reply [ns]: longer than the largest return delay (0.5 ms) and an adapter's
16 ms timer"""
_PING_BYTES: Final = 3
"""Data of a reply to a ping, model number and firmware; no other reply has as many"""
_GARBLED: Final = (ErrorCode.INSTRUCTION, ErrorCode.CRC, ErrorCode.DATA_LENGTH)
"""Refusals of a request that the line has damaged"""
_REASONS: Final = {code.value: f"{code.name.lower().replace('_', ' ')} error" for code in ErrorCode}
_APART: Final = "connect one of them, and give it another id with Dynamixel Wizard."
_SECOND: Final = ", and for a second servo with this id"
_LATE_MS: Final = 10.0
UNHELD: Final = "set the adapter's latency timer to 1 ms, use no hub"
"""Advice where replies come late"""
_Found = TypeVar("_Found")


class Table:
    """One servo's registers by name.

    Args:
        exchange: The line.
        station: The servo.
        name: Its id and bus, for messages.
        registers: The registers of its model and firmware; may be replaced.
    """

    def __init__(
        self, exchange: Exchange, station: Station, name: str, registers: Mapping[str, Register]
    ) -> None:
        self.exchange = exchange
        self.station = station
        self.clock = exchange.line.clock
        self.name = name
        self.registers = registers
        self._read_ns: dict[int, int] = {}
        """When a register was last read in a block of this size [ns]"""
        self._eeprom: dict[int, bytes] = {}
        """What the answer in a block of this size began with, of the EEPROM"""

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
        name = f"id {servo_id} at {baud} baud on {where}"
        return cls(exchange, exchange.stations[0], name, model.registers)

    def ping(self) -> int:
        """Return the servo's model number.

        Raises:
            ServoMissingError: No reply.
            UnfitServoError: The servo refuses.
        """
        data = self._until_answered(
            lambda each_ns: self._ask(Instruction.PING, b"", _PING_BYTES, each_ns), PATIENCE_NS
        )
        if data is not None:
            return int.from_bytes(data[:2], "little")
        failure = self._failure("a ping")
        if isinstance(failure, UnfitServoError):
            raise failure
        for_a_second = _SECOND if self._damaged else ""
        raise ServoMissingError(
            f"No servo answers as {self.name}{self._reason()}",
            advice=f"check {WIRING}{for_a_second}; `haptic-wall scan` lists what answers"
            " at which id and baud rate, and `haptic-wall doctor CONFIG` examines the bus.",
        )

    def read(self, name: str) -> int:
        """Return the value of a register.

        Two servos with one id and the same settings send the same EEPROM, but never the same clock,
        position and current. If only replies with those are damaged, there are two.

        Raises:
            ServoLostError: No valid reply, though it replied before.
            UnfitServoError: The servo refuses, or two have replied.
        """
        found = self.try_read(name)
        if found is None and self._damaged and not self.registers[name].eeprom:
            same = [self.try_read("return_delay_time", QUICK_NS[-1:]) for _ in range(_LISTENINGS)]
            self.station.twins |= None not in same
        self._be_one()
        if found is None:
            raise self._failure(f"to read {self.label(name)}")
        return found

    def write(self, name: str, value: int) -> int:
        """Write a register; return its value, which differs if the servo does not take ``value``.

        Raises:
            ServoLostError: No valid reply, though it replied before.
            UnfitServoError: The servo refuses to read it, or two have replied.
        """
        found = self.try_write(name, value)
        self._be_one()
        if found is None:
            raise self._failure(f"to write {value} to {self.label(name)}")
        return found

    def try_read(
        self, name: str, patience_ns: Sequence[int] = PATIENCE_NS, sizes: Sequence[int] = SIZES
    ) -> int | None:
        """Return the value of a register; None: no valid answer.

        Args:
            name: The register, one up to Present Temperature (146).
            patience_ns: Time allowed for each attempt, beyond the bytes' own [ns].
            sizes: Sizes of blocks to choose from [bytes].
        """
        register = self.registers[name]
        return self._until_answered(lambda each: self._read(register, each, sizes), patience_ns)

    def try_write(
        self, name: str, value: int, patience_ns: Sequence[int] = PATIENCE_NS
    ) -> int | None:
        """Write a register until the servo reads it back; return what it has read; None: no reply.

        Args:
            name: The register.
            value: Its new value.
            patience_ns: Time allowed for the reply of each attempt, beyond the bytes' own [ns].
        """
        frame, found = sync_write([self], name, value), None
        frame_ns = self.exchange.wire_ns(len(frame))
        for number, each_ns in enumerate(patience_ns):
            # A servo may be silent while it stores EEPROM. One more write would only prolong that.
            if not number or found is not None or not self.registers[name].eeprom:
                self.exchange.line.write(frame)
            found = self.try_read(name, (each_ns + frame_ns,))
            if found == value:
                break
        return found

    def be_alone(self) -> None:
        """Refuse a second servo with this id; a silent one only replies with Status Return Level 2.

        Replies that come apart are of different return delays. Others collide, and are lost, unless
        both servos send the same: see ``read``.

        Raises:
            ServoLostError: Replies collide.
            UnfitServoError: Two have replied.
        """
        for _ in range(_LISTENINGS):
            self.read("return_delay_time")
            self._await(0, -1, self.clock.now_ns() + _LISTEN_NS)
            self._be_one()

    def reboot(self) -> None:
        """Restart the servo; it replies again after about a second.

        Raises:
            ServoLostError: No confirmation.
            UnfitServoError: The servo refuses.
        """
        self.station.refusal = 0
        if self._ask(Instruction.REBOOT, b"", 0, PATIENCE_NS[-1]) is None:
            raise self._failure("to reboot")

    def label(self, name: str) -> str:
        """Return a register's name and address as in the manual."""
        return f"{name.replace('_', ' ').title()} ({self.registers[name].address})"

    def lateness(self) -> str:
        """Return how late replies came, as the end of a sentence; empty: all came in time."""
        late_ms = self.station.longest_ns * 1e-6
        return f"; replies came up to {late_ms:.0f} ms late" if late_ms > _LATE_MS else ""

    def lost(self, what: str, more: str = "") -> ServoLostError:
        """Return the error for a servo that stops answering; it names late replies.

        Args:
            what: What it did not answer.
            more: Follows the advice.
        """
        more = more or (_SECOND if self._damaged else "")
        advice = f"check {WIRING}{more}."
        if late := self.lateness():
            what += late
            advice = f"{UNHELD}, and {advice}"
        return ServoLostError(what, advice=advice)

    def _until_answered(
        self, ask: Callable[[int], _Found | None], patience_ns: Sequence[int]
    ) -> _Found | None:
        for each_ns in patience_ns:
            self.station.refusal = 0
            found = ask(each_ns)
            if found is not None:
                return found
        return None

    def _read(self, register: Register, patience_ns: int, sizes: Sequence[int]) -> int | None:
        """Read a register once; None: no valid answer."""
        read_ns = self._read_ns
        latest_ns = self.clock.now_ns() - _LATEST_NS
        free = [size for size in sizes if size not in self.exchange.lengths.blocks]
        size = next((n for n in free if read_ns.get(n, latest_ns) <= latest_ns), 0)
        if not size:
            size = min(free, key=read_ns.__getitem__)
            self.clock.wait_until(read_ns[size] + _LATEST_NS)
        read_ns[size] = self.clock.now_ns()
        address = min(register.address, _TABLE_END - size)
        self._eeprom.pop(size, None)
        block = self._ask(Instruction.READ, struct.pack("<HH", address, size), size, patience_ns)
        if block is None:
            return None
        self._eeprom[size] = block[: max(0, EEPROM_END - address)]
        at = register.address - address
        return register.decode(block[at : at + register.size])

    def _ask(
        self, instruction: Instruction, params: bytes, size: int, patience_ns: int
    ) -> bytes | None:
        """Send one instruction; return the data of a good reply with ``size`` bytes of data.

        A refusal names its request no more than any reply does, so it does not end the wait.
        Samples under way are discarded.

        Args:
            instruction: The instruction.
            params: Its parameters.
            size: Bytes of data in the reply.
            patience_ns: Time allowed beyond the bytes' own [ns].

        Returns:
            The data; None: no such reply came.
        """
        exchange, now_ns = self.exchange, self.clock.now_ns
        exchange.set_aside()
        self._await(0, -1, now_ns())
        sent_ns = now_ns()
        kept = exchange.kept
        deadline_ns = sent_ns + patience_ns + exchange.wire_ns(len(kept) + ASKING_BYTES + size)
        if kept:
            exchange.line.write(kept)
        exchange.line.write(encode(self.station.id, instruction, params))
        found = self._await(instruction, size, deadline_ns)
        if found is not None:
            self.station.longest_ns = max(self.station.longest_ns, now_ns() - sent_ns)
        return found

    def _await(self, instruction: int, size: int, deadline_ns: int) -> bytes | None:
        """Return the first answer of ``size`` bytes of data; None: none came in time."""
        station, line, parser = self.station, self.exchange.line, self.exchange.parser
        found: bytes | None = None
        in_time = True  # a bus without a servo may never be silent
        while found is None and in_time and line.wait(deadline_ns):
            in_time = self.clock.now_ns() < deadline_ns
            for frame in parser.feed(line.read()):
                data = frame.params
                if frame.instruction != Instruction.STATUS or frame.id != station.id:
                    continue  # such as an echo of what was sent
                if code := frame.error & REFUSED:
                    station.refusal = code if instruction else station.refusal
                elif len(data) == size and found is None:
                    found = data
                elif not data.startswith(self._eeprom.get(len(data), b"")):
                    station.twins = True
        return found

    def _be_one(self) -> None:
        if self.station.twins:
            raise UnfitServoError(f"Two servos answer as {self.name}", advice=_APART)

    @property
    def _damaged(self) -> bool:
        """Whether any bytes have come that are no frame."""
        parser = self.exchange.parser
        return parser.corrupt > 0 or not parser.idle

    def _reason(self) -> str:
        """Describe the refusal of the last attempt, if there was one."""
        code = self.station.refusal
        if code:
            return f" ({_REASONS.get(code, f'error {code}')})"
        return " (damaged replies came)" if self._damaged else ""

    def _failure(self, doing: str) -> ServoError:
        if self.station.refusal and self.station.refusal not in _GARBLED:
            return UnfitServoError(
                Problem(
                    f"The servo {self.name} refuses {doing}{self._reason()}",
                    advice="check that it is the configured model and that its torque is off.",
                )
            )
        return self.lost(
            f"The servo {self.name} answered before, but not the request {doing}{self._reason()}",
            _SECOND,
        )


def sync_write(servos: Sequence[Table], name: str, value: int) -> bytes:
    """Return the frame that writes a register of some servos, at the same address in all."""
    first, *_ = servos
    register = first.registers[name]
    data = register.encode(value)
    head = struct.pack("<HH", register.address, register.size)
    shares = b"".join(bytes([one.station.id]) + data for one in servos)
    return encode(BROADCAST, Instruction.SYNC_WRITE, head + shares)
