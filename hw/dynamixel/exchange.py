"""Exchanges samples and goal currents with the servos on a line; matches replies to requests.

All servos are read by one request, in the fastest way that they support, and commanded by one
frame. A servo that does not reply loses only its own reading.

The protocol has no sequence number, so a reply must be recognised as the answer to *this* request:
otherwise a loop that once misses a reply would from then on use the reply of the previous period.
Three cheap checks do it:

1. **Length.** Requests ask for the sample in blocks of different lengths (``Lengths``, 16 to 48
   bytes). A length whose request was not answered is not used again for the next 31 requests, so a
   late reply is recognised by its length, in any order of replies. Undisturbed, lengths alternate
   between 16 and 17.
2. **Time.** Bytes that arrived before the request was sent cannot be its answer.
3. **The servo's clock.** The block begins with the servo's millisecond tick, which must have
   advanced by the time that passed since the last accepted sample.

None of a request's answers is used if one bears a wrong id: one servo has two that differ, or an id
answers that was not asked, or not yet, or out of its turn. It is not known whose they are. One case
looks like a servo that only does not reply: a later servo answers under the id of one whose own
reply is lost. Its clock, and the jump of the position, tell all but equal servos apart.

A request may ask for a wider block around the sample, of a length that no other request has.
Registers are read in blocks of other sizes still; see ``register_access``.

Two lengths would not do: a reply two periods late has the right one. The clock alone cannot tell
periods of 1 ms. A late reply may arrive after the receive buffer was drained. The longer replies
cost 1.25 µs a cycle and servo at 4 Mbit/s.

The replies of an undisturbed bus are compared with a prepared pattern; all others are searched for.
In a fast sync read a missing servo silences those after it, so it is requested last from then on: a
servo with a bad cable costs the others a reading once, not each time.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from haptic_wall.hw.dynamixel.codec import Frame, Instruction, Parser, SyncWrite
from haptic_wall.hw.dynamixel.samples import (
    LENGTHS,
    Lengths,
    Sample,
    SampleRequest,
)
from haptic_wall.hw.dynamixel.station import Station
from haptic_wall.hw.dynamixel.wire import Read, wire_ns
from haptic_wall.hw.serialport.line import Line
from haptic_wall.hw.servo import Outcome

GOAL_CURRENT: Final = 102
REFUSED: Final = 0x7F
"""Bits of the error byte that say why a request was refused"""
_NO_TIME: Final = -1
_ATTEMPTS: Final = 3
_PATIENCE_NS: Final = 100_000_000
"""Time allowed for each where no torque waits for it [ns]"""
_OK: Final = Outcome.OK  # a lookup takes as long as making a sample


class Exchange:
    """Exchanges samples and goal currents with the servos on a line.

    Args:
        line: The bus.
        ids: Ids of the servos.
        baud: The bus's rate [bit/s], for the time that bytes take; 0: negligible.
    """

    def __init__(self, line: Line, ids: Sequence[int], *, baud: int = 0) -> None:
        self.line = line
        self.parser = Parser()
        self.lengths = Lengths()
        self.waited_ns = 0
        """Waiting time of the last ``collect`` [ns]"""
        self.kept = b""
        """Sent before an instruction to one servo: zero goals, so that no Bus Watchdog trips"""
        self._now_ns = line.clock.now_ns
        self._baud = baud
        self._asked: SampleRequest | None = None
        """The request that waits for its answers; None: none does"""
        self._turns = 0
        """How many servos may have answered it by now, the first of its order; of a fast read, how
        many parts have come"""
        self._missing: Sequence[Station] = ()
        """Servos whose answers it waits for"""
        self._found: dict[Station, Sample] = {}
        """Its answers"""
        self._doubted = False
        """One of its answers bears a wrong id"""
        self.sent_ns = 0
        """When the last request was sent [ns]"""
        self._broken = 0
        """Broken frames, and refusals, that had come when the last request was sent"""
        self._refusals = 0
        self.stations = [Station(id_) for id_ in ids]
        self.by_id = {station.id: station for station in self.stations}
        self.select(self.stations, "plain" if len(ids) == 1 else "sync")

    def select(self, stations: Sequence[Station], way: Read = "plain") -> None:
        """Exchange samples and goals with these servos from now on, in this order."""
        self.set_aside()
        self.way = way
        self._selected = tuple(stations)
        ids = [station.id for station in stations]
        self.parser.joint = len(ids) if way == "fast" else 0
        self._goals = SyncWrite(GOAL_CURRENT, ids)
        self._known: dict[int, bytes] | None = {} if len(ids) == 1 else None
        """The frames of a single servo by its goal; there are as many as current units"""
        self._arrange(self._selected)

    def wire_ns(self, count: int) -> int:
        """Return the time of ``count`` bytes on the wire [ns]."""
        return wire_ns(count, self._baud) if self._baud else 0

    def request(self, wide: int = 0, of: Station | None = None) -> None:
        """Request all samples. Does not wait; what is not yet answered is given up.

        Args:
            wide: Request the block of this length, see ``Lengths.widen``, which is free; 0: the
                sample only.
            of: The servo whose block this is; the others are asked for their sample.
        """
        if self._asked is not None:
            self._close(0)
        if stale := self.line.read():
            self._process(stale)
        length = self.lengths.begin(wide)
        asked = self._usual[length]
        if of is not None:
            of.block = b""
            block = self.lengths.blocks[wide], wide
            asked = SampleRequest(self.way, self._ids, length, (of.id, *block))
            self.lengths.keep(asked, 1)
        elif asked is None:
            asked = self._usual[length] = SampleRequest(self.way, self._ids, length)
        self._asked = asked
        self.parser.parts = asked.parts
        self._missing = self._order
        self._broken = self.parser.corrupt + self._refusals
        self._turns = {"fast": 0, "plain": 1}.get(self.way, len(self._order))
        self.sent_ns = self._now_ns()
        self.line.write(asked.frames[0])

    def collect(self, deadline_ns: int) -> list[Sample]:
        """Return the answers to the last request, waiting until ``deadline_ns`` [ns] at most.

        A later call discards a reply that comes later, and counts it as late.

        Raises:
            ServoLostError: The port is gone.
            RuntimeError: There was no request.
        """
        asked = self._asked
        if asked is None:
            raise RuntimeError("collect() without a request(): call request() first")
        order, expected, now_ns = self._missing, asked.expected, self._now_ns
        if expected is None or not self.parser.idle:
            self.waited_ns = 0
            return self._search(deadline_ns)
        began_ns = now_ns()
        come = self.line.wait(deadline_ns)
        received_ns = now_ns()
        self.waited_ns = received_ns - began_ns
        if not come:
            return self._search(_NO_TIME)
        data = self.line.read()
        values = expected.match(data)
        if values is not None:
            sent_ns = self.sent_ns
            samples: list[Sample] = []
            for station, (error, tick, current, position) in zip(order, values):  # noqa: B905 - quicker
                if error & REFUSED or not station.accept(tick, sent_ns, received_ns):
                    break
                samples.append(Sample(_OK, position, current, error != 0, sent_ns))
            else:
                for station in order:
                    station.counts.cycles += 1
                self._asked = None
                if self._places:
                    return [samples[place] for place in self._places]
                return samples
        self._process(data)
        late = began_ns >= deadline_ns  # a bus without a servo may never be silent
        return self._search(_NO_TIME if late else deadline_ns)

    def sampled(self) -> list[Sample]:
        """Return samples of all, if need be after several attempts, as no torque waits for them."""
        for _ in range(_ATTEMPTS):
            self.request()
            samples = self.collect(self._now_ns() + _PATIENCE_NS)
            if all(sample.outcome is _OK for sample in samples):
                break
        return samples

    def send(self, goals: Sequence[int]) -> None:
        """Send each its goal current, in its model's unit, in one frame without a reply."""
        known = self._known
        frame = known.get(goals[0]) if known is not None else None
        if frame is None:
            frame = self._goals.encode(goals)
            if known is not None:
                known[goals[0]] = frame
        self.line.write(frame)

    def rest(self) -> None:
        """Send all goals of zero."""
        self.send([0] * len(self._selected))

    def set_aside(self) -> None:
        """Discard the samples under way: registers are asked for, or other servos."""
        if self._asked is not None:
            self.lengths.keep(self._asked)
        self._asked = None
        self._missing = ()
        self._found, self._doubted = {}, False

    def _arrange(self, order: Sequence[Station]) -> None:
        """Request the selected servos in this order from now on."""
        self._order = order
        self._ids = [station.id for station in order]
        self._usual: dict[int, SampleRequest | None] = dict.fromkeys(LENGTHS)
        """The requests so far without a wider block, by length"""
        self._places: Sequence[int] = ()
        """Of each selected servo in the order; empty: it is their own"""
        if order != self._selected:
            self._places = [order.index(station) for station in self._selected]

    def _search(self, deadline_ns: int) -> list[Sample]:
        """Search what comes until ``deadline_ns`` [ns] for the replies; return the samples.

        Args:
            deadline_ns: ``_NO_TIME``: nothing more is read.
        """
        self._gather(deadline_ns)
        return self._close(self.parser.corrupt + self._refusals - self._broken)

    def _gather(self, deadline_ns: int) -> None:
        """Process received bytes until all have answered or time is up."""
        frames = [] if self._asked is None else self._asked.frames
        if len(frames) <= 1:
            return self._listen(deadline_ns, self._order)
        for number, (station, frame) in enumerate(zip(self._order, frames, strict=True)):
            if number:
                self._turns = number + 1
                self.line.write(frame)
            now_ns = self._now_ns()
            self._listen(now_ns + (deadline_ns - now_ns) // (len(frames) - number), [station])
        return None

    def _listen(self, deadline_ns: int, wanted: Sequence[Station]) -> None:
        """Process received bytes until these have answered or time is up."""
        line, now_ns = self.line, self._now_ns
        began_ns = _NO_TIME
        while began_ns < deadline_ns and any(one in self._missing for one in wanted):
            began_ns = now_ns()
            come = line.wait(deadline_ns)
            self.waited_ns += now_ns() - began_ns
            if not come:
                break
            self._process(line.read())

    def _process(self, data: bytes) -> None:
        """Search received bytes for replies."""
        for frame in self.parser.feed(data):
            if frame.instruction != Instruction.STATUS:
                continue
            station = self.by_id.get(frame.id)
            self._turns += self.way == "fast" and self._answers(frame)
            if station is not None and frame.error & REFUSED:  # it does not name its request
                self._refusals += 1
            elif self._is_misnamed(frame, station):
                self._doubted = True
                for one in self._found:
                    one.counts.cycles -= 1
                self._missing, self._found = [*self._found, *self._missing], {}
            elif station is None:
                continue
            elif station not in self._missing or not self._accepts(station, frame):
                station.counts.late += len(frame.params) in self.lengths.blocks

    def _answers(self, frame: Frame) -> bool:
        """Whether a frame has the length of an answer to the waiting request."""
        return self._asked is not None and len(frame.params) in self._asked.used

    def _is_misnamed(self, frame: Frame, station: Station | None) -> bool:
        """Whether this answer to the waiting request, or one before it, bears a wrong id."""
        asked, found = self._asked, self._found
        if asked is None or not self._answers(frame):
            return False
        if station is None or frame.id not in asked.blocks:
            return True
        if asked.unpack(frame.id, frame.params) is None:
            return False
        if station in found:
            return frame.params != station.block  # else a copy
        order = self._order
        place, last = order.index(station), next(reversed(found), None)
        if self.way == "fast":  # no part follows a lost one
            return place != self._turns - 1
        return place >= self._turns or (last is not None and place < order.index(last))

    def _accepts(self, station: Station, frame: Frame) -> bool:
        """Take a frame as a servo's answer to the waiting request, if it is that."""
        asked, data = self._asked, frame.params
        found = None if asked is None else asked.unpack(station.id, data)
        if found is None or self._doubted:
            return False
        tick, current, position = found
        sent_ns = self.sent_ns
        if not station.accept(tick, sent_ns, self._now_ns()):
            return False
        station.block = data
        station.counts.cycles += 1
        self._found[station] = Sample(_OK, position, current, frame.error != 0, sent_ns)
        self._missing = [each for each in self._missing if each is not station]
        return True

    def _close(self, broken: int) -> list[Sample]:
        """Stop waiting for the last request; return its samples.

        Args:
            broken: Number of broken replies that have come; none after a broken part of a joint
                reply is valid.
        """
        missing, asked = self._missing, self._asked
        joint = self.way == "fast"
        lost: dict[Station, Sample] = {}
        for place, station in enumerate(missing):
            corrupt = place < broken or (joint and broken > 0)
            counts = station.counts
            counts.cycles += 1
            counts.corrupt += corrupt
            counts.lost += not corrupt
            outcome = Outcome.CORRUPT if corrupt else Outcome.LOST
            lost[station] = Sample(outcome, 0, 0, False, self.sent_ns)
        if asked is not None and missing:
            self.lengths.keep(asked)
        self._asked, self._missing = None, ()
        heard = [station for station in self._order if station not in lost]
        order = (*heard, *missing[1:], *missing[:1])
        if order != self._order:
            self._arrange(order)
        found, self._found, self._doubted = self._found, {}, False
        return [lost.get(each) or found[each] for each in self._selected]
