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
   advanced by the time that passed since the last accepted sample. A clock that no stall explains
   means that the servo has restarted.

A request may ask for a wider block around the sample, of a length that no other request has.

Registers follow the first rule too: each is read in a block whose size no request of the last
0.5 s had. What is written is read back, since all confirmations of writes look alike.

So a second reply of the same length is a copy, or that of a second servo with this id: then its
EEPROM differs, or its tick or position in several samples in succession.

Two lengths would not do: a reply two periods late has the right one. The clock alone cannot tell
periods of 1 ms. A late reply may arrive after the receive buffer was drained. The longer replies
cost 1.25 µs a cycle at 4 Mbit/s.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Final

from haptic_wall.hw.dynamixel.codec import (
    Frame,
    Instruction,
    Parser,
    SyncWrite,
    encode,
)
from haptic_wall.hw.dynamixel.samples import (
    LENGTHS,
    PROOFS,
    QUARANTINE,
    SAMPLE_ADDRESS,
    SAMPLE_END,
    Sample,
    SampleRequest,
    ServoClock,
)
from haptic_wall.hw.dynamixel.tables import TICK_MODULUS, Register
from haptic_wall.hw.dynamixel.wire import ASKING_BYTES, wire_ns
from haptic_wall.hw.serialport.line import Line
from haptic_wall.hw.servo import BusCounts, Outcome

REGISTER_SIZES: Final = range(28, 147)
"""Sizes of the blocks that read a register; samples are shorter"""
_TABLE_END: Final = 147
"""After Present Temperature"""
_LATEST_NS: Final = 500_000_000
"""Time after a request without its reply or a copy of it [ns]: either may be 200 ms late"""
_EEPROM_END: Final = 64
"""Registers before this one change by a write only"""
_TICKS_APART: Final = 3
_COUNTS_APART: Final = 16
"""More than the change between two replies to one request, if the line repeats it"""
_GOAL_CURRENT: Final = 102
_OK: Final = Outcome.OK  # a lookup takes as long as making a sample
_STATUS: Final = Instruction.STATUS
_REFUSED: Final = 0x7F
"""Bits of the error byte that say why a request was refused"""


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
        self._usual = [SampleRequest(servo_id, SAMPLE_ADDRESS, length) for length in LENGTHS]
        self._requests = {each.length: each for each in self._usual}
        self._goal = SyncWrite(_GOAL_CURRENT, (servo_id,))
        self._goals: dict[int, bytes] = {}
        self._number = 0  # of the next request
        self._asked: SampleRequest | None = None
        """The request that waits for its answer; None: none does"""
        self._refusals = 0
        self._read_ns: dict[int, int] = {}
        """When a register was last read in a block of this size [ns]"""
        self._eeprom: dict[int, bytes] = {}
        """What the answer in a block of this size began with, of the EEPROM"""
        self._odd_cycles = 0
        """Successive requests of samples with two different answers"""
        self._odd_number = 0
        self.twins = False
        """Two servos have replied to one request"""
        self.longest_ns = 0
        """Longest time that an answer took, or a late sample by its clock [ns]"""
        self.echoes = False
        """An instruction came back as it was sent"""
        self.refusal = 0
        """Reason of the last refusal of a read or write (``ErrorCode``); set it to 0 to know of the
        next"""
        self._sent_ns = 0
        self._begun = False  # any byte has come since the last request
        self._undecided = False
        """A reply that had begun when it was given up may still be completed"""
        self.waited_ns = 0
        """Waiting time of the last ``collect`` [ns]"""
        self.patience_ns = 0
        """How long a request may stay outstanding, over several calls of ``collect`` [ns]; 0: over
        one"""
        self._servo_clock = ServoClock()
        self._body = b"\0"
        """Error byte and all data of the last good reply"""

    @property
    def waiting(self) -> bool:
        """Whether a request is outstanding."""
        return self._asked is not None

    @property
    def block(self) -> bytes:
        """Return all data of the last good reply."""
        return self._body[1:]

    @property
    def damaged(self) -> bool:
        """Whether any bytes have come that are no frame."""
        return self._parser.corrupt > 0 or not self._parser.idle

    @property
    def restarted(self) -> bool:
        """Whether the servo has restarted: no stall explains its clock."""
        return self._servo_clock.restarted

    def forget(self) -> None:
        """Discard what is known of the servo and its line: both may have changed."""
        self._servo_clock = ServoClock()
        self.twins = False
        self.longest_ns = 0

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
            raise ValueError(f"a block from {address} to {end} does not contain the sample")
        self._requests[length] = SampleRequest(self._id, address, length)
        self._usual = [self._requests[each] for each in LENGTHS]
        return length

    def request(self, wide: int = 0) -> None:
        """Request a sample. Does not wait; an earlier request not yet answered is given up.

        Args:
            wide: Request the block of this length, from ``widen``, if it is free; 0: the sample
                only.

        Raises:
            ServoLostError: The port is gone.
        """
        if self._asked is not None:
            self._give_up(Outcome.LOST)
        if stale := self._line.read():
            cut = self._parser.corrupt
            frames = self._parser.feed(stale)
            for frame in frames:
                self._count_unmatched(frame)
            if self._undecided:
                self._decide(frames, self._parser.corrupt > cut)
        number = self._number
        asked = self._requests[wide] if wide else self._usual[0]
        if asked.free_at > number:
            for asked in self._usual:  # the second one, on an undisturbed bus
                if asked.free_at <= number:
                    break
        self._number = number + 1
        self._asked = asked
        self._begun = False
        self._sent_ns = self._now_ns()
        self._line.write(asked.frame)

    def collect(self, deadline_ns: int) -> Sample:
        """Return the answer to the last request, waiting until ``deadline_ns`` [ns] at most.

        A later call discards a reply that comes later, and counts it as late.

        Raises:
            ServoLostError: The port is gone.
            RuntimeError: There was no request.
        """
        asked = self._asked
        if asked is None:
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
            whole = parser.idle and not self._undecided
            if whole and (body := asked.expected.match(data)) is not None:
                found = self._accepted(asked, body)
                if found is None:
                    self._count_unmatched(Frame(self._id, _STATUS, body[0], body[1:]))
            else:
                cut = parser.corrupt
                frames = parser.feed(data)
                if self._undecided:
                    broken += self._decide(frames, parser.corrupt > cut)
                found = self._search(frames)
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
            frame = self._goals[goal] = self._goal.encode((goal,))
        self._line.write(frame)

    def write_register(
        self,
        register: Register,
        value: int,
        patience_ns: int,
        sizes: Sequence[int] = REGISTER_SIZES,
    ) -> int | None:
        """Write a register; return the value that is read back, as ``read_register`` does.

        A confirmation only ends the wait: it may be a late one of another write.

        Raises:
            ServoLostError: The port is gone.
        """
        params = register.address.to_bytes(2, "little") + register.encode(value)
        self.ask(Instruction.WRITE, params, 0, patience_ns)
        return self.read_register(register, patience_ns, sizes)

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
        read_ns, latest_ns = self._read_ns, self._now_ns() - _LATEST_NS
        free = [size for size in sizes if size not in self._requests]
        size = next((n for n in free if read_ns.get(n, latest_ns) <= latest_ns), 0)
        if not size:
            size = min(free, key=read_ns.__getitem__)
            self._line.clock.wait_until(read_ns[size] + _LATEST_NS)
        read_ns[size] = self._now_ns()
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

        A refusal names its request no more than any reply does, so it does not end the wait. A
        sample under way is discarded.

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
        if self._asked is not None:
            self._quarantine(self._asked)
        self._undecided = False
        self.listen(self._now_ns())
        sent_ns = self._now_ns()
        deadline_ns = sent_ns + patience_ns + self.wire_ns(ASKING_BYTES + size)
        self._line.write(encode(self._id, instruction, params))
        found = self._await(instruction, size, deadline_ns)
        if found is not None:
            self.longest_ns = max(self.longest_ns, self._now_ns() - sent_ns)
        return found

    def _await(self, instruction: int, size: int, deadline_ns: int) -> bytes | None:
        """Return the first answer of ``size`` bytes of data; None: none came in time."""
        line, now_ns = self._line, self._now_ns
        found: bytes | None = None
        in_time = True  # a bus without a servo may never be silent
        while found is None and in_time and line.wait(deadline_ns):
            in_time = now_ns() < deadline_ns
            for frame in self._parser.feed(line.read()):
                if frame.id != self._id or frame.instruction != _STATUS:
                    self.echoes |= (frame.id, frame.instruction) == (self._id, instruction)
                elif code := frame.error & _REFUSED:
                    self.refusal = code if instruction else self.refusal
                elif len(frame.params) == size and found is None:
                    found = frame.params
                else:
                    self._compare(frame)
        return found

    def _is_good_reply(self, frame: Frame) -> bool:
        return frame.id == self._id and frame.instruction == _STATUS and not frame.error & _REFUSED

    def _search(self, frames: Sequence[Frame]) -> Sample | None:
        """Return the sample in the frame that answers the waiting request; count all others."""
        found: Sample | None = None
        for frame in frames:
            asked, sample = self._asked, None
            own = self._is_good_reply(frame)
            if own and asked is not None and len(frame.params) == asked.length:
                sample = self._accepted(asked, bytes((frame.error,)) + frame.params)
            if sample is None:
                self._count_unmatched(frame)
            else:
                found = sample
        return found

    def _accepted(self, asked: SampleRequest, body: bytes) -> Sample | None:
        """Return the sample in a reply of the length of the waiting request, if it answers that.

        Args:
            asked: The request.
            body: Error byte and data.
        """
        error, tick, current, position = asked.layout.unpack_from(body)
        sent_ns = self._sent_ns
        if error & _REFUSED or not self._servo_clock.accept(tick, sent_ns, self._now_ns()):
            return None
        self._body = body
        self.counts.cycles += 1
        asked.free_at = self._number + 1  # not for the next request: a copy may follow
        self._asked = None
        return Sample(_OK, position, current, error != 0, sent_ns)

    def _give_up(self, outcome: Outcome) -> Sample:
        """Stop waiting for the last request, and keep its length out of use for a while.

        The rest of a reply that has begun may be in the adapter: it is lost now, and late when it
        comes. When another frame begins instead, it was truncated, and counts as broken.
        """
        counts, asked = self.counts, self._asked
        counts.cycles += 1
        self._undecided |= self._begun and not self._parser.idle and outcome is Outcome.LOST
        if outcome is Outcome.CORRUPT:
            counts.corrupt += 1
        else:
            counts.lost += 1
        if asked is not None:
            self._quarantine(asked)
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

    def _quarantine(self, asked: SampleRequest) -> None:
        """Stop waiting; the answer may still come, so its length is not used for a while."""
        asked.free_at = self._number + QUARANTINE
        self._asked = None

    def _count_unmatched(self, frame: Frame) -> None:
        """Count a sample that no request waits for, or a refusal (it does not name its request)."""
        if self._is_good_reply(frame):
            self.counts.late += len(frame.params) in self._requests
            self._compare(frame)
        elif frame.id == self._id and frame.error:
            self._refusals += 1

    def _compare(self, frame: Frame) -> None:
        """Compare a late or second reply with the answer in a block of the same length."""
        if not frame.params.startswith(self._eeprom.get(len(frame.params), b"")):
            self.twins = True
        asked = self._requests.get(len(frame.params))
        if asked is None:
            return
        layout = asked.layout
        _, tick, _, position = layout.unpack_from(bytes((frame.error,)) + frame.params)
        age_ns = self._servo_clock.age_ns(tick, self._now_ns())
        if self.longest_ns < age_ns < _LATEST_NS:
            self.longest_ns = age_ns
        if len(frame.params) != len(self._body) - 1:
            return
        _, last_tick, _, last_position = layout.unpack_from(self._body)
        ticks = (tick - last_tick + TICK_MODULUS // 2) % TICK_MODULUS - TICK_MODULUS // 2
        apart = abs(ticks) >= _TICKS_APART or abs(position - last_position) >= _COUNTS_APART
        if apart and self._odd_number != self._number:
            successive = self._odd_number == self._number - 1
            self._odd_cycles = self._odd_cycles + 1 if successive else 1
            self._odd_number = self._number
            self.twins |= self._odd_cycles >= PROOFS
