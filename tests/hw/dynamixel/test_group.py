"""Several servos in one cycle, on the emulated bus in memory; the truth of each in view."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import pytest

from haptic_wall.hw.clock import SimulatedClock
from haptic_wall.hw.dynamixel.codec import Instruction, Parser, encode_status
from haptic_wall.hw.dynamixel.group import DynamixelGroup
from haptic_wall.hw.dynamixel.tables import MODELS, POSITION_UNIT
from haptic_wall.hw.dynamixel.together import Together, Way
from haptic_wall.hw.emulated.bus import EmulatedBus
from haptic_wall.hw.emulated.memory_line import MemoryLine
from haptic_wall.hw.emulated.servo import EmulatedServo
from haptic_wall.hw.errors import ServoLostError, ServoMissingError, UnfitServoError
from haptic_wall.hw.serialport.line import Line
from haptic_wall.hw.servo import BusCounts, Outcome, Reading
from haptic_wall.hw.settings import DriverSettings
from haptic_wall.hw.truth import TrueServo
from tests.cases import sampled
from tests.hw.dynamixel.lines import US, Fate, TroubledLine, tapped

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
        self, firmwares: Sequence[int], *, models: Sequence[str] = (), probes: bool = False
    ) -> None:
        self.clock = SimulatedClock(start_ns=123_456_789)
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
            DriverSettings("", 4_000_000, n, model, max_speed=15.0, watchdog_s=0.2)
            for n, model in enumerate(models, start=1)
        ]
        if not probes:
            settings = [replace(each, probe_torque=0.0) for each in settings]
        self.group = DynamixelGroup(settings, self.line)

    def cycle(self, torques: Sequence[float] | None = None) -> list[Reading]:
        begun = self.clock.now_ns()
        self.group.request()
        readings = self.group.collect(begun + 800_000)
        self.group.write(torques or [0.0] * len(self.truths))
        self.clock.wait_until(begun + PERIOD_NS)
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


def started(*firmwares: int, models: Sequence[str] = (), probes: bool = False) -> Bench:
    bench = Bench(firmwares, models=models, probes=probes)
    checks = bench.group.start()
    assert len(checks) == len(firmwares)
    return bench


@pytest.mark.parametrize("count", [1, 3, 6])
def test_servos_of_new_firmware_are_read_by_one_request_and_one_joint_reply(count: int) -> None:
    bench = started(*[48] * count, probes=count < 6)
    assert bench.group.way is Way.FAST
    torques = [0.3 * (-1) ** n for n in range(count)]
    frames = len(bench.line.frames)
    for _ in range(100):
        bench.assert_true(bench.cycle(torques))
    assert [c.cycles for c in bench.group.counts] == [100] * count
    assert all((c.lost, c.late, c.corrupt, c.refused) == (0, 0, 0, 0) for c in bench.group.counts)
    sent = [Parser().feed(data)[0].instruction for data in bench.line.frames[frames:]]
    assert sent == [Instruction.FAST_SYNC_READ, Instruction.SYNC_WRITE] * 100
    for torque, truth, facts in zip(torques, bench.truths, bench.group.facts, strict=True):
        acting = truth.state(bench.clock.now_ns()).torque
        assert acting == pytest.approx(torque, abs=facts.torque_step)


def test_one_old_firmware_makes_all_answer_one_by_one_to_one_request() -> None:
    bench = started(48, 44, 48)
    assert bench.group.way is Way.SYNC
    for _ in range(50):
        readings = bench.cycle([0.2, -0.2, 0.2])
        assert all(reading.outcome is Outcome.OK for reading in readings)
        bench.assert_true(readings)


def test_models_may_differ() -> None:
    bench = started(48, 48, models=["XM430-W350", "XM540-W270"])
    assert bench.group.way is Way.FAST
    sent = bench.group.write([0.5, -0.5])
    steps = [facts.torque_step for facts in bench.group.facts]
    assert sent == pytest.approx([0.5, -0.5], abs=max(steps) / 2)
    bench.assert_true(bench.cycle())


@pytest.mark.parametrize("firmwares", [(48, 48, 48), (48, 44, 48)], ids=["fast", "sync"])
@pytest.mark.parametrize("gone", sampled([0, 1, 2], 3))
def test_an_unplugged_servo_costs_its_own_readings_alone_and_comes_back(
    firmwares: tuple[int, ...], gone: int
) -> None:
    """In a fast read those behind it are not heard in the first period: it is asked last then."""
    bench = started(*firmwares)
    for _ in range(10):
        bench.cycle()
    bench.truths[gone].answers_from_ns = bench.clock.now_ns() + 50 * PERIOD_NS
    readings = [bench.cycle() for _ in range(100)]
    for row in readings:
        assert row[gone].outcome in (Outcome.OK, Outcome.LOST)
    fast = bench.group.way is Way.FAST
    for n in {0, 1, 2} - {gone}:
        bad = [k for k, row in enumerate(readings) if row[n].outcome is not Outcome.OK]
        assert bad in ([], [0]) if fast else bad == []
    lost = [row[gone].outcome is not Outcome.OK for row in readings]
    assert 49 <= sum(lost) <= 52
    assert not any(lost[53:])
    bench.assert_true(readings[-1])
    assert bench.group.restarted == []


def test_a_servo_that_lost_its_power_is_told_and_the_others_go_on() -> None:
    """Back on its feet it answers, but has no torque: as good as away."""
    bench = started(48, 48, 48)
    bench.bus.inject("brown-out:id=2", bench.clock.now_ns())
    rows = [bench.cycle() for _ in range(300)]
    assert all(row[n].outcome is Outcome.OK for row in rows[1:] for n in (0, 2))
    assert not any(row[1].outcome is Outcome.OK for row in rows)
    assert bench.group.restarted == [2]


def test_a_group_that_is_stopped_and_started_has_a_servo_that_restarted_again() -> None:
    bench = started(48, 48)
    bench.bus.inject("brown-out:id=2", bench.clock.now_ns())
    while not bench.group.restarted:
        bench.cycle()
    assert bench.group.stop()
    bench.group.start()
    assert all(reading.outcome is Outcome.OK for reading in bench.cycle())
    assert bench.group.restarted == []


def test_where_one_is_missing_nobody_else_is_said_to_have_kept_its_torque() -> None:
    bench = Bench([48, 48, 48])
    bench.bus.inject("unplug:id=2", bench.clock.now_ns())
    with pytest.raises(ServoMissingError) as caught:
        bench.group.start()
    assert "could not be read back" not in str(caught.value)
    assert bench.truths[0].memory["torque_enable"] == 0


def test_all_that_are_back_are_heard_again_after_several_were_gone() -> None:
    """None stands for ever behind one that is still missing."""
    bench = started(48, 48, 48, 48)
    bench.bus.inject("unplug:id=1", bench.clock.now_ns())
    bench.truths[2].answers_from_ns = bench.clock.now_ns() + 20 * PERIOD_NS
    rows = [bench.cycle() for _ in range(60)]
    later = [[reading.outcome is Outcome.OK for reading in row] for row in rows[25:]]
    assert later[-1] == [False, True, True, True]
    assert all(row == later[-1] for row in later)


def test_missing_servos_do_not_keep_the_others_waiting() -> None:
    bench = started(48, 48, 48)
    bench.bus.inject("unplug:id=2", bench.clock.now_ns())
    for _ in range(20):
        bench.cycle()
    assert bench.group.waited_ns < 500_000


@pytest.mark.parametrize("way", list(Way))
@pytest.mark.parametrize(
    "fault", sampled(["corrupt:p=0.05", "drop:p=0.05", "late:ms=1.5,p=0.05", "truncate:p=0.05"], 4)
)
def test_a_damaged_reply_never_becomes_somebodys_position(way: Way, fault: str) -> None:
    bench = started(48, 48, 48)
    together = Together(bench.line, [1, 2, 3], way)
    bench.bus.inject(f"{fault},way=reply", bench.clock.now_ns())
    bad = 0
    for _ in range(250):
        begun = bench.clock.now_ns()
        together.request()
        samples = together.collect(begun + 800_000)
        together.send_currents([100, -100, 0])
        bench.clock.wait_until(begun + PERIOD_NS)
        bench.bus.transmit(bench.clock.now_ns())
        for truth, sample in zip(bench.truths, samples, strict=True):
            state = truth.state(bench.clock.now_ns())
            if sample.outcome is Outcome.OK:
                slack = POSITION_UNIT + 1.5e-3 * abs(state.velocity)
                position = sample.counts * POSITION_UNIT
                assert position == pytest.approx(state.position, abs=slack)
            else:
                bad += 1
    assert bad == sum(counts.lost + counts.corrupt for counts in together.counts)
    assert 0 < bad < 250


def test_stopping_switches_the_torque_of_all_off() -> None:
    bench = started(48, 48, 48)
    bench.cycle([0.5, 0.5, 0.5])
    assert bench.group.stop() is True
    assert [truth.memory["torque_enable"] for truth in bench.truths] == [0, 0, 0]
    with pytest.raises(RuntimeError, match="torque is off"):
        bench.group.write([0.1, 0.1, 0.1])
    bench.group.close()
    assert bench.line.closed == 1


def test_a_start_that_fails_leaves_no_torque_on() -> None:
    bench = Bench([48, 48, 48])
    bench.truths[2].memory["drive_mode"] = 1
    with pytest.raises(UnfitServoError, match="reverse"):
        bench.group.start()
    assert [truth.memory["torque_enable"] for truth in bench.truths] == [0, 0, 0]


def test_two_servos_with_one_id_are_refused() -> None:
    bench = Bench([48])
    settings = DriverSettings("", 4_000_000, 1, MODEL)
    with pytest.raises(UnfitServoError, match="give each another"):
        DynamixelGroup([settings, settings], bench.line)


def cut_off(bench: Bench, keep: int) -> None:
    """Let only the first bytes of the next answers through; then there is silence."""
    inner = bench.line.read

    def read() -> bytes:
        data = inner()
        return data[:keep] if len(data) > keep else data

    bench.line.read = read


@pytest.mark.parametrize("keep", [30, 40, 60])
def test_what_a_truncated_joint_reply_costs_is_counted_by_what_arrived(keep: int) -> None:
    """Shares in front are good, the one that was cut is broken, those behind it never came."""
    bench = started(48, 48, 48)
    together = Together(bench.line, [1, 2, 3], Way.FAST)
    cut_off(bench, keep)
    together.request()
    samples = together.collect(bench.clock.now_ns() + 800_000)
    good, rest = divmod(keep - 8, 20)
    wanted = [Outcome.OK] * good + [Outcome.CORRUPT] * (rest > 0) + [Outcome.LOST] * 3
    assert [sample.outcome for sample in samples] == wanted[:3]


@pytest.mark.parametrize("way", [Way.SYNC, Way.PLAIN])
def test_a_truncated_reply_of_one_servo_is_its_own_broken_one(way: Way) -> None:
    bench = started(48, 48, 48)
    together = Together(bench.line, [1, 2, 3], way)
    bench.bus.inject("truncate:p=1,way=reply,id=2", bench.clock.now_ns())
    together.request()
    samples = together.collect(bench.clock.now_ns() + 1_600_000)
    wanted = [Outcome.OK, Outcome.CORRUPT, Outcome.OK]
    assert [sample.outcome for sample in samples] == wanted
    assert [counts.corrupt for counts in together.counts] == [0, 1, 0]


def struck(way: Way, fate: Fate) -> tuple[list[list[Outcome]], list[tuple[int, int, int]]]:
    """40 cycles of three servos of which one reply meets a fate, in the sixth.

    Returns:
        The outcomes of each cycle; what was counted of each servo: lost, late, corrupt.
    """
    bench = started(48, 48, 48)
    struck = 5 if way is Way.FAST else 3 * 5
    line = TroubledLine(
        bench.line, lambda n, reply: fate(n, reply) if n == struck else [(0, reply)]
    )
    together = Together(line, [1, 2, 3], way)
    outcomes = []
    for _ in range(40):
        begun = bench.clock.now_ns()
        together.request()
        outcomes.append([sample.outcome for sample in together.collect(begun + 800 * US)])
        bench.clock.wait_until(begun + PERIOD_NS)
    return outcomes, [(one.lost, one.late, one.corrupt) for one in together.counts]


@pytest.mark.parametrize("way", list(Way))
@pytest.mark.parametrize("late_us", [850, 1200, 2500])
def test_a_late_reply_is_one_loss_and_one_late_of_each_whose_it_was(way: Way, late_us: int) -> None:
    """Whether it comes before the next request, along with its answer, or later."""
    outcomes, counted = struck(way, lambda _, reply: [(late_us * US, reply)])
    hit = 3 if way is Way.FAST else 1
    assert [sum(map(bool, row)) for row in outcomes] == [0] * 5 + [hit] + [0] * 34
    assert counted == [(1, 1, 0)] * hit + [(0, 0, 0)] * (3 - hit)


@pytest.mark.parametrize("way", list(Way))
@pytest.mark.parametrize("later_us", sampled([100, 0, 900, 1100, 2500], 4))
def test_a_copy_of_a_reply_costs_nothing_and_is_counted_as_late(way: Way, later_us: int) -> None:
    outcomes, counted = struck(way, lambda _, reply: [(0, reply), (later_us * US, reply)])
    hit = 3 if way is Way.FAST else 1
    assert not any(any(row) for row in outcomes)
    assert counted == [(0, 1, 0)] * hit + [(0, 0, 0)] * (3 - hit)


@pytest.mark.parametrize("way", [Way.SYNC, Way.PLAIN])
def test_a_refusal_is_a_broken_reply_also_among_several(way: Way) -> None:
    outcomes, counted = struck(way, lambda _, reply: [(0, encode_status(reply[4], 3))])
    assert outcomes[5] == [Outcome.CORRUPT, Outcome.OK, Outcome.OK]
    assert counted == [(0, 0, 1), (0, 0, 0), (0, 0, 0)]


@pytest.mark.parametrize("at", range(8))
def test_a_joint_reply_with_a_broken_head_is_broken_and_not_lost(at: int) -> None:
    def fate(_number: int, reply: bytes) -> list[tuple[int, bytes]]:
        return [(0, reply[:at] + bytes([reply[at] ^ 0x40]) + reply[at + 1 :])]

    outcomes, counted = struck(Way.FAST, fate)
    assert [row != [Outcome.OK] * 3 for row in outcomes] == [n == 5 for n in range(40)]
    assert counted == [(0, 0, 1)] * 3


def test_a_restarted_clock_is_proved_by_several_replies_and_not_by_one() -> None:
    bench = started(48, 48, 48)
    together = Together(bench.line, [1, 2, 3], Way.FAST)

    def cycle() -> list[Outcome]:
        begun = bench.clock.now_ns()
        together.request()
        samples = together.collect(begun + 800_000)
        bench.clock.wait_until(begun + PERIOD_NS)
        return [sample.outcome for sample in samples]

    assert cycle() == [Outcome.OK] * 3
    bench.clock.wait_until(bench.clock.now_ns() + PERIOD_NS)
    bench.truths[1]._boot_ns -= 7_000_000_000
    assert cycle() == [Outcome.OK, Outcome.CORRUPT, Outcome.OK]
    assert together.restarted == []
    cycle()
    cycle()
    assert together.restarted == [2]


def test_a_zero_that_cannot_be_sent_keeps_nobody_from_being_switched_off(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A port that took no byte for a moment may take the next: each servo is still told."""
    bench = started(48, 48, 48)
    bench.cycle([0.5, 0.5, 0.5])
    write = bench.line.write
    failures = iter([True])

    def failing_once(data: bytes) -> None:
        if next(failures, False):
            raise ServoLostError("the port has sent nothing")
        write(data)

    monkeypatch.setattr(bench.line, "write", failing_once)
    assert bench.group.stop() is True
    assert [truth.memory["torque_enable"] for truth in bench.truths] == [0, 0, 0]


@pytest.mark.parametrize("way", list(Way))
def test_a_held_pose_whose_replies_need_stuffing_costs_no_reading(
    way: Way, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Current -1 and velocity -3 are FF FF FD side by side, which a joint reply does not stuff."""
    bench = started(48, 48, 48, 48)
    together = Together(bench.line, [1, 2, 3, 4], way)
    received = tapped(bench.line, monkeypatch)
    for id_ in (1, 3, 4):
        bench.bus.inject(f"stuffing:id={id_}", bench.clock.now_ns())
    for _ in range(50):
        begun = bench.clock.now_ns()
        together.request()
        samples = together.collect(begun + 800_000)
        together.send_currents([0, 0, 0, 0])
        bench.clock.wait_until(begun + PERIOD_NS)
        for truth, sample in zip(bench.truths, samples, strict=True):
            assert sample.outcome is Outcome.OK
            assert sample.counts == truth.drive.position()  # at rest since the start
        assert [sample.current for sample in samples] == [-1, 0, -1, -1]
    assert together.counts == [BusCounts(cycles=50)] * 4
    stuffed = b"".join(received).count(b"\xff\xff\xfd\xfd")
    assert stuffed == (0 if way is Way.FAST else 150)
