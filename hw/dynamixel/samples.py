"""Requests and decodes a servo's samples; refuses a late one by the servo's millisecond clock."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from enum import Enum
from typing import Final, NamedTuple

from haptic_wall.hw.dynamixel.codec import (
    BROADCAST,
    ExpectedReplies,
    Instruction,
    encode,
)
from haptic_wall.hw.dynamixel.registers import TICK_MODULUS
from haptic_wall.hw.servo import Outcome

SAMPLE: Final = struct.Struct("<HxxhhIi")
"""From 120: tick, moving, moving status, PWM, current, velocity, position"""
_FIELDS: Final = "H4xh4xi"
"""Of these only tick, current and position"""
SAMPLE_ADDRESS: Final = 120
SAMPLE_END: Final = SAMPLE_ADDRESS + SAMPLE.size
LENGTHS: Final = range(16, 28)
"""Sample to position, up to Present Temperature (146); the bytes after the position are unused"""
QUARANTINE: Final = 10
"""Requests before the length of an unanswered one is used again; fewer than there are lengths, so
that one is always free"""

_HALF: Final = TICK_MODULUS // 2
_TICK_SLACK_NS: Final = 5_000_000
"""Tolerance [ns]: two consecutive requests may wait in the adapter"""
_TICK_DRIFT: Final = 0.02
"""Largest relative drift of the servo's clock against this machine's"""
_TICK_TRUST_NS: Final = 10_000_000_000
"""Pause after which a tick, which wraps every 33 s, proves nothing"""
_NEAR_NS: Final = 5_000_000
"""Usual distance of two samples, within which the clocks agree"""
_MISTAKEN_NS: Final = 200_000_000
"""Largest error of an accepted sample's time [ns]: the drift of the longest pause"""
_NEVER_NS: Final = -1 << 62
PROOFS: Final = 3
"""Consecutive samples that prove that the servo's clock is not what it was taken for"""


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


class Way(Enum):
    """Ways to read servos, from the fastest."""

    FAST = Instruction.FAST_SYNC_READ
    """One request, one joint reply; firmware 45 or later, X330 46"""
    SYNC = Instruction.SYNC_READ
    """One request, a reply of each"""
    PLAIN = Instruction.READ
    """One request, one reply: the way of a single servo"""


class SampleRequest:
    """A request for the samples of some servos, perhaps in a wider block.

    Args:
        way: How they are read.
        ids: The servos, in the order of their replies.
        address: First register of the block, at 120 at most.
        length: Number of bytes; no other block has as many.
        prepared: Prepare the pattern of the replies; the block begins with the sample.

    Attributes:
        length: Number of bytes.
        frame: The request on the wire.
        expected: Recognises the undisturbed replies; None: each is searched for.
        unpack: Takes tick, current and position from a reply's data.
    """

    __slots__ = ("expected", "frame", "length", "unpack")

    def __init__(
        self, way: Way, ids: Sequence[int], address: int, length: int, *, prepared: bool = False
    ) -> None:
        self.length = length
        block = struct.pack("<HH", address, length)
        if way is Way.PLAIN:
            self.frame = encode(ids[0], Instruction.READ, block)
        else:
            self.frame = encode(BROADCAST, way.value, block + bytes(ids))
        self.expected: ExpectedReplies | None = None
        if prepared:
            self.expected = ExpectedReplies(ids, length, _FIELDS, joint=way is Way.FAST)
        self.unpack = struct.Struct(f"<{SAMPLE_ADDRESS - address}x{_FIELDS}").unpack_from


class _Seen(NamedTuple):
    """A tick, and the time in which the servo has read it."""

    tick: int
    since_ns: int
    """Earliest instant: its request was sent [ns]"""
    until_ns: int
    """Latest instant: its reply had been received [ns]"""


class ServoClock:
    """Compares a servo's millisecond tick with the instants of its requests.

    A stall of computer or adapter delays requests and replies, in their order. So a servo has read
    a tick before its reply was received, and after the tick of the reply before. A tick that did
    not is of a clock that has restarted.
    """

    __slots__ = ("_doubted", "_doubts", "_last", "restarted")

    def __init__(self) -> None:
        self._last = _Seen(0, _NEVER_NS, _NEVER_NS)
        """The last accepted sample"""
        self._doubted = self._last
        """The last refused sample that is newer than the accepted clock says"""
        self._doubts = 0
        """How many of these came in succession"""
        self.restarted = False
        """Whether the servo has restarted: no stall explains its clock.

        Not seen if the old clock began at 0 within 0.2 s of the restart, or since the last accepted
        sample: the new clock then reads what a held reply would."""

    @property
    def tick(self) -> int:
        """Return the tick of the last accepted sample."""
        return self._last.tick

    def age_ns(self, tick: int, now_ns: int) -> int:
        """Return how long ago the servo's clock was at ``tick`` [ns]."""
        advance = (tick - self._last.tick + _HALF) % TICK_MODULUS - _HALF
        return now_ns - self._last.since_ns - advance * 1_000_000

    def accept(self, tick: int, sent_ns: int, now_ns: int) -> bool:
        """Whether a tick has advanced by the time since the last accepted one.

        Args:
            tick: The servo's tick.
            sent_ns: When it was requested [ns].
            now_ns: The present time, after the reply was received [ns].
        """
        last_tick, since_ns, _ = self._last
        passed_ns = sent_ns - since_ns
        ahead_ns = (tick - last_tick) % TICK_MODULUS * 1_000_000 - passed_ns
        near = -_NEAR_NS <= ahead_ns <= _NEAR_NS >= passed_ns  # so the clocks surely agree
        if not near or self._doubts:
            return self._examine(_Seen(tick, sent_ns, now_ns))
        self._last = _Seen(tick, sent_ns, sent_ns)
        return True

    def _examine(self, seen: _Seen) -> bool:
        last = self._last
        passed_ns = seen.since_ns - last.since_ns
        if passed_ns > _TICK_TRUST_NS:
            return self._accept(seen)
        advance_ns = ((seen.tick - last.tick + _HALF) % TICK_MODULUS - _HALF) * 1_000_000
        first_ns, end_ns = last.since_ns + advance_ns, last.until_ns + advance_ns
        slack_ns = _TICK_SLACK_NS + _TICK_DRIFT * passed_ns
        newer = first_ns > seen.since_ns + slack_ns
        if advance_ns >= 0 and not newer and seen.since_ns <= end_ns + slack_ns:
            # The tick was read between the bounds that both samples give.
            since_ns = min(max(seen.since_ns, first_ns), seen.until_ns)
            until_ns = max(since_ns, min(seen.until_ns, end_ns))
            return self._accept(_Seen(seen.tick, since_ns, until_ns))
        explained = _explained(last, seen)
        if newer or not explained:
            if self._doubts and seen[:2] == self._doubted[:2]:
                return False  # the same reply again
            again = self._doubts and _explained(self._doubted, seen)
            self._doubts = self._doubts + 1 if again else 1
            self._doubted = seen
            if self._doubts >= PROOFS:
                if explained:
                    return self._accept(seen)
                self.restarted = True
        return False

    def _accept(self, seen: _Seen) -> bool:
        self._last = seen
        self._doubts = 0
        self.restarted = False
        return True


def _explained(before: _Seen, after: _Seen) -> bool:
    """Whether held bytes explain two ticks of one clock, received in this order."""
    most_ns = (1.0 + _TICK_DRIFT) * (after.until_ns - before.since_ns) + _MISTAKEN_NS
    advance_ns = (after.tick - before.tick) % TICK_MODULUS * 1_000_000
    return advance_ns <= most_ns or advance_ns >= TICK_MODULUS * 1_000_000 - _TICK_SLACK_NS
