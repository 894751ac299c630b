"""Samples of several servos in one cycle: by fast sync read, by sync read, or one by one.

A servo that does not answer costs its own reading alone. In a fast sync read every servo appends
its share to one frame, each with a checksum over all before it, so shares in front of a missing one
are whole. Those behind it are never sent: so a servo that has not answered is asked last.

Replies are matched to requests as ``link`` does it: by a length that changes, and by each servo's
own clock. Of several that do not answer another is asked first each time, or those behind it would
never be heard again.

What a quiet bus repeats is prepared: the requests, what their joint reply must look like, and all
but the values of the goals.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from enum import Enum
from typing import Final

from hw.dynamixel.codec import (
    BROADCAST,
    ExpectedFastReply,
    FastReply,
    Frame,
    Instruction,
    Parser,
    SyncWrite,
    crc16,
    decode_fast_status,
    encode,
)
from hw.dynamixel.line import Line
from hw.dynamixel.samples import LENGTHS, QUARANTINE, SAMPLE, SAMPLE_ADDRESS, Sample, ServoClock
from hw.servo import BusCounts, Outcome

_GOAL_CURRENT: Final = 102
_GONE: Final = 3
"""Readings lost in a row after which a servo is not waited for as long"""
_GRACE_NS: Final = 200_000
"""How long those are waited for when all others have answered"""
_FAST_HEAD: Final = b"\xff\xff\xfd\x00\xfe"
_FAST_HEAD_BYTES: Final = 8
_PREAMBLE: Final = 7
_SHARE: Final = "BxH4xh4xi"
"""Of a joint reply, what is used of a servo's: error, tick, current and position"""


class Way(Enum):
    """How several servos are read, from the quickest."""

    FAST = Instruction.FAST_SYNC_READ
    """One request, one joint reply; firmware 45 or later, X330 46"""
    SYNC = Instruction.SYNC_READ
    """One request, a reply of each"""
    PLAIN = Instruction.READ
    """A request and a reply of each"""


class Together:
    """The samples and goal currents of several servos on one line.

    Args:
        line: The bus.
        ids: Whose; readings and goals are in this order.
        way: How they are read.
    """

    def __init__(self, line: Line, ids: Sequence[int], way: Way) -> None:
        self.way = way
        self.counts = [BusCounts() for _ in ids]
        """What happened to each servo's readings"""
        self.waited_ns = 0
        """How long the last ``collect`` waited for bytes [ns]"""
        self._line = line
        self._now_ns = line.clock.now_ns
        self._ids = tuple(ids)
        self._parser = Parser()
        self._clocks = {id_: ServoClock() for id_ in ids}
        self._unheard = dict.fromkeys(ids, 0)
        """Readings lost in a row, by its own fault"""
        self._order = self._ids
        self._free_at = dict.fromkeys(LENGTHS, 0)
        self._number = 0
        self._length = 0
        """Of the request that waits for its answers; 0: none does"""
        self._sent_ns: dict[int, int] = {}
        self._found: dict[int, Sample] = {}
        self._broken: set[int] = set()
        self._raw = bytearray()
        """What has come of a joint reply"""
        self._goals = SyncWrite(_GOAL_CURRENT, self._ids)
        self._all_heard = True
        """None of them stays away, so they are asked in the order of ids"""
        self._requests = {size: self._request_frame(size, self._ids) for size in LENGTHS}
        self._expected = {size: _Expected(self._ids, size) for size in LENGTHS}

    @property
    def restarted(self) -> list[int]:
        """Ids of those whose clock runs on from another reading: they have restarted."""
        return [id_ for id_, clock in self._clocks.items() if clock.restarted]

    def request(self) -> None:
        """Ask all for a sample. Does not wait; a request not yet collected is given up.

        Raises:
            ServoLostError: The port is gone.
        """
        if self._length:
            self._close()
        if stale := self._line.read():
            for frame in self._parser.feed(stale):
                self._count_late(frame)
        self._parser.reset()
        self._raw.clear()
        self._found.clear()
        self._broken.clear()
        number = self._number
        for size, free_at in self._free_at.items():
            if free_at <= number:
                break
        self._length = size
        self._number = number + 1
        if self._all_heard:
            self._order = self._ids
            frame = self._requests[size]
        else:
            self._order = self._by_silence()
            frame = self._request_frame(size, self._order)
        self._sent_ns = dict.fromkeys(self._ids, self._now_ns())
        self._line.write(frame)

    def collect(self, deadline_ns: int) -> list[Sample]:
        """The answers to the last request, waiting until ``deadline_ns`` [ns] at most.

        Raises:
            ServoLostError: The port is gone.
            RuntimeError: There was no request.
        """
        if not self._length:
            raise RuntimeError("collect() without a request(): call request() first")
        self.waited_ns = 0
        if self.way is Way.PLAIN:
            self._collect_one_by_one(deadline_ns)
        else:
            self._gather(self._order, deadline_ns)
        return self._close()

    def send_currents(self, goals: Sequence[int]) -> None:
        """Send each its goal current, in its model's unit, in one frame that is never answered.

        Raises:
            ServoLostError: The port is gone.
        """
        self._line.write(self._goals.encode(goals))

    def _request_frame(self, size: int, order: Sequence[int]) -> bytes:
        """The request for so many bytes; of the first alone where they are asked one by one."""
        block = struct.pack("<HH", SAMPLE_ADDRESS, size)
        if self.way is Way.PLAIN:
            return encode(order[0], Instruction.READ, block)
        return encode(BROADCAST, self.way.value, block + bytes(order))

    def _by_silence(self) -> tuple[int, ...]:
        """Who answers first, then who does not, these by turns."""
        silent = [id_ for id_ in self._ids if self._unheard[id_]]
        turn = self._number % len(silent)
        heard = (id_ for id_ in self._ids if not self._unheard[id_])
        return (*heard, *silent[turn:], *silent[:turn])

    def _collect_one_by_one(self, deadline_ns: int) -> None:
        """Each in turn; who answers is not kept waiting by who does not."""
        block = struct.pack("<HH", SAMPLE_ADDRESS, self._length)
        share_ns = (deadline_ns - self._now_ns()) // len(self._order)
        for place, id_ in enumerate(self._order):
            now_ns = self._now_ns()
            if place:
                self._sent_ns[id_] = now_ns
                self._line.write(encode(id_, Instruction.READ, block))
            self._gather((id_,), min(deadline_ns, now_ns + share_ns))

    def _gather(self, ids: Sequence[int], deadline_ns: int) -> None:
        """Take in what comes until all of ``ids`` have answered or time is up."""
        line, now_ns = self._line, self._now_ns
        fast = self.way is Way.FAST
        patient = [id_ for id_ in ids if self._unheard[id_] < _GONE]
        end_ns = deadline_ns
        while True:
            began_ns = now_ns()
            come = line.wait(end_ns)
            self.waited_ns += now_ns() - began_ns
            if not come:
                return
            data = line.read()
            if fast:
                if self._take_expected(data):
                    return
                self._raw += data
                self._take_joint_reply()
            else:
                for frame in self._parser.feed(data):
                    self._take_frame(frame)
            if all(id_ in self._found or id_ in self._broken for id_ in ids):
                return
            if patient and all(id_ in self._found for id_ in patient):
                end_ns = min(deadline_ns, now_ns() + _GRACE_NS)
                patient = []
            if began_ns >= end_ns:  # a bus without a servo may never be silent
                return

    def _take_expected(self, data: bytes) -> bool:
        """Whether ``data`` is just the joint reply, in the usual order, of all and accepted."""
        expected = self._expected[self._length]
        if self._raw or not self._all_heard or not expected.reply.match(data):
            return False
        values = expected.layout.unpack(data)
        sent_ns = self._sent_ns[self._ids[0]]
        found = self._found
        for id_, clock, error, tick, current, position in zip(
            self._ids,
            self._clocks.values(),
            values[::4],
            values[1::4],
            values[2::4],
            values[3::4],
            strict=True,
        ):
            if not error & 0x7F and clock.accept(tick, sent_ns):
                found[id_] = Sample(Outcome.OK, position, current, error != 0, sent_ns)
            else:
                self._broken.add(id_)
        return True

    def _take_joint_reply(self) -> None:
        """The shares in what has come so far of a fast sync read's reply."""
        size = self._length
        length = 1 + len(self._order) * (size + 4)
        head = _FAST_HEAD + struct.pack("<HB", length, Instruction.STATUS)
        at = self._raw.find(head)
        if at < 0:
            return
        reply = bytes(self._raw[at : at + _PREAMBLE + length])
        whole = len(reply) == _PREAMBLE + length
        if whole and crc16(reply[:-2]) == reply[-2] | reply[-1] << 8:
            frame = Frame(BROADCAST, Instruction.STATUS, reply[8], reply[9:-2])
            shares = decode_fast_status(frame, size)
        else:
            shares = _shares_in_front(reply, size)
        for id_, share in zip(self._order, shares, strict=False):
            if share.id == id_:
                self._take(id_, share.error, share.data)
        if whole:
            self._broken.update(id_ for id_ in self._order if id_ not in self._found)

    def _take_frame(self, frame: Frame) -> None:
        """A reply of one servo."""
        if frame.instruction != Instruction.STATUS or frame.id not in self._clocks:
            return
        if len(frame.params) == self._length:
            self._take(frame.id, frame.error, frame.params)
        else:
            self._count_late(frame)

    def _take(self, id_: int, error: int, data: bytes) -> None:
        """A servo's answer, if it is one and its clock agrees."""
        if id_ in self._found:
            return
        if error & 0x7F or len(data) != self._length:
            self._broken.add(id_)
            return
        tick, _, current, _, position = SAMPLE.unpack_from(data)
        sent_ns = self._sent_ns[id_]
        if self._clocks[id_].accept(tick, sent_ns):
            self._found[id_] = Sample(Outcome.OK, position, current, error != 0, sent_ns)

    def _close(self) -> list[Sample]:
        """Stop waiting; the samples in the order of ids."""
        samples = []
        whole = True
        cut = bool(self._raw) or self._parser.corrupt > 0
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
        if not whole or not self._all_heard:
            self._blame()
        # A late reply, or a copy, must not meet a request of its own length.
        self._free_at[self._length] = self._number + (1 if whole and not cut else QUARANTINE)
        self._length = 0
        return samples

    def _blame(self) -> None:
        """Who was not heard; behind the first one missing in a joint reply, nobody could be."""
        for id_ in self._order:
            if id_ in self._found:
                self._unheard[id_] = 0
                continue
            self._unheard[id_] += 1
            if self.way is Way.FAST:
                break
        self._all_heard = not any(self._unheard.values())

    def _count_late(self, frame: Frame) -> None:
        for id_, counts in zip(self._ids, self.counts, strict=True):
            if frame.id == id_ and len(frame.params) in LENGTHS:
                counts.late += 1


class _Expected:
    """How a joint reply must look when all is well, and where in it what is."""

    __slots__ = ("layout", "reply")

    def __init__(self, ids: Sequence[int], size: int) -> None:
        self.reply = ExpectedFastReply(ids, size)
        rest = size - SAMPLE.size + 2  # unused bytes, and the share's CRC
        self.layout = struct.Struct(f"<{_FAST_HEAD_BYTES}x" + f"{_SHARE}{rest}x" * len(ids))


def _shares_in_front(reply: bytes, size: int) -> list[FastReply]:
    """The shares of a joint reply whose own checksum holds, up to the first that is not whole."""
    shares = []
    at = _FAST_HEAD_BYTES
    crc = crc16(reply[:at])
    while at + size + 4 <= len(reply):
        end = at + size + 4
        crc = crc16(reply[at : end - 2], crc)
        if crc != reply[end - 2] | reply[end - 1] << 8:
            break
        shares.append(FastReply(reply[at + 1], reply[at], reply[at + 2 : end - 2]))
        crc = crc16(reply[end - 2 : end], crc)
        at = end
    return shares
