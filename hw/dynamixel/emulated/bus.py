"""The emulated bus: bytes in and out at given times, as one half-duplex wire carries them.

It has no clock: whoever owns it says what time it is, in nanoseconds that never go back. Between
two calls everything that was due in between happens at its own instant.

The wire is one. A byte takes ten bit times; an instruction takes effect when its last byte has
travelled, a reply can be read when its last byte has. Bytes sent while something is on the wire
wait for it (on a real bus they would collide).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

from hw.dynamixel.codec import Frame, Parser
from hw.dynamixel.emulated.answers import Answer, addressed, answer
from hw.dynamixel.emulated.servo import EmulatedServo
from hw.dynamixel.emulated.witness import Row, Witness

GAP_NS = 1_500_000
"""After a longer silence inside a frame servos wait for a new header [ns]"""
MAX_WAITING = 64
"""Frames a host may have waiting for the wire, before ``full``"""
STATE_NS = 1_000_000
"""Between two records of the state [ns]"""

_HEADER = b"\xff\xff\xfd\x00"
_BIT_TIMES_NS = 10_000_000_000
"""Ten bits at one bit per second [ns]"""


class _Piece(NamedTuple):
    """Bytes on their way to the servos: at most one frame, which ends where they end."""

    arrival_ns: int
    wire_ns: int
    baud: int
    data: bytes


class EmulatedBus:
    """Servos on a wire.

    Args:
        servos: Who is on it.
        baud: The speed the host talks at [bit/s]; ``host_baud`` changes it. Servos set to another
            speed understand nothing and are not understood.
        start_ns: When it begins [ns].
        witness: Told of everything, if there is one.
    """

    def __init__(
        self,
        servos: Sequence[EmulatedServo],
        *,
        baud: int,
        start_ns: int,
        witness: Witness | None = None,
    ) -> None:
        self.servos = tuple(servos)
        self.host_baud = baud
        self._witness = witness
        self._parser = Parser(report_crc=True, unstuffed=True)
        self._coming: deque[_Piece] = deque()
        self._going: deque[tuple[int, Answer]] = deque()
        self._gone = bytearray()
        self._free_ns = start_ns
        """When the wire is free again"""
        self._heard_ns = start_ns
        """When the last byte from the host had travelled"""
        self._state_ns = start_ns

    @property
    def busy(self) -> bool:
        """Whether something is on the wire, so that the next event must be met on time."""
        return bool(self._coming or self._going)

    @property
    def full(self) -> bool:
        """More is waiting for the wire than a serial port would take in."""
        return len(self._coming) >= MAX_WAITING

    def receive(self, data: bytes, now_ns: int) -> None:
        """Bytes from the host begin to travel at ``now_ns`` [ns]."""
        self._run(now_ns)
        start = 0
        while start < len(data):
            end = data.find(_HEADER, start + 1)
            piece = data[start:] if end < 0 else data[start:end]
            wire_ns = _wire_ns(len(piece), self.host_baud)
            self._coming.append(_Piece(now_ns, wire_ns, self.host_baud, piece))
            start += len(piece)

    def transmit(self, now_ns: int) -> bytes:
        """What the host can read by ``now_ns`` [ns] and has not been given yet.

        Bytes are handed over as soon as their frame has left the wire. An adapter that waits for
        its latency timer or a full block has its place here, between the wire and the host.
        """
        self._run(now_ns)
        if not self._gone:
            return b""
        data = bytes(self._gone)
        self._gone.clear()
        return data

    def next_event_ns(self) -> int | None:
        """When something happens next if the host sends nothing [ns]; None: nothing will."""
        times = [time for time, _ in self._events()]
        return min(times, default=None)

    def _events(self) -> list[tuple[int, int]]:
        """What is due, each as its time and which of the kinds in ``_run`` it is."""
        events = []
        for servo in self.servos:
            watchdog_ns = servo.watchdog_ns
            if watchdog_ns is not None:
                events.append((watchdog_ns, 0))
        if self._going:
            events.append((self._going[0][0], 1))
        if self._coming:
            piece = self._coming[0]
            events.append((max(piece.arrival_ns, self._free_ns) + piece.wire_ns, 2))
        if self._witness is not None:
            events.append((self._state_ns, 3))
        return events

    def _run(self, now_ns: int) -> None:
        """Let everything happen that is due by ``now_ns``, in the order of time."""
        while events := self._events():
            time_ns, kind = min(events)
            if time_ns > now_ns:
                return
            if kind == 0:
                for servo in self.servos:
                    if servo.watchdog_ns == time_ns:
                        servo.trip_watchdog(time_ns)
            elif kind == 1:
                self._send(*self._going.popleft())
            elif kind == 2:
                self._take(self._coming.popleft(), time_ns)
            else:
                self._record_states(time_ns)

    def _take(self, piece: _Piece, now_ns: int) -> None:
        """The last byte of ``piece`` has travelled."""
        if now_ns - piece.wire_ns - self._heard_ns > GAP_NS:
            self._parser.reset()
        self._free_ns = self._heard_ns = now_ns
        listening = [servo for servo in self.servos if servo.baud == piece.baud]
        if not listening:
            return
        for frame in self._parser.feed(piece.data):
            answers = answer(frame, listening, now_ns)
            if self._witness is not None:
                self._record(self._witness, now_ns, "rx", frame, addressed(frame))
            for reply in answers:
                self._free_ns += reply.delay_ns + _wire_ns(len(reply.wire), piece.baud)
                self._going.append((self._free_ns, reply))

    def _send(self, now_ns: int, reply: Answer) -> None:
        """The last byte of ``reply`` has travelled."""
        self._gone += reply.wire
        if self._witness is not None:
            self._record(self._witness, now_ns, "tx", reply.frame, [reply.frame.id])

    def _record(
        self, witness: Witness, now_ns: int, event: str, frame: Frame, ids: list[int] | None
    ) -> None:
        """A frame, with the state of the first servo it concerns."""
        concerned = next((s for s in self.servos if ids and s.id == ids[0]), self.servos[0])
        state = concerned.state(now_ns)
        witness.add(
            Row(now_ns, event, frame.id, frame.instruction, state, frame.error, frame.params)
        )

    def _record_states(self, now_ns: int) -> None:
        if self._witness is not None:
            for servo in self.servos:
                state = servo.state(now_ns)
                self._witness.add(Row(now_ns, "state", servo.id, None, state, None, b""))
        self._state_ns += STATE_NS


def _wire_ns(count: int, baud: int) -> int:
    """How long so many bytes take at this speed [ns]."""
    return count * _BIT_TIMES_NS // baud
