"""Lines for tests: servos that answer at once with the time as their position, and trouble."""

from __future__ import annotations

import struct
from collections.abc import Callable
from operator import itemgetter

import pytest

from haptic_wall.hw.clock import Clock, SimulatedClock
from haptic_wall.hw.dynamixel.codec import (
    FastReply,
    Instruction,
    Parser,
    encode_fast_status,
    encode_status,
)
from haptic_wall.hw.emulated.instructions import READS, entries
from haptic_wall.hw.serialport.line import Line

US = 1_000
MS = 1_000_000
APART = 100_000_000
"""Distance of the positions of two servos [counts]"""


class ClockLine:
    """Servos, and the line to them, whose position is the time: a count per microsecond.

    A sample's position is the instant it was taken, so one that is taken for another shows.
    """

    def __init__(self, clock: SimulatedClock, reply_ns: int = 200 * US) -> None:
        self.clock = clock
        self.reply_ns = reply_ns
        self.tick_rate = 1.0
        self.tick_offset = 0
        self.registers = bytearray(256)
        self.written: list[tuple[int, int, bytes]] = []
        """Instruction, id and parameters of every frame that was not a read"""
        self.closed = False
        self._parser = Parser()
        self._replies: list[tuple[int, bytes]] = []

    def asked_ns(self, now_ns: int) -> int:
        """When a request that is written now comes to the servos."""
        return now_ns

    def heard_ns(self, now_ns: int) -> int:
        """When a reply that they send now has come."""
        return now_ns

    def write(self, data: bytes) -> None:
        now = self.asked_ns(self.clock.now_ns())
        for frame in self._parser.feed(data):
            if frame.instruction == Instruction.PING:
                reply = encode_status(frame.id, 0, bytes([0xFC, 0x03, 48]))  # an XM430-W350
            elif frame.instruction == Instruction.READ:
                reply = encode_status(frame.id, 0, self.block(frame.id, frame.params, now))
            elif frame.instruction in READS:
                blocks = {id_: self.block(id_, params, now) for id_, params in entries(frame)}
                if frame.instruction in (Instruction.SYNC_READ, Instruction.BULK_READ):
                    reply = b"".join(encode_status(id_, 0, block) for id_, block in blocks.items())
                else:
                    parts = [FastReply(id_, 0, block) for id_, block in blocks.items()]
                    reply = encode_fast_status(parts)
            else:
                self.written.append((frame.instruction, frame.id, frame.params))
                if frame.instruction == Instruction.SYNC_WRITE:
                    address, size = struct.unpack("<HH", frame.params[:4])
                    self.registers[address : address + size] = frame.params[-size:]
                continue
            self._replies.append((self.heard_ns(now + self.reply_ns), reply))

    def block(self, id_: int, params: bytes, now: int) -> bytes:
        """Registers of a servo, whose position is the time and its id."""
        address, size = struct.unpack("<HH", params[:4])
        tick = (int(now * self.tick_rate / MS) + self.tick_offset) % 32768
        counts = now // US + (id_ - 1) * APART
        self.registers[120:136] = struct.pack("<HHhhii", tick, 0, 0, -7, 0, counts)
        return bytes(self.registers[address : address + size])

    def read(self) -> bytes:
        now = self.clock.now_ns()
        here = b"".join(reply for at, reply in self._replies if at <= now)
        self._replies = [(at, reply) for at, reply in self._replies if at > now]
        return here

    def wait(self, deadline_ns: int) -> bool:
        first = min((at for at, _ in self._replies), default=deadline_ns)
        self.clock.wait_until(min(first, deadline_ns))
        return any(at <= self.clock.now_ns() for at, _ in self._replies)

    def close(self) -> None:
        self.closed = True


Fate = Callable[[int, bytes], list[tuple[int, bytes]]]
"""Turns a reply, by its number and bytes, into pieces with a further delay [ns] each."""


class TroubledLine:
    """A line whose replies meet a fate each; every other byte passes."""

    def __init__(self, inner: Line, fate: Fate) -> None:
        self.clock: Clock = inner.clock
        self.fate = fate
        self.number = 0
        """Of the next reply"""
        self._inner = inner
        self._bytes = b""
        self._queue: list[tuple[int, bytes]] = []

    def write(self, data: bytes) -> None:
        self._inner.write(data)

    def read(self) -> bytes:
        self._pull()
        now = self.clock.now_ns()
        here = b"".join(data for at, data in sorted(self._queue, key=itemgetter(0)) if at <= now)
        self._queue = [(at, data) for at, data in self._queue if at > now]
        return here

    def wait(self, deadline_ns: int) -> bool:
        while True:
            self._pull()
            now = self.clock.now_ns()
            if any(at <= now for at, _ in self._queue):
                return True
            if now >= deadline_ns:
                return False
            first = min((at for at, _ in self._queue), default=deadline_ns)
            self._inner.wait(min(first, deadline_ns))

    def close(self) -> None:
        self._inner.close()

    def _pull(self) -> None:
        """Hand each whole reply that has arrived to its fate."""
        self._bytes += self._inner.read()
        while len(self._bytes) >= 7:
            size = 7 + int.from_bytes(self._bytes[5:7], "little")
            if len(self._bytes) < size:
                return
            reply, self._bytes = self._bytes[:size], self._bytes[size:]
            now = self.clock.now_ns()
            self._queue += [(now + delay, data) for delay, data in self.fate(self.number, reply)]
            self.number += 1


def unharmed(_number: int, reply: bytes) -> list[tuple[int, bytes]]:
    """Nothing happens to it."""
    return [(0, reply)]


def tapped(line: Line, monkeypatch: pytest.MonkeyPatch) -> list[bytes]:
    """What is read from a line from now on, piece by piece."""
    received: list[bytes] = []
    read = line.read

    def noted() -> bytes:
        received.append(read())
        return received[-1]

    monkeypatch.setattr(line, "read", noted)
    return received
