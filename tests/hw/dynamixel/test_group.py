"""Several servos in one cycle, on the emulated bus in memory; the truth of each in view."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from dataclasses import replace

import pytest

from haptic_wall.hw.clock import SimulatedClock
from haptic_wall.hw.dynamixel.codec import Instruction, Parser
from haptic_wall.hw.dynamixel.exchange import Exchange
from haptic_wall.hw.dynamixel.group import DynamixelGroup
from haptic_wall.hw.dynamixel.registers import POSITION_UNIT
from haptic_wall.hw.dynamixel.samples import LENGTHS
from haptic_wall.hw.dynamixel.tables import MODELS
from haptic_wall.hw.dynamixel.wire import Read
from haptic_wall.hw.emulated.adapter import Adapter
from haptic_wall.hw.emulated.bus import EmulatedBus
from haptic_wall.hw.emulated.memory_line import MemoryLine
from haptic_wall.hw.emulated.servo import EmulatedServo
from haptic_wall.hw.errors import (
    ServoError,
    ServoHealthError,
    ServoLostError,
    ServoMissingError,
    TorqueLostError,
    UnfitServoError,
)
from haptic_wall.hw.serialport.line import Line
from haptic_wall.hw.servo import BusCounts, Facts, Outcome, Reading
from haptic_wall.hw.settings import DriverSettings, Way
from haptic_wall.hw.truth import TrueServo
from tests.cases import sampled
from tests.hw.dynamixel.bench import pin
from tests.hw.dynamixel.lines import tapped

MODEL = "XM430-W350"
TRUE = TrueServo(inertia=0.012, damping=0.012, coulomb=0.09)
PERIOD_NS = 1_000_000


class Spy:
    """A line that notes what is written."""

    def __init__(self, inner: Line) -> None:
        self.clock, self.read, self.wait = inner.clock, inner.read, inner.wait
        self._inner = inner
        self.frames: list[bytes] = []
        self.closed = 0

    def write(self, data: bytes) -> None:
        self.frames.append(data)
        self._inner.write(data)

    def close(self) -> None:
        self.closed += 1


class Bench:
    """A group of servos 1, 2, ... at positions of their own.

    The start proves the torque's sign only where ``probes``: it takes hundreds of cycles a servo.
    """

    def __init__(
        self,
        firmwares: Sequence[int],
        *,
        models: Sequence[str] = (),
        probes: bool = False,
        period_ns: int = PERIOD_NS,
        watchdog_s: float = 0.2,
        read: Way = "auto",
    ) -> None:
        self.clock = SimulatedClock(start_ns=123_456_789)
        self.period_ns = period_ns
        models = models or [MODEL] * len(firmwares)
        self.truths = [
            EmulatedServo(
                MODELS[model],
                n,
                firmware,
                replace(TRUE, position=-0.1 * n),
                start_ns=self.clock.now_ns(),
                baud=4_000_000,
                tick=12_345,
            )
            for n, (firmware, model) in enumerate(zip(firmwares, models, strict=True), start=1)
        ]
        self.bus = EmulatedBus(self.truths, baud=4_000_000, start_ns=self.clock.now_ns())
        self.line = Spy(MemoryLine(self.bus, self.clock))
        settings = [
            DriverSettings(
                "",
                4_000_000,
                n,
                model,
                watchdog_s=watchdog_s,
                period_s=period_ns * 1e-9,
                read=read,
            )
            for n, model in enumerate(models, start=1)
        ]
        if not probes:
            settings = [replace(each, probe_torque=0.0) for each in settings]
        self.group = DynamixelGroup(settings, self.line)

    def cycle(self, torques: Sequence[float] | None = None) -> list[Reading]:
        begun = self.clock.now_ns()
        self.group.request()
        readings = self.group.collect(begun + self.period_ns * 4 // 5)
        self.group.write(torques or [0.0] * len(self.truths))
        self.clock.wait_until(begun + self.period_ns)
        return readings

    def assert_true(self, readings: Sequence[Reading]) -> None:
        """Each good reading is its own servo's position."""
        self.bus.transmit(self.clock.now_ns())
        for truth, reading in zip(self.truths, readings, strict=True):
            state = truth.state(self.clock.now_ns())
            if reading.outcome is Outcome.OK:
                slack = POSITION_UNIT + 1.5e-3 * abs(state.velocity)
                assert reading.position == pytest.approx(state.position, abs=slack)
            else:
                assert math.isnan(reading.position)


def started(
    *firmwares: int, models: Sequence[str] = (), probes: bool = False, period_ns: int = PERIOD_NS
) -> Bench:
    bench = Bench(firmwares, models=models, probes=probes, period_ns=period_ns)
    checks = bench.group.start()
    assert len(checks) == len(firmwares)
    return bench


def exchange_of(bench: Bench, way: Read) -> Exchange:
    """Another exchange with the same servos, in this way."""
    exchange = Exchange(bench.line, [truth.id for truth in bench.truths])
    exchange.select(exchange.stations, way)
    return exchange


@pytest.mark.parametrize("count", [2, 3, 6])
def test_servos_of_new_firmware_are_read_by_one_request_and_one_joint_reply(count: int) -> None:
    bench = started(*[48] * count, probes=count < 6)
    assert bench.group.exchange.way == "fast"
    torques = [0.3 * (-1) ** n for n in range(count)]
    frames = len(bench.line.frames)
    for _ in range(100):
        bench.assert_true(bench.cycle(torques))
    assert [c.cycles for c in counts_of(bench)] == [100] * count
    assert all((c.lost, c.late, c.corrupt) == (0, 0, 0) for c in counts_of(bench))
    sent = [Parser().feed(data)[0].instruction for data in bench.line.frames[frames:]]
    assert set(sent[::2]) == {Instruction.FAST_SYNC_READ, Instruction.FAST_BULK_READ}
    assert sent[1::2] == [Instruction.SYNC_WRITE] * 100
    for torque, truth, facts in zip(torques, bench.truths, facts_of(bench), strict=True):
        acting = truth.state(bench.clock.now_ns()).torque
        assert acting == pytest.approx(torque, abs=facts.torque_step)


def test_one_old_firmware_makes_all_answer_one_by_one_to_one_request() -> None:
    bench = Bench([48, 44, 48])
    checks = {check.name: check.found for check in bench.group.start()[0]}
    assert checks["read"] == "sync, as a fast read is not answered by id 2 (firmware 44)"
    assert bench.group.exchange.way == "sync"
    for _ in range(50):
        readings = bench.cycle([0.2, -0.2, 0.2])
        assert all(reading.outcome is Outcome.OK for reading in readings)
        bench.assert_true(readings)


def test_all_that_do_not_answer_a_fast_read_are_named_and_no_other() -> None:
    bench = Bench([44, 48, 44, 44, 48, 44])
    checks = {check.name: check.found for check in bench.group.start()[0]}
    old = " and ".join(f"id {id_} (firmware 44)" for id_ in (1, 3, 4, 6))
    assert checks["read"] == f"sync, as a fast read is not answered by {old}"


def test_a_way_of_reading_that_not_all_support_is_refused_where_it_is_asked_for() -> None:
    bench = Bench([48, 44, 48], read="fast")
    with pytest.raises(UnfitServoError, match=r"by id 2 \(firmware 44\).*set bus\.read=auto"):
        bench.group.start()


def test_servos_can_be_read_one_after_the_other() -> None:
    bench = Bench([48, 40, 48], read="plain")
    bench.group.start()
    for _ in range(300):
        readings = bench.cycle([0.2, -0.2, 0.2])
        assert all(reading.outcome is Outcome.OK for reading in readings)
        bench.assert_true(readings)
    bench.bus.inject("unplug:id=2", bench.clock.now_ns())
    outcomes = [reading.outcome for reading in bench.cycle([0.2, -0.2, 0.2])]
    assert outcomes == [Outcome.OK, Outcome.LOST, Outcome.OK]


@pytest.mark.parametrize(("count", "schedule"), sampled([(7, "pipelined"), (6, "immediate")], 2))
def test_polls_of_each_servo_cost_no_sample_behind_an_adapter_of_1_ms(
    count: int, schedule: str
) -> None:
    bench = Bench([48] * count, period_ns=2 * PERIOD_NS)
    bench.bus._adapter = Adapter(PERIOD_NS, 62, bench.clock.now_ns())
    bench.group.start()
    group, deadline_ns = bench.group, bench.clock.now_ns()
    pipelined = schedule == "pipelined"
    if pipelined:
        group.request()
    for _ in range(750):
        deadline_ns += 2_000_700  # the adapter's timer and the loop drift apart
        bench.clock.wait_until(deadline_ns)
        if not pipelined:
            group.request()
        readings = group.collect(deadline_ns + 1_600_000)
        assert all(reading.outcome is Outcome.OK for reading in readings)
        group.write([0.1] * count)
        if pipelined:
            group.request()
    assert all(one.health["supply"] for one in group.servos)


def test_where_one_is_missing_nobody_else_is_said_to_have_kept_its_torque() -> None:
    bench = Bench([48, 48, 48])
    bench.bus.inject("unplug:id=2", bench.clock.now_ns())
    with pytest.raises(ServoMissingError) as caught:
        bench.group.start()
    assert "could not be read back" not in str(caught.value)
    assert bench.truths[0].memory["torque_enable"] == 0


@pytest.mark.parametrize("fault", ["drop:id=2,p=0.2", "corrupt:id=2,p=0.2,way=reply"])
@pytest.mark.parametrize("read", sampled(["fast", "sync"], 2))
def test_a_flaky_servo_costs_the_others_one_reading_at_most(read: Way, fault: str) -> None:
    """A lost part ends a joint reply, so its servo is asked last from then on."""
    bench = Bench([48] * 5, read=read)
    bench.group.start()
    bench.bus.inject(fault, bench.clock.now_ns())
    for _ in range(300):
        bench.assert_true(bench.cycle([0.1, -0.1, 0.1, -0.1, 0.1]))
    lost = [one.lost + one.corrupt for one in counts_of(bench)]
    assert lost[1] > 40
    assert max(lost[:1] + lost[2:]) <= (read == "fast")
    bench.bus.lift("drop", bench.clock.now_ns())
    bench.bus.lift("corrupt", bench.clock.now_ns())
    for _ in range(20):
        bench.assert_true(readings := bench.cycle([0.1, -0.1, 0.1, -0.1, 0.1]))
        assert all(reading.outcome is Outcome.OK for reading in readings)


def test_a_start_that_fails_has_no_torque_on_at_any_time() -> None:
    bench = Bench([48, 48, 48], probes=True)
    bench.truths[2].memory["drive_mode"] = 1
    with pytest.raises(UnfitServoError, match="reverse"):
        bench.group.start()
    torque_on = bytes([Instruction.WRITE, 64, 0, 1])
    assert not any(torque_on in frame for frame in bench.line.frames)
    assert [truth.memory["torque_enable"] for truth in bench.truths] == [0, 0, 0]


def test_a_servo_that_also_obeys_the_id_of_another_is_refused() -> None:
    bench = Bench([48, 48, 48])
    bench.truths[0].memory["secondary_id"] = 3
    with pytest.raises(UnfitServoError, match=r"id 1 .*also obeys id 3.*Secondary ID") as caught:
        bench.group.start()
    assert caught.value.id == 1
    assert [truth.memory["torque_enable"] for truth in bench.truths] == [0, 0, 0]


def hold_a_pose(servo: EmulatedServo, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a servo measure a current of -1 and a velocity of -3."""
    measured = servo.drive.measured

    def posed(tick: int) -> bytes:
        block = bytearray(measured(tick))
        struct.pack_into("<hi", block, 6, -1, -3)
        return bytes(block)

    monkeypatch.setattr(servo.drive, "measured", posed)


@pytest.mark.parametrize("way", ["fast", "sync"])
def test_a_held_pose_whose_replies_need_stuffing_costs_no_reading(
    way: Read, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Current -1 and velocity -3 are FF FF FD side by side, which a joint reply does not stuff."""
    bench = started(48, 48, 48, 48)
    exchange = exchange_of(bench, way)
    received = tapped(bench.line, monkeypatch)
    for id_ in (1, 3, 4):
        hold_a_pose(bench.truths[id_ - 1], monkeypatch)
    for _ in range(50):
        begun = bench.clock.now_ns()
        exchange.request()
        samples = exchange.collect(begun + 800_000)
        exchange.send([0, 0, 0, 0])
        bench.clock.wait_until(begun + PERIOD_NS)
        for truth, sample in zip(bench.truths, samples, strict=True):
            assert sample.outcome is Outcome.OK
            assert sample.counts == truth.drive.position()  # at rest since the start
        assert [sample.current for sample in samples] == [-1, 0, -1, -1]
    assert [station.counts for station in exchange.stations] == [BusCounts(cycles=50)] * 4
    stuffed = b"".join(received).count(b"\xff\xff\xfd\xfd")
    assert stuffed == (0 if way == "fast" else 150)


def counts_of(bench: Bench) -> list[BusCounts]:
    return bench.group.traffic.counts


def facts_of(bench: Bench) -> list[Facts]:
    return [one.facts for one in bench.group.servos]


@pytest.mark.parametrize("who", sampled([3, 1], 2))
@pytest.mark.parametrize(
    ("fault", "error", "message"),
    [
        ("unplug", ServoLostError, r"id {} .*no longer answers"),
        ("brown-out", ServoLostError, r"id {} .*(restart|no longer answers)"),
        ("present_input_voltage=80", ServoHealthError, r"id {} .*is supplied with 8 V"),
        ("present_temperature=79", ServoHealthError, r"id {} .*wanted at most 78 °C"),
    ],
)
def test_a_servo_in_trouble_is_named_and_then_the_torque_of_all_ends(
    who: int, fault: str, error: type[ServoError], message: str
) -> None:
    bench = started(48, 48, 48)
    for _ in range(5):
        bench.cycle([0.3, 0.3, 0.3])
    if fault.startswith("present"):
        register, value = fault.split("=")
        pin(bench.truths[who - 1], register, int(value))
    else:
        bench.bus.inject(f"{fault}:id={who}", bench.clock.now_ns())
    begun = bench.clock.now_ns()
    with pytest.raises(error, match=message.format(who)) as caught:
        for _ in range(1300):
            bench.cycle([0.3] * 3)
    assert caught.value.id == who
    assert bench.group.stop() is (fault != "unplug")
    assert all(truth.memory["torque_enable"] == 0 for truth in bench.truths)
    assert bench.clock.now_ns() - begun <= 850_000_000


def test_a_lost_port_is_the_fault_of_no_servo() -> None:
    bench = started(48, 48, 48)
    bench.bus.inject("unplug-adapter", bench.clock.now_ns())
    bench.clock.wait_until(bench.clock.now_ns() + 100_000_000)  # each may have lost its watchdog
    with pytest.raises(ServoLostError, match="port is gone") as caught:
        bench.cycle([0.0] * 3)
    assert caught.value.id is None


def test_a_hardware_error_of_one_is_in_its_reading_and_explained_after_the_stop() -> None:
    bench = started(48, 48, 48)
    bench.cycle([0.3, 0.3, 0.3])
    bench.bus.inject("hardware-error:bits=overload,id=3", bench.clock.now_ns())
    assert [reading.alert for reading in bench.cycle([0.3] * 3)] == [False, False, True]
    assert bench.group.stop() is True
    assert [bool(one.trouble) for one in bench.group.servos] == [False, False, True]
    assert "has latched: overload" in bench.group.servos[2].trouble


@pytest.mark.parametrize(("count", "periods"), sampled([(2, 1), (6, 2), (3, 1)], 3))
@pytest.mark.parametrize("register", ["torque_enable", "bus_watchdog"])
def test_the_registers_of_every_servo_are_watched(count: int, periods: int, register: str) -> None:
    for who in (1, count):
        bench = started(*[48] * count, period_ns=periods * PERIOD_NS)
        bench.cycle([0.3] * count)
        bench.truths[who - 1].memory[register] = 0
        message = f"id {who} .*(is off, but this program|another setting)"
        begun = bench.clock.now_ns()
        with pytest.raises(TorqueLostError, match=message):
            for _ in range(2000):
                bench.cycle([0.3] * count)
        assert bench.clock.now_ns() - begun <= 1_010_000_000


def test_polls_go_on_while_one_servo_never_answers_its_own_and_then_the_run_ends() -> None:
    bench = started(48, 48, 48)
    real = bench.truths[1].read
    bench.truths[1].read = (  # type: ignore[method-assign]
        lambda address, size, now_ns: real(address, size, now_ns) if size in LENGTHS else None
    )
    bench.truths[2].memory["torque_enable"] = 0
    with pytest.raises(TorqueLostError, match="id 3 ") as caught:
        for _ in range(600):
            bench.cycle([0.0] * 3)
    assert caught.value.id == 3


def test_no_other_servo_keeps_its_torque_while_a_lost_one_is_looked_for() -> None:
    bench = started(48, 48, 48)
    for _ in range(5):
        bench.cycle([0.3] * 3)
    bench.bus.inject("unplug:id=2", bench.clock.now_ns())
    with pytest.raises(ServoLostError) as caught:
        for _ in range(400):
            cycle_ns = bench.clock.now_ns()
            bench.cycle([0.3] * 3)
    assert caught.value.id == 2
    looked_ns = bench.clock.now_ns() - cycle_ns
    (zeros,) = [
        Parser().feed(data)[0]
        for data in bench.line.frames[-6:]
        if data[7] == Instruction.SYNC_WRITE
    ][-1:]
    assert looked_ns < 50_000_000
    assert zeros.params == bytes([102, 0, 2, 0, 1, 0, 0, 2, 0, 0, 3, 0, 0])


def test_the_torque_of_all_ends_in_one_frame_of_zero_and_one_of_torque_off() -> None:
    bench = started(48, 48, 48)
    bench.cycle([0.3, 0.3, 0.3])
    frames = len(bench.line.frames)
    assert bench.group.stop() is True
    (zero,), (off,), *_ = [Parser().feed(data) for data in bench.line.frames[frames:]]
    assert zero.params == bytes([102, 0, 2, 0, 1, 0, 0, 2, 0, 0, 3, 0, 0])
    assert off.params == bytes([64, 0, 1, 0, 1, 0, 2, 0, 3, 0])
    assert [truth.memory["torque_enable"] for truth in bench.truths] == [0, 0, 0]
    with pytest.raises(RuntimeError, match="torque is off"):
        bench.group.write([0.1, 0.1, 0.1])
    bench.group.close()
    assert bench.line.closed == 1


@pytest.mark.parametrize("lost", [None, 1, 6])
def test_six_are_cut_in_20_ms_with_one_lost_and_quicker_with_all(lost: int | None) -> None:
    bench = started(*[48] * 6)
    bench.cycle([0.3] * 6)
    if lost:
        bench.bus.inject(f"unplug:id={lost}", bench.clock.now_ns())
    begun = bench.clock.now_ns()
    assert bench.group.stop() is (lost is None)
    assert bench.clock.now_ns() - begun <= (20_000_000 if lost else 3_000_000)
    for truth in bench.truths:
        if truth.id != lost:
            assert truth.memory["torque_enable"] == 0


def test_a_pause_is_got_over_by_every_servo_at_zero_torque() -> None:
    bench = started(48, 48, 48)
    bench.cycle()
    bench.clock.wait_until(bench.clock.now_ns() + 1_000_000_000)
    bench.bus.transmit(bench.clock.now_ns())
    assert all(truth.table.tripped for truth in bench.truths)
    rows = [bench.cycle([0.3, 0.3, 0.3]) for _ in range(9)]
    assert all(reading.outcome is Outcome.OK for row in rows[1:] for reading in row)
    for truth in bench.truths:
        assert truth.state(bench.clock.now_ns()).torque > 0.25


def test_a_short_absence_costs_the_servo_its_own_readings_alone() -> None:
    """In a fast read those behind it are not heard in the first period: it is asked last then."""
    bench = started(48, 48, 48)
    for gone in range(3):
        bench.cycle()
        bench.truths[gone].answers_from_ns = bench.clock.now_ns() + 20 * PERIOD_NS
        rows = [bench.cycle() for _ in range(40)]
        for n in {0, 1, 2} - {gone}:
            assert all(row[n].outcome is Outcome.OK for row in rows[1:])
        assert 20 <= sum(row[gone].outcome is not Outcome.OK for row in rows) <= 22
        bench.assert_true(rows[-1])


@pytest.mark.parametrize(
    ("count", "timer_ms", "watchdog_s"), sampled([(2, 16, 0.1), (3, 16, 0.2), (6, 4, 0.1)], 3)
)
def test_while_one_is_examined_no_watchdog_of_another_trips(
    count: int, timer_ms: int, watchdog_s: float
) -> None:
    bench = Bench([48] * count, watchdog_s=watchdog_s, period_ns=2 * timer_ms * PERIOD_NS)
    bench.bus._adapter = Adapter(timer_ms * PERIOD_NS, 62, 0)
    bench.group.start()
    _first, *rows = (bench.cycle([0.1] * count) for _ in range(100))  # it looks at watchdogs
    assert all(reading.outcome is Outcome.OK for row in rows for reading in row)
    assert bench.group.stop() is True
