"""A bare client of an emulated bus in memory: frames in, frames out, and the truth in view."""

from __future__ import annotations

import io

from haptic_wall.hw.clock import SimulatedClock
from haptic_wall.hw.dynamixel.codec import Frame, Instruction, Parser, encode
from haptic_wall.hw.dynamixel.tables import MODELS
from haptic_wall.hw.emulated.adapter import Adapter
from haptic_wall.hw.emulated.bus import EmulatedBus
from haptic_wall.hw.emulated.injection import Faults
from haptic_wall.hw.emulated.memory_line import MemoryLine
from haptic_wall.hw.emulated.servo import EmulatedServo
from haptic_wall.hw.emulated.witness import Witness
from haptic_wall.hw.truth import TrueServo

US = 1_000
MS = 1_000_000
BAUD = 4_000_000
BYTE_NS = 2_500
FREE = TrueServo(inertia=0.01, position=1.0, torque_limit=10.0)
"""No friction, so that motion is one line of mechanics."""
TORQUE_UNIT = 2.69e-3 * 4.1 / 2.3
"""Of the XM430-W350 [N·m]: 2.69 mA at 4.1 N·m over 2.3 A"""


class Client:
    """Servos on a bus in memory, given as (model, id) with one truth for all."""

    def __init__(
        self,
        *servos: tuple[str, int],
        true: TrueServo = FREE,
        firmware: int = 48,
        tick: int = 0,
        fast: bool = True,
        adapter: Adapter | None = None,
        faults: Faults | None = None,
        recorded: bool = True,
    ) -> None:
        self.clock = SimulatedClock(5 * MS)
        start = self.clock.now_ns()
        self.servos = {
            i: EmulatedServo(
                MODELS[model],
                i,
                firmware,
                true,
                start_ns=start,
                baud=BAUD,
                tick=tick,
            )
            for model, i in servos or (("XM430-W350", 1),)
        }
        self.record = io.StringIO()
        self.witness = Witness(self.record)
        self.bus = EmulatedBus(
            list(self.servos.values()),
            baud=BAUD,
            start_ns=start,
            witness=self.witness if recorded else None,
            adapter=adapter,
            faults=faults,
        )
        self.line = MemoryLine(self.bus, self.clock)
        self._parser = Parser()
        if fast:
            for i in self.servos:
                assert self.write(i, 9, 0, 1) == 0  # Return Delay Time

    def send(self, id_: int, instruction: int, params: bytes = b"") -> None:
        self.line.write(encode(id_, instruction, params))

    def heard(self, frame: bytes, within_ns: int = 3 * MS) -> bytes:
        """Every byte that comes after a frame before nothing has come for so long."""
        self.line.write(frame)
        found = b""
        while self.line.wait(self.clock.now_ns() + within_ns):
            found += self.line.read()
        return found

    def replies(self, within_ns: int = 3 * MS) -> list[Frame]:
        """Every reply that comes before nothing has come for so long."""
        found = []
        while self.line.wait(self.clock.now_ns() + within_ns):
            found += self._parser.feed(self.line.read())
        return found

    def ask(self, id_: int, instruction: int, params: bytes = b"") -> Frame | None:
        """The one reply, at the moment it is through; None: there was none within 3 ms."""
        self.send(id_, instruction, params)
        deadline = self.clock.now_ns() + 3 * MS
        while self.line.wait(deadline):
            found = self._parser.feed(self.line.read())
            if found:
                assert len(found) == 1
                return found[0]
        return None

    def answer(self, id_: int, instruction: int, params: bytes = b"") -> Frame:
        """The one reply, which comes."""
        reply = self.ask(id_, instruction, params)
        assert reply is not None
        return reply

    def write(self, id_: int, address: int, value: int, size: int) -> int:
        """The error byte of the reply."""
        data = value.to_bytes(size, "little", signed=value < 0)
        return self.answer(id_, Instruction.WRITE, address.to_bytes(2, "little") + data).error

    def read(self, id_: int, address: int, size: int, signed: bool = False) -> int:
        params = address.to_bytes(2, "little") + size.to_bytes(2, "little")
        reply = self.answer(id_, Instruction.READ, params)
        assert reply.error & 0x7F == 0
        return int.from_bytes(reply.params, "little", signed=signed)

    def sync_write(self, address: int, size: int, values: dict[int, int]) -> None:
        params = address.to_bytes(2, "little") + size.to_bytes(2, "little")
        for i, value in values.items():
            params += bytes([i]) + value.to_bytes(size, "little", signed=value < 0)
        self.send(0xFE, Instruction.SYNC_WRITE, params)

    def enable_current_mode(self, id_: int = 1) -> None:
        """As a careful driver does it."""
        assert self.write(id_, 11, 0, 1) == 0
        assert self.write(id_, 102, 0, 2) == 0
        assert self.write(id_, 64, 1, 1) == 0

    def inject(self, spec: str) -> None:
        """From now on let this go wrong."""
        self.bus.inject(spec, self.clock.now_ns())

    def fault_rows(self) -> list[tuple[str, int, str]]:
        """Time [s], id and name of every fault in the record."""
        return [(row[0], int(row[2]), row[-1]) for row in self.rows() if row[1] == "fault"]

    def pass_time(self, duration_ns: int) -> None:
        self.clock.wait_until(self.clock.now_ns() + duration_ns)
        self.bus.transmit(self.clock.now_ns())

    def torque(self, id_: int = 1) -> float:
        """The torque that truly acts now [N·m]."""
        return self.servos[id_].state(self.clock.now_ns()).torque

    def position(self, id_: int = 1) -> float:
        """The true position now [rad]."""
        return self.servos[id_].state(self.clock.now_ns()).position

    def rows(self) -> list[list[str]]:
        """The witness's rows so far, without the header."""
        self.witness.flush()
        return [line.split(",") for line in self.record.getvalue().splitlines()[1:]]
