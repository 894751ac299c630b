"""Exchanges samples and goals with several servos in one cycle, in the fastest way they support.

A servo that does not reply loses only its own reading. In a fast sync read every servo appends its
part to one frame, each with a checksum over all before it, so parts before a missing one are valid.
Those after it are never sent: so a servo that has not replied is requested last.

Replies are matched to requests as in ``link``: by a changing length, and by each servo's own clock;
late or repeated ones are counted for each servo whose part is valid.

The frames of an undisturbed bus are prepared: the requests, the pattern of their joint reply, and
all but the values of the goals.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from enum import Enum
from typing import Final

from haptic_wall.hw.dynamixel.codec import BROADCAST, Frame, Instruction, Parser, SyncWrite, encode
from haptic_wall.hw.dynamixel.joint_reply import JointReply, joint_bytes, shares, spoilt, strays
from haptic_wall.hw.dynamixel.samples import (
    LENGTHS,
    QUARANTINE,
    SAMPLE,
    SAMPLE_ADDRESS,
    Sample,
    ServoClock,
)
from haptic_wall.hw.dynamixel.turns import Turns
from haptic_wall.hw.serialport.line import Line
from haptic_wall.hw.servo import BusCounts, Outcome

_GOAL_CURRENT: Final = 102
_GRACE_NS: Final = 200_000
"""Additional wait for missing servos when all others have replied"""
_OK: Final = Outcome.OK  # a lookup takes as long as making a sample


class Way(Enum):
    """Ways to read several servos, from the fastest."""

    FAST = Instruction.FAST_SYNC_READ
    """One request, one joint reply; firmware 45 or later, X330 46"""
    SYNC = Instruction.SYNC_READ
    """One request, a reply of each"""
    PLAIN = Instruction.READ
    """A request and a reply of each"""


class Together:
    """Exchanges the samples and goal currents of several servos on one line.

    Args:
        line: The bus.
        ids: Ids of the servos; readings and goals are in this order.
        way: How they are read.
    """

    def __init__(self, line: Line, ids: Sequence[int], way: Way) -> None:
        self.way = way
        self.counts = [BusCounts() for _ in ids]
        """Counts of each servo's readings"""
        self.waited_ns = 0
        """Waiting time of the last ``collect`` [ns]"""
        self._line = line
        self._now_ns = line.clock.now_ns
        self._ids = tuple(ids)
        self._parser = Parser(joint=False)
        self._clocks = {id_: ServoClock() for id_ in ids}
        self._turns = Turns(ids)
        self._order = self._ids
        self._free_at = dict.fromkeys(LENGTHS, 0)
        self._number = 0
        self._length = 0
        """Of the request that waits for its answers; 0: none does"""
        self._sent_ns: dict[int, int] = {}
        self._found: dict[int, Sample] = {}
        self._broken: set[int] = set()
        self._raw = bytearray()
        """Received bytes of a joint reply"""
        self._begun: tuple[int, ...] = ()
        """Servos whose parts of it have come, partial ones included"""
        self._corrupt_before = 0
        """The parser's count before the last request"""
        self._goals = SyncWrite(_GOAL_CURRENT, self._ids)
        self._requests = {size: self._request_frame(size, self._ids) for size in LENGTHS}
        self._expected = {size: JointReply(self._ids, size) for size in LENGTHS}

    @property
    def restarted(self) -> list[int]:
        """Return ids of servos that have restarted: no stall explains their clock."""
        return [id_ for id_, clock in self._clocks.items() if clock.restarted]

    def request(self) -> None:
        """Request all samples. Does not wait; a request not yet collected is given up.

        Raises:
            ServoLostError: The port is gone.
        """
        if self._length:
            self._close()
        if stale := self._line.read():
            self._count_stale(stale)
        self._parser.reset()
        self._corrupt_before = self._parser.corrupt
        self._raw.clear()
        self._begun = ()
        self._found.clear()
        self._broken.clear()
        number = self._number
        size = LENGTHS.start  # found in two steps on an undisturbed bus
        while self._free_at[size] > number:
            size += 1
        self._length = size
        self._number = number + 1
        if self._turns.all_heard:
            self._order = self._ids
            request = self._requests[size]
        else:
            self._order = self._turns.order(number)
            request = self._request_frame(size, self._order)
        self._sent_ns = dict.fromkeys(self._ids, self._now_ns())
        self._line.write(request)

    def collect(self, deadline_ns: int) -> list[Sample]:
        """Return the answers to the last request, waiting until ``deadline_ns`` [ns] at most.

        Raises:
            ServoLostError: The port is gone.
            RuntimeError: There was no request.
        """
        if not self._length:
            raise RuntimeError("collect() without a request(): call request() first")
        self.waited_ns = 0
        if self.way is Way.PLAIN:
            self._collect_one_by_one(deadline_ns)
            return self._close()
        if self.way is Way.FAST and self._turns.all_heard:
            data = self._next(deadline_ns)
            if data is None:
                return self._close()
            samples = self._take_expected(data)
            if samples is not None:
                return samples
            self._take_in(data)
        self._gather(self._order, deadline_ns)
        return self._close()

    def send_currents(self, goals: Sequence[int]) -> None:
        """Send each its goal current, in its model's unit, in one frame without a reply.

        Raises:
            ServoLostError: The port is gone.
        """
        self._line.write(self._goals.encode(goals))

    def _request_frame(self, size: int, order: Sequence[int]) -> bytes:
        """Return the request for ``size`` bytes; of the first servo only in mode ``PLAIN``."""
        block = struct.pack("<HH", SAMPLE_ADDRESS, size)
        if self.way is Way.PLAIN:
            return encode(order[0], Instruction.READ, block)
        return encode(BROADCAST, self.way.value, block + bytes(order))

    def _collect_one_by_one(self, deadline_ns: int) -> None:
        """Collect each in turn; a missing servo does not delay the others."""
        block = struct.pack("<HH", SAMPLE_ADDRESS, self._length)
        share_ns = (deadline_ns - self._now_ns()) // len(self._order)
        for place, id_ in enumerate(self._order):
            now_ns = self._now_ns()
            if place:
                self._sent_ns[id_] = now_ns
                self._line.write(encode(id_, Instruction.READ, block))
            self._gather((id_,), min(deadline_ns, now_ns + share_ns))
            self._parser.reset()  # a partial frame is no part of the next one's answer

    def _next(self, deadline_ns: int) -> bytes | None:
        """Return the next bytes; None: none come until ``deadline_ns``."""
        began_ns = self._now_ns()
        come = self._line.wait(deadline_ns)
        self.waited_ns += self._now_ns() - began_ns
        return self._line.read() if come else None

    def _gather(self, ids: Sequence[int], deadline_ns: int) -> None:
        """Process received bytes until all of ``ids`` have replied or time is up."""
        now_ns = self._now_ns
        broken = self._parser.corrupt
        patient = self._turns.expected(ids)
        end_ns = deadline_ns
        while not self._settled(ids):
            if patient and all(id_ in self._found for id_ in patient):
                end_ns = min(deadline_ns, now_ns() + _GRACE_NS)
                patient = []
            began_ns = now_ns()
            data = self._next(end_ns)
            if data is not None:
                self._take_in(data)
            if data is None or began_ns >= end_ns:  # a noisy bus may never be silent
                break
        if self.way is not Way.FAST:
            self._lay_to(ids, self._parser.corrupt - broken + (not self._parser.idle))

    def _settled(self, ids: Sequence[int]) -> bool:
        return all(id_ in self._found or id_ in self._broken for id_ in ids)

    def _lay_to(self, ids: Sequence[int], count: int) -> None:
        """Count broken replies as those of the first missing servos."""
        missing = [id_ for id_ in ids if id_ not in self._found and id_ not in self._broken]
        self._broken.update(missing[:count])

    def _take_in(self, data: bytes) -> None:
        """Process received bytes."""
        if self.way is Way.FAST:
            self._raw += data
            self._take_joint_reply()
        else:
            for frame in self._parser.feed(data):
                self._take_frame(frame)

    def _take_expected(self, data: bytes) -> list[Sample] | None:
        """Return the samples if ``data`` is exactly the joint reply of all; None otherwise."""
        values = self._expected[self._length].values(data)
        if values is None:
            return None
        sent_ns = self._sent_ns[self._ids[0]]
        now_ns = self._now_ns()
        found = self._found
        for (id_, clock), error, tick, current, position in zip(
            self._clocks.items(), values, values, values, values, strict=False
        ):
            if not error & 0x7F and clock.accept(tick, sent_ns, now_ns):
                found[id_] = Sample(_OK, position, current, error != 0, sent_ns)
            else:
                self._broken.add(id_)
        if self._broken:
            return self._close()
        for counts in self.counts:
            counts.cycles += 1
        self._free_at[self._length] = self._number + 1
        self._length = 0
        return list(found.values())

    def _take_joint_reply(self) -> None:
        """Process the received parts of a fast sync read's reply."""
        come = shares(self._raw, len(self._order), self._length)
        for id_, share in zip(self._order, come.good, strict=False):
            if share.id == id_ and id_ not in self._broken:
                self._take(id_, share.error, share.data)
                if id_ not in self._found:
                    self._broken.add(id_)
        self._begun = self._order[: come.begun]
        if come.whole:
            self._broken_off()

    def _broken_off(self) -> None:
        """Give up a partial reply that can no longer be completed."""
        self._broken.update(id_ for id_ in self._begun if id_ not in self._found)

    def _take_frame(self, frame: Frame) -> None:
        """Process a reply of one servo."""
        if frame.instruction != Instruction.STATUS or frame.id not in self._clocks:
            return
        refused = frame.error & 0x7F != 0  # it does not name its request, and has no data
        if refused or (len(frame.params) == self._length and frame.id not in self._found):
            self._take(frame.id, frame.error, frame.params)
        elif len(frame.params) in LENGTHS:
            self._count_late(frame.id)

    def _take(self, id_: int, error: int, data: bytes) -> None:
        """Process a servo's answer, if it is one and its clock agrees."""
        if id_ in self._found:
            return
        if error & 0x7F or len(data) != self._length:
            self._broken.add(id_)
            return
        tick, _, current, _, position = SAMPLE.unpack_from(data)
        sent_ns = self._sent_ns[id_]
        if self._clocks[id_].accept(tick, sent_ns, self._now_ns()):
            self._found[id_] = Sample(Outcome.OK, position, current, error != 0, sent_ns)

    def _close(self) -> list[Sample]:
        """Stop waiting; return the samples in the order of ids."""
        samples = []
        whole = True
        if self._raw:
            self._sort_out_the_rest()
        cut = bool(self._raw) or self._parser.corrupt > self._corrupt_before
        self._broken_off()
        for id_, counts in zip(self._ids, self.counts, strict=True):
            counts.cycles += 1
            found = self._found.get(id_)
            if found is None:
                whole = False
                corrupt = id_ in self._broken
                counts.corrupt += corrupt
                counts.lost += not corrupt
                outcome = Outcome.CORRUPT if corrupt else Outcome.LOST
                found = Sample(outcome, 0, 0, False, self._sent_ns[id_])
            samples.append(found)
        if not whole or not self._turns.all_heard:
            self._turns.heard(self._order, self._found, chained=self.way is Way.FAST)
        # A late reply, or a copy, must not coincide with a request of its own length.
        self._free_at[self._length] = self._number + (1 if whole and not cut else QUARANTINE)
        self._length = 0
        return samples

    def _sort_out_the_rest(self) -> None:
        """Process bytes beside the awaited joint reply, or in place of it."""
        raw, size, count = self._raw, self._length, len(self._ids)
        if len(self._found) == count and len(raw) == joint_bytes(count, size):
            return
        late = [share.id for share in strays(raw, count, size)]
        for id_ in late:
            self._count_late(id_)
        if not late and not self._begun:
            self._begun = self._order[: spoilt(raw, size)]

    def _count_stale(self, data: bytes) -> None:
        """Count replies that come after they were given up."""
        if self.way is Way.FAST:
            for share in strays(data, len(self._ids), 0):
                self._count_late(share.id)
            return
        for frame in self._parser.feed(data):
            if frame.instruction == Instruction.STATUS and len(frame.params) in LENGTHS:
                self._count_late(frame.id)

    def _count_late(self, whose: int) -> None:
        for id_, counts in zip(self._ids, self.counts, strict=True):
            counts.late += id_ == whose
