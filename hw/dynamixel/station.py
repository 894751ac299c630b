"""One servo on a line: what tells its replies apart, and the reading and writing of its registers.

Each register is read in a block whose size no request to this servo of the last 0.5 s had, and no
sample has: so a late reply is not taken for the answer. What is written is read back, since all
confirmations of writes look alike.

So a second reply of the same length is a copy, or that of a second servo with this id: then its
EEPROM differs, or its tick or position in several samples in succession.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from typing import Final, Protocol

from haptic_wall.hw.dynamixel.codec import Instruction, Parser, encode
from haptic_wall.hw.dynamixel.registers import TICK_MODULUS, Register
from haptic_wall.hw.dynamixel.samples import PROOFS, SAMPLE_ADDRESS, ServoClock
from haptic_wall.hw.dynamixel.wire import ASKING_BYTES
from haptic_wall.hw.serialport.line import Line
from haptic_wall.hw.servo import BusCounts

REGISTER_SIZES: Final = range(28, 147)
"""Sizes of the blocks that read a register; samples are shorter"""
REFUSED: Final = 0x7F
"""Bits of the error byte that say why a request was refused"""
_TABLE_END: Final = 147
"""After Present Temperature"""
_LATEST_NS: Final = 500_000_000
"""Time after a request without its reply or a copy of it [ns]: either may be 200 ms late"""
_EEPROM_END: Final = 64
"""Registers before this one change by a write only"""
_TICKS_APART: Final = 3
_COUNTS_APART: Final = 16
"""More than the change between two replies to one request, if the line repeats it"""
_TICK_AND_POSITION: Final = struct.Struct("<H10xi")


class Shared(Protocol):
    """The part of the exchange that the servos on a line share; see ``Exchange``."""

    line: Line
    parser: Parser
    blocks: dict[int, int]
    number: int
    kept: bytes

    @property
    def by_id(self) -> Mapping[int, Station]:
        """Return the servos on the line."""
        ...

    def set_aside(self) -> None:
        """Discard the samples under way."""
        ...

    def wire_ns(self, count: int) -> int:
        """Return the time of ``count`` bytes on the wire [ns]."""
        ...


class Station:
    """One servo on a line.

    Args:
        exchange: Exchanges samples and goals with the servos on the line.
        id_: The servo.
    """

    __slots__ = (
        "_eeprom",
        "_odd_cycles",
        "_odd_number",
        "_read_ns",
        "accept",
        "answered",
        "block",
        "clock",
        "counts",
        "echoes",
        "exchange",
        "id",
        "longest_ns",
        "position",
        "refusal",
        "silent",
        "twins",
    )

    def __init__(self, exchange: Shared, id_: int) -> None:
        self.exchange = exchange
        self.id = id_
        self.counts = BusCounts()
        self.echoes = False
        """An instruction came back as it was sent"""
        self.refusal = 0
        """Reason of the last refusal of a read or write (``ErrorCode``); set it to 0 to know of the
        next"""
        self.answered = self.position = 0
        """Length of the last good sample, and its position"""
        self.block = b""
        """All data of the answer to the last request, if that was for a wider block"""
        self.silent = 0
        """Consecutive lost readings by this servo's own fault"""
        self._read_ns: dict[int, int] = {}
        """When a register was last read in a block of this size [ns]"""
        self._eeprom: dict[int, bytes] = {}
        """What the answer in a block of this size began with, of the EEPROM"""
        self._odd_cycles = 0
        """Successive requests of samples with two different answers"""
        self._odd_number = 0
        self.forget()

    def forget(self) -> None:
        """Discard what is known of the servo and its line: both may have changed."""
        self.clock = ServoClock()
        self.accept = self.clock.accept
        self.twins = False
        """Two servos have replied to one request"""
        self.longest_ns = 0
        """Longest time that an answer took, or a late sample by its clock [ns]"""

    @property
    def damaged(self) -> bool:
        """Whether any bytes have come that are no frame."""
        parser = self.exchange.parser
        return parser.corrupt > 0 or not parser.idle

    def write_register(self, register: Register, value: int, patience_ns: int) -> int | None:
        """Write a register; return the value that is read back, as ``read_register`` does.

        A confirmation only ends the wait: it may be a late one of another write.

        Raises:
            ServoLostError: The port is gone.
        """
        params = register.address.to_bytes(2, "little") + register.encode(value)
        self.ask(Instruction.WRITE, params, 0, patience_ns)
        return self.read_register(register, patience_ns)

    def read_register(
        self, register: Register, patience_ns: int, sizes: Sequence[int] = REGISTER_SIZES
    ) -> int | None:
        """Return the value of a register; None: no valid answer.

        Args:
            register: One up to Present Temperature (146).
            patience_ns: Time allowed beyond the bytes' own [ns].
            sizes: Sizes of blocks to choose from [bytes].

        Raises:
            ServoLostError: The port is gone.
        """
        clock, read_ns = self.exchange.line.clock, self._read_ns
        latest_ns = clock.now_ns() - _LATEST_NS
        free = [size for size in sizes if size not in self.exchange.blocks]
        size = next((n for n in free if read_ns.get(n, latest_ns) <= latest_ns), 0)
        if not size:
            size = min(free, key=read_ns.__getitem__)
            clock.wait_until(read_ns[size] + _LATEST_NS)
        read_ns[size] = clock.now_ns()
        address = min(register.address, _TABLE_END - size)
        self._eeprom.pop(size, None)
        block = self.ask(Instruction.READ, struct.pack("<HH", address, size), size, patience_ns)
        if block is None:
            return None
        self._eeprom[size] = block[: max(0, _EEPROM_END - address)]
        at = register.address - address
        return register.decode(block[at : at + register.size])

    def listen(self, until_ns: int) -> None:
        """Read what still comes until ``until_ns`` [ns], to find ``twins``.

        Raises:
            ServoLostError: The port is gone.
        """
        self._await(0, -1, until_ns)

    def ask(
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

        Raises:
            ServoLostError: The port is gone.
        """
        exchange = self.exchange
        now_ns = exchange.line.clock.now_ns
        exchange.set_aside()
        self.listen(now_ns())
        sent_ns = now_ns()
        kept = exchange.kept
        deadline_ns = sent_ns + patience_ns + exchange.wire_ns(len(kept) + ASKING_BYTES + size)
        if kept:
            exchange.line.write(kept)
        exchange.line.write(encode(self.id, instruction, params))
        found = self._await(instruction, size, deadline_ns)
        if found is not None:
            self.longest_ns = max(self.longest_ns, now_ns() - sent_ns)
        return found

    def _await(self, instruction: int, size: int, deadline_ns: int) -> bytes | None:
        """Return the first answer of ``size`` bytes of data; None: none came in time."""
        exchange = self.exchange
        line = exchange.line
        found: bytes | None = None
        in_time = True  # a bus without a servo may never be silent
        while found is None and in_time and line.wait(deadline_ns):
            in_time = line.clock.now_ns() < deadline_ns
            for frame in exchange.parser.feed(line.read()):
                if frame.instruction != Instruction.STATUS:
                    self.echoes |= (frame.id, frame.instruction) == (self.id, instruction)
                elif frame.id != self.id:
                    if frame.id in exchange.by_id and not frame.error & REFUSED:
                        exchange.by_id[frame.id].compare(frame.params)
                elif code := frame.error & REFUSED:
                    self.refusal = code if instruction else self.refusal
                elif len(frame.params) == size and found is None:
                    found = frame.params
                else:
                    self.compare(frame.params)
        return found

    def compare(self, data: bytes) -> None:
        """Compare a late or second reply with the answer in a block of the same length."""
        length = len(data)
        if not data.startswith(self._eeprom.get(length, b"")):
            self.twins = True
        address = self.exchange.blocks.get(length)
        if address is not None:
            tick, position = _TICK_AND_POSITION.unpack_from(data, SAMPLE_ADDRESS - address)
            self.compare_sample(length, tick, position)

    def compare_sample(self, length: int, tick: int, position: int) -> None:
        """Compare a late or second sample with the last one, if that had the same length."""
        clock, number = self.clock, self.exchange.number
        age_ns = clock.age_ns(tick, self.exchange.line.clock.now_ns())
        if self.longest_ns < age_ns < _LATEST_NS:
            self.longest_ns = age_ns
        if length != self.answered:
            return
        ticks = (tick - clock.tick + TICK_MODULUS // 2) % TICK_MODULUS - TICK_MODULUS // 2
        apart = abs(ticks) >= _TICKS_APART or abs(position - self.position) >= _COUNTS_APART
        if apart and self._odd_number != number:
            self._odd_cycles = self._odd_cycles + 1 if self._odd_number == number - 1 else 1
            self._odd_number = number
            self.twins |= self._odd_cycles >= PROOFS
