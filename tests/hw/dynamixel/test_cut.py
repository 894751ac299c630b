"""Torque off from outside, when whoever drove the servo is dead or hung."""

from __future__ import annotations

import pytest

from haptic_wall.hw.clock import SimulatedClock
from haptic_wall.hw.dynamixel.codec import Instruction, Parser, encode_status
from haptic_wall.hw.dynamixel.cut import cut_torque
from haptic_wall.hw.dynamixel.tables import MODELS
from haptic_wall.hw.emulated.bus import EmulatedBus
from haptic_wall.hw.emulated.injection import Faults
from haptic_wall.hw.emulated.memory_line import MemoryLine
from haptic_wall.hw.emulated.servo import EmulatedServo
from haptic_wall.hw.errors import ServoLostError
from haptic_wall.hw.truth import TrueServo
from tests.cases import sampled
from tests.hw.dynamixel.bench import Bench


def pushing() -> Bench:
    """A servo that its driver has left pushing."""
    bench = Bench(watchdog_s=2.0, probe_torque=0.0)
    bench.servo.start()
    bench.cycle(1.0)
    assert bench.state.torque > 0.9
    bench.line.frames.clear()
    return bench


def test_torque_goes_off_and_is_read_back_and_no_goal_is_ever_written() -> None:
    """With torque-on-by-goal-update a goal would bring the torque back."""
    bench = pushing()
    begun = bench.clock.now_ns()
    assert cut_torque(bench.line, [1]) is True
    assert bench.truth.memory["torque_enable"] == 0
    assert bench.state.torque == 0.0
    assert bench.clock.now_ns() - begun < 4_000_000
    for data in bench.line.frames:
        (frame,) = Parser().feed(data)
        assert frame.instruction in (Instruction.SYNC_WRITE, Instruction.READ)
        assert frame.params[:2] == bytes([64, 0])


@pytest.mark.parametrize("sent", sampled(range(1, 15), 3))
def test_a_frame_cut_short_by_the_drivers_death_does_not_swallow_the_cut(sent: int) -> None:
    bench = pushing()
    bench.servo.request()
    half = bench.line.frames.pop()[:sent]
    bench.wait(0.01)
    bench.memory_line.write(half)
    assert cut_torque(bench.line, [1]) is True


@pytest.mark.parametrize("stale", [encode_status(1, 0), encode_status(1, 0, bytes(1))])
def test_a_late_confirmation_is_not_taken_for_the_cuts(stale: bytes) -> None:
    """It is the reply to a write of the dead driver; the cut's own first write is lost."""
    bench = pushing()
    writes: list[bytes] = []
    late = [stale]

    class Late(MemoryLine):
        def write(self, data: bytes) -> None:
            writes.append(data)
            if len(writes) > 1:
                super().write(data)

        def read(self) -> bytes:
            return (late.pop() if writes and late else b"") + super().read()

        def wait(self, deadline_ns: int) -> bool:
            return bool(writes and late) or super().wait(deadline_ns)

    assert cut_torque(Late(bench.bus, bench.clock), [1]) is True
    assert bench.truth.memory["torque_enable"] == 0


def test_torque_that_stays_on_is_not_called_off() -> None:
    bench = pushing()
    bench.truth.memory["status_return_level"] = 1

    class Deaf(MemoryLine):
        def write(self, data: bytes) -> None:
            (frame,) = Parser().feed(data)
            if frame.instruction == Instruction.READ:
                super().write(data)

    assert cut_torque(Deaf(bench.bus, bench.clock), [1]) is False
    assert bench.truth.memory["torque_enable"] == 1


def test_a_vanished_port_is_not_called_off() -> None:
    bench = pushing()

    def gone(*_: object) -> bytes:
        raise ServoLostError("The serial port is gone.")

    bench.line.read = gone  # type: ignore[method-assign]
    assert cut_torque(bench.line, [1]) is False


def test_the_cut_waits_for_a_gap_between_frames() -> None:
    """Into the middle of a frame it would be swallowed by it."""
    bench = pushing()
    silent_ns = bench.clock.now_ns() + 5_000_000
    written: list[int] = []

    class Busy(MemoryLine):
        def write(self, data: bytes) -> None:
            written.append(self.clock.now_ns())
            super().write(data)

        def wait(self, deadline_ns: int) -> bool:
            if self.clock.now_ns() >= silent_ns:
                return super().wait(deadline_ns)
            self.clock.wait_until(self.clock.now_ns() + 500_000)
            return True

    assert cut_torque(Busy(bench.bus, bench.clock), [1]) is True
    assert written[0] - silent_ns >= 1_500_000


def test_a_bus_that_is_never_silent_is_cut_all_the_same() -> None:
    bench = pushing()

    class Babbling(MemoryLine):
        def wait(self, deadline_ns: int) -> bool:
            self.clock.wait_until(min(deadline_ns, self.clock.now_ns() + 500_000))
            return True

        def read(self) -> bytes:
            return super().read() + b"\x00\x55"

    assert cut_torque(Babbling(bench.bus, bench.clock), [1]) is True


class Watched(MemoryLine):
    """A line to three servos whose torque is on; it notes when all are off."""

    def __init__(self, fault: str, seed: int = 0) -> None:
        model, faults = MODELS["XM430-W350"], Faults([fault] if fault else [], seed)
        servos = [
            EmulatedServo(model, id_, 48, TrueServo(0.01), start_ns=0, baud=4_000_000)
            for id_ in (1, 2, 3)
        ]
        for servo in servos:
            servo.write(64, bytes([1]), 0)
        bus = EmulatedBus(servos, baud=4_000_000, start_ns=0, faults=faults)
        super().__init__(bus, SimulatedClock())
        self.off_ns = 1 << 62

    def wait(self, deadline_ns: int) -> bool:
        come = super().wait(deadline_ns)
        if self.is_off:
            self.off_ns = min(self.off_ns, self.clock.now_ns())
        return come

    @property
    def is_off(self) -> bool:
        return not any(servo.memory["torque_enable"] for servo in self.bus.servos)


def test_all_servos_of_a_bus_are_cut_and_each_is_read_back() -> None:
    line = Watched("")
    assert cut_torque(line, [1, 2, 3]) is True
    assert line.is_off
    line.bus.inject("unplug:id=2", line.clock.now_ns())
    assert cut_torque(line, [1, 2, 3]) is False


@pytest.mark.parametrize("fault", sampled(["corrupt:p=0.5", "drop:p=0.5", "truncate:p=0.5"], 3))
def test_a_bus_that_loses_half_of_its_frames_is_cut_in_time(fault: str, wholly: bool) -> None:
    """The torque must be gone 41 ms after the driver's death, of which 6 ms are to notice it."""
    for seed in range(100 if wholly else 30):
        line = Watched(fault, seed)
        confirmed = cut_torque(line, [1, 2, 3])
        assert line.off_ns < 35_000_000
        assert line.is_off or not confirmed
