"""Simulates a line with a servo that replies at once, for cache warm-ups only."""

from __future__ import annotations

from typing import Final

from haptic_wall.hw.clock import Clock
from haptic_wall.hw.dynamixel.codec import Instruction, encode_status
from haptic_wall.hw.dynamixel.registers import TICK_MODULUS
from haptic_wall.hw.dynamixel.samples import SAMPLE

_MIDDLE: Final = 2048
_SPAN: Final = 256
"""Amplitude of the simulated motion [counts]; its speed, one count per request, is that of a
hand"""
_READ_BYTES: Final = 14


class StandInLine:
    """A line in memory: answers each request for a sample at once."""

    __slots__ = ("_answer", "_counts", "_id", "_step", "clock")

    def __init__(self, servo_id: int, clock: Clock) -> None:
        self.clock = clock
        self._id = servo_id
        self._answer = b""
        self._counts = _MIDDLE
        self._step = 1

    def write(self, data: bytes) -> None:
        """Accept a frame; see ``Line``."""
        if len(data) != _READ_BYTES or data[7] != Instruction.READ:
            return
        self._counts += self._step
        if abs(self._counts - _MIDDLE) >= _SPAN:
            self._step = -self._step
        tick = self.clock.now_ns() // 1_000_000 % TICK_MODULUS
        sample = SAMPLE.pack(tick, 0, 0, 0, self._counts)
        self._answer = encode_status(self._id, 0, sample.ljust(data[10], b"\0"))

    def read(self) -> bytes:
        """Return the reply; see ``Line``."""
        answer, self._answer = self._answer, b""
        return answer

    def wait(self, deadline_ns: int) -> bool:  # noqa: ARG002 - the answer is there or never will be
        """Return whether a reply is there, without waiting; see ``Line``."""
        return bool(self._answer)

    def close(self) -> None:
        """Do nothing; see ``Line``."""
