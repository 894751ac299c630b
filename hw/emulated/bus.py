"""The emulated bus: takes and gives bytes at given times, as on one half-duplex wire.

It has no clock: the caller gives the time, in nanoseconds that never decrease. Between two calls
every event happens at its own instant. So a late server delays replies only, and a test in memory
repeats a fault of the terminal to the byte.

There is one wire. A byte takes ten bit times. An instruction takes effect when its last byte has
arrived; a reply can be read when its last byte has, unless an adapter holds it back. Bytes sent
while the wire is busy wait for it (on a real bus they would collide).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Sequence
from typing import Final

from haptic_wall.hw.dynamixel.codec import BROADCAST, Frame, Parser
from haptic_wall.hw.dynamixel.wire import wire_ns
from haptic_wall.hw.emulated.adapter import BLOCKS, Adapter
from haptic_wall.hw.emulated.answers import addressed, answer
from haptic_wall.hw.emulated.faults import Fault, parse_fault
from haptic_wall.hw.emulated.injection import SILENCING, FaultEvent, Faults, apply_fault
from haptic_wall.hw.emulated.servo import EmulatedServo
from haptic_wall.hw.emulated.traffic import (
    Answer,
    Part,
    Piece,
    Reply,
    id_of,
    instruction_of,
    pieces,
)
from haptic_wall.hw.emulated.witness import Event, Witness
from haptic_wall.hw.plant.arm import couple
from haptic_wall.hw.truth import TrueArm

GAP_NS = 1_500_000
"""After a longer silence inside a frame servos wait for a new header [ns]"""
MAX_WAITING = 64
"""Frames of the host that may wait for the wire before the bus is ``full``"""
STATE_NS = 1_000_000
"""Period of the records of the state [ns]"""

_NEVER_NS: Final = 1 << 62
_FAULT, _WATCHDOG, _BEGIN, _REPLY, _INSTRUCTION, _STATE = range(6)
"""Kinds of events; of simultaneous events the lower kinds come first"""


class EmulatedBus:
    """Servos on a wire.

    Args:
        servos: The servos on the bus.
        baud: Baud rate of the host [bit/s]; ``host_baud`` changes it. Servos with another baud rate
            neither receive nor are received.
        start_ns: Start time [ns].
        witness: Records every event; None: no record.
        adapter: Buffers the bytes to the host; None: one that hands replies over on arrival.
        faults: Faults from the beginning.
        arm: The links between the servos; None: there are none.

    Raises:
        ValueError: A fault is for an id that no servo has, or the servos cannot be the joints of
            this arm.
    """

    def __init__(
        self,
        servos: Sequence[EmulatedServo],
        *,
        baud: int,
        start_ns: int,
        witness: Witness | None = None,
        adapter: Adapter | None = None,
        faults: Faults | None = None,
        arm: TrueArm | None = None,
    ) -> None:
        self.servos = tuple(servos)
        couple(arm, [servo.mechanism for servo in servos])
        for servo in servos:
            servo.drive.together = tuple(each.drive for each in servos)
        self.host_baud = baud
        self.connected = True
        """The adapter is plugged in at the host"""
        self.times_unplugged = 0
        """How often it has been unplugged"""
        self._witness = witness
        self._adapter = Adapter(0, BLOCKS[-1], start_ns) if adapter is None else adapter
        self._faults = Faults() if faults is None else faults
        self._parser = Parser(report_crc=True, unstuffed=True)
        self._coming: deque[Piece] = deque()
        self._going: deque[Reply] = deque()
        self._begun = False
        """The first of those is on the wire"""
        self._free_ns = start_ns
        """When the wire is free again"""
        self._heard_ns = start_ns
        """When the last byte from the host arrived"""
        self._state_ns = start_ns
        for fault in self._faults.at_start:
            self._add(fault, start_ns)

    @property
    def busy(self) -> bool:
        """Whether bytes are on their way, so that the next event must be met on time."""
        return self._adapter.holds or bool(self._coming or self._going)

    @property
    def full(self) -> bool:
        """Whether more bytes wait for the wire than a serial port would take."""
        return len(self._coming) >= MAX_WAITING

    @property
    def faults(self) -> list[tuple[str, int]]:
        """Return the active faults, and how often each has occurred."""
        return self._faults.describe()

    def inject(self, spec: str, now_ns: int) -> None:
        """Activate a fault from ``now_ns`` [ns] on; its times count from now.

        Args:
            spec: See ``parse_fault``.
            now_ns: The time [ns].

        Raises:
            ValueError: It is no fault, or for an id that no servo has.
        """
        self._run(now_ns)
        self._add(parse_fault(spec), now_ns)

    def lift(self, name: str, now_ns: int) -> bool:
        """End every fault of this name; return whether there was one."""
        self._run(now_ns)
        over = self._faults.lift(name)
        for event in over or ():
            self._apply(event, now_ns)
        return over is not None

    def receive(self, data: bytes, now_ns: int) -> None:
        """Put bytes from the host on the wire at ``now_ns`` [ns]."""
        self._run(now_ns)
        if not self.connected:
            return
        for piece in pieces(data):
            if self._faults.strikes_frames:
                self._send_damaged(piece, now_ns)
            else:
                self._put(piece, now_ns, len(piece))

    def transmit(self, now_ns: int) -> bytes:
        """Return the bytes that the host can read by ``now_ns`` [ns] since the last call."""
        self._run(now_ns)
        return self._adapter.take(now_ns)

    def next_event_ns(self, until_ns: int = _NEVER_NS) -> int | None:
        """Return the time of the next event if the host sends nothing [ns]; None: no event.

        Args:
            until_ns: An event after this time may be left out [ns].
        """
        time_ns, _ = self._next(until_ns)
        handed_ns = self._adapter.next_ns()
        if handed_ns is not None and handed_ns < time_ns:
            return handed_ns
        return None if time_ns == _NEVER_NS else time_ns

    def _next(self, until_ns: int) -> tuple[int, int]:
        """Return time and kind of the next event; one after ``until_ns`` [ns] may be left out."""
        time_ns, kind = _NEVER_NS, _STATE
        fault_ns = self._faults.next_ns()
        if fault_ns is not None:
            time_ns, kind = fault_ns, _FAULT
        for servo in self.servos:
            if servo.watchdog_from_ns > until_ns:  # most often; asking more takes longer
                continue
            watchdog_ns = servo.watchdog_ns
            if watchdog_ns is not None and watchdog_ns < time_ns:
                time_ns, kind = watchdog_ns, _WATCHDOG
        if self._going:
            reply = self._going[0]
            reply_ns = reply.end_ns if self._begun else reply.begin_ns
            if reply_ns < time_ns:
                time_ns, kind = reply_ns, _REPLY if self._begun else _BEGIN
        if self._coming:
            piece = self._coming[0]
            through_ns = max(piece.arrival_ns, self._free_ns) + piece.wire_ns
            if through_ns < time_ns:
                time_ns, kind = through_ns, _INSTRUCTION
        if self._witness is not None and self._state_ns < time_ns:
            time_ns, kind = self._state_ns, _STATE
        return time_ns, kind

    def _run(self, now_ns: int) -> None:
        """Process every event up to ``now_ns``, in order of time."""
        while True:
            time_ns, kind = self._next(now_ns)
            if time_ns > now_ns:
                return
            if kind == _INSTRUCTION:
                self._take(self._coming.popleft(), time_ns)
            elif kind == _REPLY:
                self._leave(self._going.popleft(), time_ns)
            elif kind == _BEGIN:
                self._begin(self._going[0])
            elif kind == _STATE:
                for servo in self.servos:
                    self._note(time_ns, "state", servo.id, servo)
                self._state_ns += STATE_NS
            elif kind == _WATCHDOG:
                for servo in self.servos:
                    if servo.watchdog_ns == time_ns:
                        servo.trip_watchdog(time_ns)
            else:
                self._apply(self._faults.take_event(time_ns), time_ns)

    def _put(self, data: bytes, arrival_ns: int, count: int) -> None:
        """Put bytes on the wire, for the duration of ``count`` bytes."""
        duration_ns = wire_ns(count, self.host_baud)
        self._coming.append(Piece(arrival_ns, duration_ns, self.host_baud, data))

    def _send_damaged(self, piece: bytes, now_ns: int) -> None:
        """Put bytes from the host on the wire, as the faults leave them."""
        passage = self._faults.pass_frame([Part(id_of(piece), piece)], "request", now_ns)
        for id_, name in passage.names:
            shown, code = BROADCAST if id_ is None else id_, instruction_of(piece)
            self._note(now_ns, "fault", shown, id_, code=code, fault=name)
        arrival_ns = now_ns + sum(late_ns for _, late_ns in passage.gaps)
        heard = [chunk for chunk in passage.chunks if chunk]
        for chunk in heard:
            self._put(chunk, arrival_ns, len(chunk))
        if missing := max(0, len(piece) - sum(map(len, heard))):
            self._put(b"", arrival_ns, missing)  # the host sent it, so the wire was busy

    def _take(self, piece: Piece, now_ns: int) -> None:
        """Process ``piece``, whose last byte has arrived."""
        if now_ns - piece.wire_ns - self._heard_ns > GAP_NS:
            self._parser.reset()
        self._free_ns = self._heard_ns = now_ns
        listening = [servo for servo in self.servos if servo.baud == piece.baud]
        if not listening:
            return
        for frame in self._parser.feed(piece.data):
            hearing = listening
            if frame.id == BROADCAST and self._faults.strikes_frames:
                hearing = self._hearing(frame, listening, now_ns)
            answers = answer(frame, hearing, now_ns)
            if self._witness is not None:
                first = addressed(frame)
                self._note(now_ns, "rx", frame.id, first[0] if first else None, frame)
            for reply in answers:
                self._schedule_reply(reply, piece.baud)

    def _hearing(
        self, frame: Frame, servos: Sequence[EmulatedServo], now_ns: int
    ) -> list[EmulatedServo]:
        """Return the servos that hear a joint instruction."""
        ids = addressed(frame)
        deaf = self._faults.deaf([each.id for each in servos] if ids is None else ids, now_ns)
        for id_, name in deaf:
            self._note(now_ns, "fault", id_, id_, code=frame.instruction, fault=name)
        return [each for each in servos if each.id not in dict(deaf)]

    def _schedule_reply(self, reply: Answer, baud: int) -> None:
        """Schedule a reply for when the wire is free and its delay is over."""
        begin_ns = self._free_ns + reply.delay_ns
        wire = b"".join(part.wire for part in reply.parts)
        count = len(wire)
        gaps: Sequence[tuple[int, int]] = ()
        names: Sequence[tuple[int | None, str]] = ()
        if self._faults.strikes_frames:
            passage = self._faults.pass_frame(reply.parts, "reply", begin_ns)
            wire, gaps, names = b"".join(passage.chunks), passage.gaps, passage.names
        self._free_ns = begin_ns + wire_ns(max(len(wire), count), baud)
        self._going.append(
            Reply(begin_ns, self._free_ns, baud, reply.frame, reply.parts, wire, gaps, names)
        )

    def _begin(self, reply: Reply) -> None:
        """Start a reply on the wire: the adapter receives byte after byte."""
        self._begun = True
        if not self.connected or reply.baud != self.host_baud:
            return
        begin_ns, sent = reply.begin_ns, 0
        for end, gap_ns in (*sorted(reply.gaps), (len(reply.wire), 0)):
            data = reply.wire[sent:end]
            if data:
                self._adapter.put(data, begin_ns, reply.baud)
            begin_ns += wire_ns(len(data), reply.baud) + gap_ns
            sent = end

    def _leave(self, reply: Reply, now_ns: int) -> None:
        """Finish ``reply``, whose last byte has left."""
        self._begun = False
        frame = reply.frame
        for id_, name in reply.faults:
            shown = frame.id if id_ is None else id_
            self._note(now_ns, "fault", shown, shown, code=frame.instruction, fault=name)
        self._note(now_ns, "tx", frame.id, frame.id, frame)

    def _add(self, fault: Fault, now_ns: int) -> None:
        fault.check_servo([servo.id for servo in self.servos])
        self._faults.add(fault, now_ns)

    def _apply(self, event: FaultEvent, now_ns: int) -> None:
        """Begin or end a fault of a servo or of the adapter."""
        fault = event.fault
        name = fault.name if event.begins else f"{fault.name} over"
        if fault.name == "unplug-adapter":
            self._connect(not event.begins)
            self._note(now_ns, "fault", BROADCAST, None, fault=name)
            return
        struck = [s for s in self.servos if s.id == fault.values.get("id", s.id)]
        if event.begins and fault.name in SILENCING:
            self._silence({servo.id for servo in struck}, now_ns)
        for servo in struck:
            apply_fault(event, servo, now_ns)
            self._note(now_ns, "fault", servo.id, servo, fault=name)

    def _note(
        self,
        now_ns: int,
        event: str,
        shown: int,
        of: EmulatedServo | int | None,
        frame: Frame | None = None,
        code: int | None = None,
        fault: str = "",
    ) -> None:
        """Record a frame, or a fault of a servo or an instruction; ``of`` None: of no servo."""
        if self._witness is None:
            return
        if not isinstance(of, EmulatedServo):
            of = next((servo for servo in self.servos if servo.id == of), self.servos[0])
        error, params = None, b""
        if frame is not None:
            code, error, params = frame.instruction, frame.error, frame.params
        state = of.state(now_ns)
        self._witness.add(Event(now_ns, event, shown, code, state, error, params, fault))

    def _connect(self, connected: bool) -> None:
        self.connected = connected
        self.times_unplugged += not connected
        self._coming.clear()
        self._adapter.clear()

    def _silence(self, ids: Collection[int], now_ns: int) -> None:
        """Truncate the replies of these servos at the present byte, joint ones at their part."""
        kept = []
        for reply in self._going:
            end = reply.begin_of(ids)
            if end is None:
                kept.append(reply)
                continue
            if self._begun and reply is self._going[0]:
                self._adapter.truncate(max(now_ns, reply.begin_ns + wire_ns(end, reply.baud)))
                self._begun = end > 0
            if end:
                kept.append(reply._replace(wire=reply.wire[:end]))
        self._going = deque(kept)
