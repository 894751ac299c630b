"""Requests and decodes a servo's samples; refuses a late one by the servo's millisecond clock."""

from __future__ import annotations

import struct
from typing import Final, NamedTuple

from haptic_wall.hw.dynamixel.codec import ExpectedReply, Instruction, encode
from haptic_wall.hw.dynamixel.tables import TICK_MODULUS
from haptic_wall.hw.servo import Outcome

SAMPLE: Final = struct.Struct("<HxxhhIi")
"""From 120: tick, moving, moving status, PWM, current, velocity, position"""
SAMPLE_FIELDS: Final = "H4xh4xi"
"""Of these only tick, current and position"""
SAMPLE_ADDRESS: Final = 120
SAMPLE_END: Final = SAMPLE_ADDRESS + SAMPLE.size
LENGTHS: Final = range(16, 28)
"""Sample to position, up to Present Temperature (146); the bytes after the position are unused"""
QUARANTINE: Final = 10
"""Requests before the length of an unanswered one is used again; fewer than there are lengths, so
that one is always free"""

_HALF: Final = TICK_MODULUS // 2
_TICK_SLACK_MS: Final = 5.0
"""Tolerance [ms]: two consecutive requests may wait in the adapter"""
_TICK_DRIFT: Final = 0.02
"""Largest relative drift of the servo's clock against this machine's"""
_TICK_TRUST_NS: Final = 10_000_000_000
"""Pause after which a tick, which wraps every 33 s, proves nothing"""
_NEAR_NS: Final = 5_000_000
"""Usual distance of two samples, within which the clocks agree"""
_NEVER_NS: Final = -1 << 62
_RESTART_PROOFS: Final = 2
"""Consistent samples that contradict the accepted clock, to prove a restart"""


class Sample(NamedTuple):
    """The answer to one request, in the servo's own units; zeros unless the outcome is OK."""

    outcome: Outcome
    counts: int
    """Multi-turn position"""
    current: int
    """Signed, in the model's current unit"""
    alert: bool
    """A hardware error is latched."""
    sampled_ns: int
    """When the request was sent [ns]"""


class SampleRequest:
    """A request for the sample, perhaps in a wider block, and what is known of its reply.

    Args:
        servo_id: The servo.
        address: First register of the block, at 120 at most.
        length: Number of bytes; no other block has as many.

    Attributes:
        length: Number of bytes.
        frame: The request on the wire.
        expected: Recognises the reply.
        layout: Error byte, tick, current and position in the reply's error byte and data.
        free_at: Number of the first request that may have this length: a reply may still come.
    """

    __slots__ = ("expected", "frame", "free_at", "layout", "length")

    def __init__(self, servo_id: int, address: int, length: int) -> None:
        self.length = length
        self.frame = encode(servo_id, Instruction.READ, struct.pack("<HH", address, length))
        self.expected = ExpectedReply(servo_id, length)
        self.layout = struct.Struct(f"<B{SAMPLE_ADDRESS - address}x{SAMPLE_FIELDS}")
        self.free_at = 0


class ServoClock:
    """Compares a servo's millisecond tick with the instants of its requests."""

    __slots__ = ("_doubted", "_proofs", "_sent_ns", "_tick")

    def __init__(self) -> None:
        self._tick = 0
        self._sent_ns = _NEVER_NS
        """Tick and request instant of the last accepted sample"""
        self._doubted: tuple[int, int] | None = None
        """The same of the last refused one"""
        self._proofs = 0

    @property
    def restarted(self) -> bool:
        """Whether the servo has restarted: its clock continues from another reading."""
        return self._proofs >= _RESTART_PROOFS

    def accept(self, tick: int, sent_ns: int) -> bool:
        """Whether a tick has advanced by the time since the last accepted one.

        Args:
            tick: The servo's tick.
            sent_ns: When it was requested [ns].
        """
        passed_ns = sent_ns - self._sent_ns
        ahead_ns = (tick - self._tick) % TICK_MODULUS * 1_000_000 - passed_ns
        near = -_NEAR_NS <= ahead_ns <= _NEAR_NS >= passed_ns  # so the clocks surely agree
        if self._doubted is not None or not near:
            if not _in_step(self._tick, self._sent_ns, tick, sent_ns):
                self._doubt(tick, sent_ns)
                return False
            self._doubted = None
            self._proofs = 0
        self._tick = tick
        self._sent_ns = sent_ns
        return True

    def _doubt(self, tick: int, sent_ns: int) -> None:
        if self._doubted is not None:
            in_step = _in_step(*self._doubted, tick, sent_ns)
            self._proofs = self._proofs + 1 if in_step else 0
        self._doubted = tick, sent_ns


def _in_step(before: int, before_ns: int, tick: int, sent_ns: int) -> bool:
    """Whether one tick follows from another, each with its request instant [ns]."""
    passed_ns = sent_ns - before_ns
    if passed_ns > _TICK_TRUST_NS:
        return True
    advance = (tick - before + _HALF) % TICK_MODULUS - _HALF
    passed_ms = passed_ns * 1e-6
    slack = _TICK_SLACK_MS + _TICK_DRIFT * passed_ms
    return advance >= 0 and -slack <= advance - passed_ms <= slack
