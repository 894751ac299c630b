"""The real driver on an emulated bus in memory, with the truth in view."""

from __future__ import annotations

from dataclasses import replace

from haptic_wall.hw.clock import SimulatedClock
from haptic_wall.hw.dynamixel.codec import Instruction, Parser, encode
from haptic_wall.hw.dynamixel.tables import MODELS
from haptic_wall.hw.emulated.adapter import Adapter
from haptic_wall.hw.emulated.bus import EmulatedBus
from haptic_wall.hw.emulated.memory_line import MemoryLine
from haptic_wall.hw.emulated.servo import EmulatedServo, TrueState
from haptic_wall.hw.settings import DriverSettings
from haptic_wall.hw.truth import TrueServo
from tests.support.one_servo import OneServo

BAUD = 4_000_000
GOAL_CURRENT = 102
TRUE = TrueServo(inertia=0.012, damping=0.012, coulomb=0.09, position=-0.3)
SETTINGS = DriverSettings(port="", baud=BAUD, id=1, model="XM430-W350")


class SpyLine:
    """A memory line that notes the truth at each write, and may turn the torque's sign round."""

    def __init__(self, line: MemoryLine, servo: EmulatedServo) -> None:
        self.clock = line.clock
        self.wrong_way = False
        self.frames: list[bytes] = []
        self.states: list[TrueState] = []
        self.closed = 0
        self._line = line
        self._servo = servo

    def write(self, data: bytes) -> None:
        self._line.wait(self.clock.now_ns())  # first let what is under way happen
        self.states.append(self._servo.state(self.clock.now_ns()))
        self.frames.append(data)
        self._line.write(_reversed(data) if self.wrong_way else data)

    def read(self) -> bytes:
        return self._line.read()

    def wait(self, deadline_ns: int) -> bool:
        return self._line.wait(deadline_ns)

    def close(self) -> None:
        self.closed += 1


def _reversed(data: bytes) -> bytes:
    """A goal current with the other sign; every other frame as it is."""
    (frame,) = Parser().feed(data)
    if frame.instruction != Instruction.SYNC_WRITE or frame.params[0] != GOAL_CURRENT:
        return data
    goal = -int.from_bytes(frame.params[5:7], "little", signed=True)
    return encode(
        frame.id, frame.instruction, frame.params[:5] + goal.to_bytes(2, "little", signed=True)
    )


class Bench:
    """One servo, emulated, and its driver."""

    def __init__(
        self,
        true: TrueServo = TRUE,
        *,
        model: str = "XM430-W350",
        firmware: int = 48,
        baud: int = BAUD,
        bus_baud: int = BAUD,
        timer_ms: float = 0.0,
        phase_ms: float = 0.0,
        **settings: object,
    ) -> None:
        """A servo set to ``baud`` on a bus whose host and driver talk at ``bus_baud``.

        Its adapter has a latency timer [ms] where that is above 0, which runs from ``phase_ms`` on.
        """
        self.clock = SimulatedClock(start_ns=123_456_789)
        now_ns = self.clock.now_ns()
        self.truth = EmulatedServo(
            MODELS[model], 1, firmware, true, start_ns=now_ns, baud=baud, tick=12_345
        )
        adapter = Adapter(round(timer_ms * 1e6), 62, round(phase_ms * 1e6)) if timer_ms else None
        self.bus = EmulatedBus([self.truth], baud=bus_baud, start_ns=now_ns, adapter=adapter)
        self.memory_line = MemoryLine(self.bus, self.clock)
        self.line = SpyLine(self.memory_line, self.truth)
        self.settings = replace(SETTINGS, baud=bus_baud, **settings)  # type: ignore[arg-type]
        self.servo = OneServo.driven(self.settings, self.line)

    @property
    def state(self) -> TrueState:
        """The truth now."""
        self.memory_line.wait(self.clock.now_ns())  # first let what is under way happen
        return self.truth.state(self.clock.now_ns())

    def found(self, name: str) -> str:
        """The start's finding for one check."""
        return next(check.found for check in self.servo.start() if check.name == name)

    def wait(self, seconds: float) -> None:
        self.clock.wait_until(self.clock.now_ns() + round(seconds * 1e9))

    def spy_unguarded(self) -> list[bool]:
        """From now on at each write: whether torque is on and the Bus Watchdog off."""
        write, memory = self.memory_line.write, self.truth.memory
        found: list[bool] = []

        def look_and_write(data: bytes) -> None:
            self.memory_line.wait(self.clock.now_ns())
            found.append(memory["torque_enable"] == 1 and memory["bus_watchdog"] == 0)
            write(data)

        self.memory_line.write = look_and_write  # type: ignore[method-assign]
        return found

    def cycle(self, torque: float) -> float:
        """One period of 1 ms; the position read [rad]."""
        begun = self.clock.now_ns()
        self.servo.request()
        reading = self.servo.collect(begun + 900_000)
        self.servo.write(torque)
        self.clock.wait_until(begun + 1_000_000)
        return reading.position


def pin(truth: EmulatedServo, register: str, value: int) -> None:
    """Have the servo give this value for a register, whatever its emulation computes."""
    address = MODELS["XM430-W350"].registers[register].address
    size = 2 if register == "present_input_voltage" else 1
    real = type(truth).read

    def read(at: int, length: int, now_ns: int) -> bytes | None:
        data = real(truth, at, length, now_ns)
        if data is None or not at <= address < at + length:
            return data
        image = bytearray(data)
        image[address - at : address - at + size] = value.to_bytes(size, "little")
        return bytes(image)

    truth.read = read  # type: ignore[assignment, method-assign]
