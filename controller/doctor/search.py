"""Finds the servos on a bus by pings, at one baud rate or at all that the family supports.

Each servo answers a broadcast ping in a time slot of its own, in the order of ids; waiting for all
253 slots takes most of a second. A scan waits for all of them, and then pings the lowest ids one by
one, because colliding replies or noise may have garbled theirs. It also reads from each servo, as
two with one id and model reply to a ping like one. It writes no register.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Final, NamedTuple

from haptic_wall.hw.clock import Clock
from haptic_wall.hw.dynamixel.codec import BROADCAST, MAX_ID, Frame, Instruction, Parser, encode
from haptic_wall.hw.dynamixel.register_access import Table
from haptic_wall.hw.dynamixel.registers import BAUD_RATES
from haptic_wall.hw.dynamixel.tables import NO_CURRENT_MODE, model_by_number
from haptic_wall.hw.dynamixel.wire import wire_ns
from haptic_wall.hw.errors import BaudRefusedError, ServoLostError, UnfitServoError
from haptic_wall.hw.serialport.line import FdLine, Line
from haptic_wall.hw.serialport.port import open_port

IDS: Final = range(21)
"""Ids of the single pings: few buses have higher ones"""
LIKELY_FIRST: Final = (57600, 4_000_000, 1_000_000, 2_000_000, 3_000_000, 115200, 4_500_000, 9600)
"""All rates of the family; the factory's rate and those for fast loops come first"""
assert set(LIKELY_FIRST) == set(BAUD_RATES)

_SLOT_NS: Final = 3_000_000
"""Time slot of each id after a broadcast ping; the vendor's SDK uses the same"""
_HOLD_NS: Final = 25_000_000
"""Longest time that an adapter with a 16 ms latency timer, on a busy machine, holds a reply"""
_ANSWER_NS: Final = 2_500_000
"""From ping to reply, without the transmission time: return delay (0.5 ms) and one or two USB
frames"""
_REQUEST, _REPLY = 10, 14
"""Bytes of a ping and of its reply"""


class FoundServo(NamedTuple):
    """A servo that replies."""

    baud: int
    id: int
    model_number: int
    firmware: int
    twins: bool = False
    """Two servos have this id; known after a scan"""

    @property
    def model(self) -> str | None:
        """Return the model's name; None if the model number is unknown."""
        model = model_by_number(self.model_number)
        return NO_CURRENT_MODE.get(self.model_number) if model is None else model.name

    @property
    def current_mode(self) -> bool | None:
        """Return whether it can be commanded in torque; None if the model number is unknown."""
        return None if self.model is None else self.model_number not in NO_CURRENT_MODE


class BaudSearch(NamedTuple):
    """The servos found at one baud rate."""

    baud: int
    servos: list[FoundServo]
    garbled: int
    """Number of invalid frames: two servos have one id, there is noise, or another protocol"""
    refused: str = ""
    """Why the adapter does not support this rate; empty: the rate was tried"""


def search(
    line: Line, baud: int, ids: Collection[int] = IDS, *, to_the_end: bool = True
) -> BaudSearch:
    """Search for servos at the line's present baud rate.

    Args:
        line: The bus.
        baud: Its rate [bit/s].
        ids: Ids to ping one by one if the broadcast ping has not found them.
        to_the_end: Wait for the slots of all ids, not only of those in ``ids``.

    Raises:
        ServoLostError: The port is gone.
    """
    heard = _Listener(line, baud)
    heard.drop()
    byte_ns = wire_ns(1, baud)
    wanted = set(ids)

    line.write(encode(BROADCAST, Instruction.PING))
    last = MAX_ID if to_the_end else max(wanted)
    heard.listen(_REQUEST * byte_ns + (last + 1) * (_SLOT_NS + _REPLY * byte_ns) + _HOLD_NS)

    for servo_id in sorted(wanted - heard.servos.keys()):
        line.write(encode(servo_id, Instruction.PING))
        heard.listen((_REQUEST + _REPLY) * byte_ns + _ANSWER_NS, until=servo_id)
    heard.listen(_HOLD_NS)  # bytes that an adapter still holds
    return BaudSearch(baud, sorted(heard.servos.values()), heard.garbled)


def scan(
    path: str,
    bauds: Sequence[int],
    ids: Collection[int],
    clock: Clock,
    tell: Callable[[int], None] = lambda _baud: None,
) -> Generator[BaudSearch]:
    """Search a port at several baud rates in sequence.

    Args:
        path: The port.
        bauds: Baud rates in the order of the search [bit/s].
        ids: See ``search``.
        clock: Real time.
        tell: Called with each rate before it is tried.

    Raises:
        PortError: The port cannot be used.
        ServoLostError: The port is gone.
    """
    for baud in bauds:
        tell(baud)
        try:
            with opened(path, baud, clock) as line:
                found = search(line, baud, ids)
                servos = [one._replace(twins=_are_two(line, one, path)) for one in found.servos]
                found = found._replace(servos=servos)
        except BaudRefusedError as error:
            found = BaudSearch(baud, [], 0, str(error))
        yield found


def _are_two(line: Line, servo: FoundServo, path: str) -> bool:
    """Whether two servos reply at an id."""
    model = model_by_number(servo.model_number)
    if model is None:
        return False
    table = Table.on(line, servo.baud, servo.id, path, model)
    with suppress(UnfitServoError, ServoLostError):
        table.be_alone()
        table.read("realtime_tick")
    return table.station.twins


@contextmanager
def opened(path: str, baud: int, clock: Clock) -> Iterator[FdLine]:
    """Open a port as a line; close it at the end.

    Args:
        path: The port.
        baud: Its rate [bit/s].
        clock: Real time.

    Raises:
        PortError: The port cannot be used.
    """
    line = FdLine(open_port(path, baud), clock)
    try:
        yield line
    finally:
        line.close()


class _Listener:
    """Collects replies to pings, in any order and at any time."""

    def __init__(self, line: Line, baud: int) -> None:
        self.servos: dict[int, FoundServo] = {}
        self._line = line
        self._baud = baud
        self._parser = Parser()

    @property
    def garbled(self) -> int:
        return self._parser.corrupt + (not self._parser.idle)

    def drop(self) -> None:
        self._line.read()

    def listen(self, duration_ns: int, until: int | None = None) -> None:
        """Listen for a duration [ns], or until the id ``until`` has replied."""
        now_ns = self._line.clock.now_ns
        end = now_ns() + duration_ns
        while until not in self.servos and self._line.wait(end):
            for frame in self._parser.feed(self._line.read()):
                self._take(frame)
            if now_ns() >= end:  # a noisy bus may never be silent
                break

    def _take(self, frame: Frame) -> None:
        if frame.instruction == Instruction.STATUS and len(frame.params) == 3:
            number = int.from_bytes(frame.params[:2], "little")
            self.servos[frame.id] = FoundServo(self._baud, frame.id, number, frame.params[2])
