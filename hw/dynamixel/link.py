"""Executes the running cycle on the wire: requests a sample, matches its reply, sends a goal.

The protocol has no sequence number, so a reply must be recognised as the answer to *this* request:
otherwise a loop that once misses a reply would from then on use the reply of the previous period.
Three cheap checks do it:

1. **Length.** Requests ask for the same block in different lengths (16 to 27 bytes). A length whose
   request was not answered is not used again for the next ten requests, so a late reply is
   recognised by its length, in any order of replies. Undisturbed, lengths alternate between 16 and
   17.
2. **Time.** Bytes that arrived before the request was sent cannot be its answer.
3. **The servo's clock.** The block begins with the servo's millisecond tick, which must have
   advanced by the time that passed since the last accepted sample. A clock that continues from
   another reading means that the servo has restarted.

A request may ask for a wider block around the sample, of a length that no other request has.

Two lengths would not do: a reply two periods late has the right one. The clock alone cannot tell
periods of 1 ms. A late reply may arrive after the receive buffer was drained. The longer replies
cost 1.25 µs a cycle at 4 Mbit/s.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Final

from haptic_wall.hw.dynamixel.codec import (
    BROADCAST,
    ExpectedReply,
    Frame,
    Instruction,
    Parser,
    encode,
)
from haptic_wall.hw.dynamixel.line import Line
from haptic_wall.hw.dynamixel.samples import (
    LENGTHS,
    QUARANTINE,
    SAMPLE,
    SAMPLE_ADDRESS,
    SAMPLE_END,
    Sample,
    ServoClock,
)
from haptic_wall.hw.dynamixel.tables import Register
from haptic_wall.hw.dynamixel.wire import wire_ns
from haptic_wall.hw.servo import BusCounts, Outcome

_GOAL_CURRENT: Final = 102
_OK: Final = Outcome.OK  # a lookup takes as long as making a sample
_STATUS: Final = Instruction.STATUS


class Link:
    """Exchanges samples and goal currents with one servo; matches every reply to its request."""

    def __init__(
        self, line: Line, servo_id: int, counts: BusCounts | None = None, *, baud: int = 0
    ) -> None:
        """Use ``line`` for one servo.

        Args:
            line: The bus.
            servo_id: The servo.
            counts: Counts the events on the bus.
            baud: The bus's rate [bit/s], for the time that bytes take; 0: negligible.
        """
        self.counts = BusCounts() if counts is None else counts
        self._line = line
        self._now_ns = line.clock.now_ns
        self._id = servo_id
        self._baud = baud
        self._parser = Parser(joint=False)
        self._requests = {
            length: encode(servo_id, Instruction.READ, struct.pack("<HH", SAMPLE_ADDRESS, length))
            for length in LENGTHS
        }
        self._expected = {length: ExpectedReply(servo_id, length) for length in LENGTHS}
        self._tick_at = dict.fromkeys(LENGTHS, 0)
        """Offset of the sample in a reply of each length"""
        self._goals: dict[int, bytes] = {}
        self._free_at = dict.fromkeys(LENGTHS, 0)
        self._number = 0
        """Of the next request"""
        self._length = 0
        """Of the request that waits for its answer; 0: none does"""
        self._refusals = 0
        self._sent_ns = 0
        self._begun = False
        """Any byte has come since the last request"""
        self._undecided = False
        """A reply that had begun when it was given up may still be completed"""
        self.waited_ns = 0
        """Waiting time of the last ``collect`` [ns]"""
        self.patience_ns = 0
        """How long a request may stay outstanding, over several calls of ``collect`` [ns]; 0: over
        one"""
        self._servo_clock = ServoClock()
        self.block = b""
        """All data of the last good reply"""

    @property
    def waiting(self) -> bool:
        """Whether a request is outstanding."""
        return self._length != 0

    @property
    def restarted(self) -> bool:
        """Whether the servo has restarted: its clock continues from another reading."""
        return self._servo_clock.restarted

    def forget(self) -> None:
        """Discard the servo's clock: it may have restarted since its last reading."""
        self._servo_clock = ServoClock()

    def wire_ns(self, count: int) -> int:
        """Return the time of ``count`` bytes on the wire [ns]."""
        return wire_ns(count, self._baud) if self._baud else 0

    def widen(self, address: int, end: int) -> int:
        """Register a block around the sample; return its length, for ``request``.

        Args:
            address: Its begin, at 120 at most.
            end: After its last register, at 136 at least.

        Raises:
            ValueError: It does not contain the sample, or another block has its length.
        """
        length = end - address
        if address > SAMPLE_ADDRESS or end < SAMPLE_END or length in LENGTHS[:-1]:
            raise ValueError(f"a block from {address} to {end} cannot stand for the sample")
        params = struct.pack("<HH", address, length)
        self._requests[length] = encode(self._id, Instruction.READ, params)
        self._expected[length] = ExpectedReply(self._id, length)
        self._tick_at[length] = SAMPLE_ADDRESS - address
        return length

    def request(self, wide: int = 0) -> None:
        """Request a sample. Does not wait; an earlier request not yet answered is given up.

        Args:
            wide: Request the block of this length, from ``widen``, if it is free; 0: the sample
                only.

        Raises:
            ServoLostError: The port is gone.
        """
        if self._length:
            self._give_up(Outcome.LOST)
        if stale := self._line.read():
            cut = self._parser.corrupt
            frames = self._parser.feed(stale)
            for frame in frames:
                self._count_unmatched(frame)
            if self._undecided:
                self._decide(frames, self._parser.corrupt > cut)
        number = self._number
        if not wide or self._free_at.get(wide, 0) > number:
            wide = LENGTHS.start  # found in two steps on an undisturbed bus
            while self._free_at[wide] > number:
                wide += 1
        self._number = number + 1
        self._length = wide
        self._begun = False
        self._sent_ns = self._now_ns()
        self._line.write(self._requests[wide])

    def collect(self, deadline_ns: int) -> Sample:
        """Return the answer to the last request, waiting until ``deadline_ns`` [ns] at most.

        A later call discards a reply that comes later, and counts it as late.

        Raises:
            ServoLostError: The port is gone.
            RuntimeError: There was no request.
        """
        if not self._length:
            raise RuntimeError("collect() without a request(): call request() first")
        line, parser = self._line, self._parser
        broken = parser.corrupt + self._refusals
        now_ns = self._now_ns
        self.waited_ns = 0
        while True:
            began_ns = now_ns()
            come = line.wait(deadline_ns)
            self.waited_ns += now_ns() - began_ns
            if not come:
                break
            data = line.read()
            self._begun = True
            expected = self._expected[self._length].match(data) if parser.idle else None
            found: Sample | None = None
            cut = parser.corrupt
            frames = parser.feed(data) if expected is None else (expected,)
            if self._undecided:
                broken += self._decide(frames, parser.corrupt > cut)
            for frame in frames:
                sample = self._match(frame)
                if sample is None:
                    self._count_unmatched(frame)
                elif found is None:
                    found = sample
            if found is not None:
                return found
            if began_ns >= deadline_ns:  # a bus without a servo may never be silent
                break
        came_broken = parser.corrupt + self._refusals > broken
        if not came_broken and now_ns() - self._sent_ns < self.patience_ns:
            return Sample(Outcome.WAITING, 0, 0, False, self._sent_ns)
        return self._give_up(Outcome.CORRUPT if came_broken else Outcome.LOST)

    def send_current(self, goal: int) -> None:
        """Send a goal current, in the model's unit, by a sync write, which has no reply.

        Raises:
            ServoLostError: The port is gone.
        """
        frame = self._goals.get(goal)
        if frame is None:  # built once per value; there are as many as current units
            params = struct.pack("<HHBh", _GOAL_CURRENT, 2, self._id, goal)
            frame = self._goals[goal] = encode(BROADCAST, Instruction.SYNC_WRITE, params)
        self._line.write(frame)

    def write_register(self, register: Register, value: int, deadline_ns: int) -> bool:
        """Write a register; return whether the servo confirmed it before ``deadline_ns`` [ns].

        Raises:
            ServoLostError: The port is gone.
        """
        params = register.address.to_bytes(2, "little") + register.encode(value)
        answer = self._ask(Instruction.WRITE, params, 0, deadline_ns)
        return answer is not None

    def read_register(self, register: Register, deadline_ns: int) -> int | None:
        """Return the value of a register; None: no valid answer before ``deadline_ns`` [ns].

        Raises:
            ServoLostError: The port is gone.
        """
        answer = self.read_block(register.address, register.size, deadline_ns)
        return None if answer is None else register.decode(answer)

    def read_block(self, address: int, size: int, deadline_ns: int) -> bytes | None:
        """Return consecutive registers; None: no valid answer before ``deadline_ns`` [ns].

        A reply names neither its servo's registers nor its request: where an older one may still be
        under way, request a size that it cannot have.

        Raises:
            ServoLostError: The port is gone.
        """
        params = struct.pack("<HH", address, size)
        return self._ask(Instruction.READ, params, size, deadline_ns)

    def _ask(
        self, instruction: Instruction, params: bytes, size: int, deadline_ns: int
    ) -> bytes | None:
        """Send one instruction and wait for a good reply with ``size`` bytes of data.

        A sample under way is discarded: it is no longer needed.
        """
        line, parser, now_ns = self._line, self._parser, self._now_ns
        if self._length:
            self._quarantine()
        self._undecided = False
        parser.feed(line.read())
        line.write(encode(self._id, instruction, params))
        in_time = True  # a bus without a servo may never be silent
        while in_time and line.wait(deadline_ns):
            in_time = now_ns() < deadline_ns
            for frame in parser.feed(line.read()):
                if self._is_good_reply(frame) and len(frame.params) == size:
                    return frame.params
        return None

    def _is_good_reply(self, frame: Frame) -> bool:
        return frame.id == self._id and frame.instruction == _STATUS and not frame.error & 0x7F

    def _match(self, frame: Frame) -> Sample | None:
        """Return the sample if ``frame`` answers the waiting request, else None."""
        params = frame.params
        length = self._length
        if len(params) != length or not length or not self._is_good_reply(frame):
            return None
        tick, _, current, _, position = SAMPLE.unpack_from(params, self._tick_at[length])
        if not self._servo_clock.accept(tick, self._sent_ns):
            return None
        self.block = params
        self.counts.cycles += 1
        self._free_at[length] = self._number + 1  # not for the next request: a copy may follow
        self._length = 0
        return Sample(_OK, position, current, frame.error != 0, self._sent_ns)

    def _give_up(self, outcome: Outcome) -> Sample:
        """Stop waiting for the last request, and keep its length out of use for a while.

        The rest of a reply that has begun may be in the adapter: it is lost now, and late when it
        comes. When another frame begins instead, it was truncated, and counts as broken.
        """
        counts = self.counts
        counts.cycles += 1
        self._undecided |= self._begun and not self._parser.idle and outcome is Outcome.LOST
        if outcome is Outcome.CORRUPT:
            counts.corrupt += 1
        else:
            counts.lost += 1
        self._quarantine()
        return Sample(outcome, 0, 0, False, self._sent_ns)

    def _decide(self, frames: Sequence[Frame], cut: bool) -> bool:
        """Classify a reply that had begun when it was given up.

        Args:
            frames: Frames completed since: its rest came, so it was late.
            cut: Another frame began instead, so it was truncated.

        Returns:
            ``cut``, which then is no sign of another broken reply.
        """
        if frames or cut:
            self._undecided = False
        if cut:
            self.counts.lost -= 1
            self.counts.corrupt += 1
        return cut

    def _quarantine(self) -> None:
        """Stop waiting; the answer may still come, so its length is not used for a while."""
        self._free_at[self._length] = self._number + QUARANTINE
        self._length = 0

    def _count_unmatched(self, frame: Frame) -> None:
        """Count a sample that no request waits for, or a refusal (it does not name its request)."""
        if self._is_good_reply(frame):
            self.counts.late += len(frame.params) in self._requests
        elif frame.id == self._id and frame.error:
            self._refusals += 1
