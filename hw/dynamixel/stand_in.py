"""A line on which a servo answers at once that it moves slowly to and fro: for rehearsals only."""

from __future__ import annotations

from typing import Final

from haptic_wall.hw.clock import Clock
from haptic_wall.hw.dynamixel.codec import Instruction, encode_status
from haptic_wall.hw.dynamixel.samples import SAMPLE
from haptic_wall.hw.dynamixel.tables import TICK_MODULUS

_MIDDLE: Final = 2048
_SWING: Final = 256
"""A count a request, to either side of the middle: as slow as a hand"""
_READ_BYTES: Final = 14


class StandInLine:
    """Takes what is written, and has the answer ready to each request for a sample.

    Args:
        servo_id: Who seems to answer.
        clock: The time that the servo's own clock shows.
    """

    __slots__ = ("_answer", "_counts", "_id", "_step", "clock")

    def __init__(self, servo_id: int, clock: Clock) -> None:
        self.clock = clock
        self._id = servo_id
        self._answer = b""
        self._counts = _MIDDLE
        self._step = 1

    def write(self, data: bytes) -> None:
        """See ``Line``."""
        if len(data) != _READ_BYTES or data[7] != Instruction.READ:
            return
        self._counts += self._step
        if abs(self._counts - _MIDDLE) >= _SWING:
            self._step = -self._step
        tick = self.clock.now_ns() // 1_000_000 % TICK_MODULUS
        sample = SAMPLE.pack(tick, 0, 0, 0, self._counts)
        self._answer = encode_status(self._id, 0, sample.ljust(data[10], b"\0"))

    def read(self) -> bytes:
        """See ``Line``."""
        answer, self._answer = self._answer, b""
        return answer

    def wait(self, deadline_ns: int) -> bool:  # noqa: ARG002 - the answer is there or never will be
        """See ``Line``."""
        return bool(self._answer)

    def close(self) -> None:
        """See ``Line``."""
