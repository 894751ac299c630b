"""The running cycle: what a reply is taken for when replies are lost, late, broken or doubled.

The servo's position is the time it was sampled, in microseconds, so a sample that is not the
answer to its own request shows in its position.
"""

from __future__ import annotations

import random
from collections.abc import Callable

import pytest

from haptic_wall.hw.clock import SimulatedClock
from haptic_wall.hw.dynamixel.codec import Instruction, encode_status
from haptic_wall.hw.dynamixel.link import Link
from haptic_wall.hw.dynamixel.samples import QUARANTINE, Sample
from haptic_wall.hw.dynamixel.tables import MODELS
from haptic_wall.hw.servo import Outcome
from tests.hw.dynamixel.lines import MS, US, ClockLine, Fate, TroubledLine, unharmed

PERIOD_NS = 1 * MS
REGISTERS = MODELS["XM430-W350"].registers


class Bench:
    """A link at 1 kHz, on the simulated clock, to a servo whose position is the time."""

    def __init__(self, fate: Fate = unharmed, *, period_ns: int = PERIOD_NS) -> None:
        self.clock = SimulatedClock(start_ns=1_000_000_000)
        self.servo = ClockLine(self.clock)
        self.line = TroubledLine(self.servo, fate)
        self.link = Link(self.line, 1)
        self.period_ns = period_ns

    def cycle(self) -> Sample:
        """Request, collect within the period, sleep to its end."""
        begun = self.clock.now_ns()
        self.link.request()
        sample = self.link.collect(begun + self.period_ns * 3 // 5)
        self.clock.wait_until(begun + self.period_ns)
        return sample

    def pipelined(self, cycles: int) -> list[Sample]:
        """Collect in each period what was requested in the one before."""
        samples = []
        self.link.request()
        for _ in range(cycles):
            self.clock.wait_until(self.clock.now_ns() + self.period_ns)
            samples.append(self.link.collect(self.clock.now_ns() + self.period_ns // 5))
            self.link.request()
        return samples


def is_its_own(sample: Sample) -> bool:
    """Whether the position is that of the instant the request was sent."""
    return sample.counts == sample.sampled_ns // US


def only(numbers: set[int], fate: Fate) -> Fate:
    return lambda number, reply: fate(number, reply) if number in numbers else [(0, reply)]


def lost(_number: int, _reply: bytes) -> list[tuple[int, bytes]]:
    return []


def broken(_number: int, reply: bytes) -> list[tuple[int, bytes]]:
    return [(0, reply[:12] + bytes([reply[12] ^ 0x40]) + reply[13:])]


def doubled(_number: int, reply: bytes) -> list[tuple[int, bytes]]:
    return [(0, reply), (0, reply)]


def late_by(cycles: float) -> Fate:
    return lambda _number, reply: [(round(cycles * PERIOD_NS), reply)]


def test_each_sample_is_the_one_that_was_asked_for() -> None:
    bench = Bench()
    samples = [bench.cycle() for _ in range(50)]
    assert all(sample.outcome is Outcome.OK and is_its_own(sample) for sample in samples)
    assert [sample.sampled_ns for sample in samples] == [
        1_000_000_000 + n * PERIOD_NS for n in range(50)
    ]
    assert samples[0].current == -7
    assert (bench.link.counts.cycles, bench.link.counts.late) == (50, 0)


def test_the_reply_may_travel_while_the_loop_sleeps() -> None:
    samples = Bench().pipelined(50)
    assert all(sample.outcome is Outcome.OK and is_its_own(sample) for sample in samples)


@pytest.mark.parametrize("cycles", [1, 2, 3, 7, 30])
def test_lost_replies_cost_their_own_periods_and_are_no_positions(cycles: int) -> None:
    gone = set(range(5, 5 + cycles))
    bench = Bench(only(gone, lost))
    for number in range(50):
        sample = bench.cycle()
        if number in gone:
            assert sample.outcome is Outcome.LOST
            assert sample.counts == 0
        else:
            assert sample.outcome is Outcome.OK
            assert is_its_own(sample)
    counts = bench.link.counts
    assert (counts.cycles, counts.lost, counts.late, counts.corrupt) == (50, cycles, 0, 0)


@pytest.mark.parametrize("cycles", [0.7, 1, 1.5, 2, 3, 5, 9.3])
@pytest.mark.parametrize("run", [1, 2, 3, 8])
def test_late_replies_are_counted_and_never_used(cycles: float, run: int) -> None:
    delayed = set(range(20, 20 + run))
    bench = Bench(only(delayed, late_by(cycles)))
    samples = [bench.cycle() for _ in range(60)]
    for number, sample in enumerate(samples):
        assert sample.outcome is (Outcome.LOST if number in delayed else Outcome.OK)
        assert number in delayed or is_its_own(sample)
    counts = bench.link.counts
    assert (counts.lost, counts.late, counts.corrupt) == (run, run, 0)


def test_the_length_of_a_lost_reply_is_free_again_after_ten_requests(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bench = Bench(only({5}, lost))
    lengths: list[int] = []
    write = bench.line.write

    def noted(frame: bytes) -> None:
        lengths.append(frame[10])  # of the read instruction: address, then length
        write(frame)

    monkeypatch.setattr(bench.line, "write", noted)
    for _ in range(20):
        bench.cycle()
    gone, free = lengths[5], 6 + QUARANTINE
    assert gone not in lengths[6:free] and gone in lengths[free : free + 2]


@pytest.mark.parametrize("cycles", [1, 2, 3])
def test_late_replies_are_never_used_when_pipelined(cycles: int) -> None:
    bench = Bench(only({20, 21, 30}, late_by(cycles)))
    samples = bench.pipelined(60)
    for number, sample in enumerate(samples):
        assert sample.outcome is (Outcome.LOST if number in {20, 21, 30} else Outcome.OK)
        assert sample.outcome is Outcome.LOST or is_its_own(sample)
    assert bench.link.counts.late == 3


def test_a_backlog_that_arrives_at_once_yields_only_the_newest() -> None:
    """A stalled adapter hands on all that it held: in order, and in one piece."""
    stalled = range(20, 26)

    def fate(number: int, reply: bytes) -> list[tuple[int, bytes]]:
        return [((25 - number) * PERIOD_NS if number in stalled else 0, reply)]

    bench = Bench(fate)
    samples = [bench.cycle() for _ in range(40)]
    for number, sample in enumerate(samples):
        assert sample.outcome is (Outcome.LOST if number in stalled[:-1] else Outcome.OK)
        assert sample.outcome is Outcome.LOST or is_its_own(sample)
    assert bench.link.counts.late == 5


@pytest.mark.parametrize("periods", range(1, 10))
def test_a_reply_up_to_ten_periods_late_is_known_at_any_rate(periods: int) -> None:
    """At 4 kHz all of them lie within what the tick must tolerate."""
    period_ns = PERIOD_NS // 4
    late = set(range(20, 140, 12))
    bench = Bench(
        only(late, lambda _, reply: [(periods * period_ns + 50 * US, reply)]), period_ns=period_ns
    )
    bench.servo.reply_ns = 50 * US
    for number in range(150):
        sample = bench.cycle()
        assert sample.outcome is (Outcome.LOST if number in late else Outcome.OK)
        assert sample.outcome is Outcome.LOST or is_its_own(sample)
    assert bench.link.counts.late == len(late)


@pytest.mark.parametrize("cycles", [1, 2, 3])
def test_a_copy_that_comes_later_is_not_used(cycles: int) -> None:
    bench = Bench(only({20}, lambda _, reply: [(0, reply), (cycles * PERIOD_NS, reply)]))
    samples = [bench.cycle() for _ in range(40)]
    assert all(sample.outcome is Outcome.OK and is_its_own(sample) for sample in samples)
    assert bench.link.counts.late == 1


def test_what_arrived_before_the_request_is_not_its_answer() -> None:
    """At 4 kHz neither the tick nor the length tells this copy from the sample after next."""
    period_ns = PERIOD_NS // 4
    bench = Bench(
        only({20}, lambda _, reply: [(0, reply), (period_ns * 3 // 2, reply)]), period_ns=period_ns
    )
    bench.servo.reply_ns = 50 * US
    samples = [bench.cycle() for _ in range(40)]
    assert all(sample.outcome is Outcome.OK and is_its_own(sample) for sample in samples)
    assert bench.link.counts.late == 1


def test_broken_replies_are_counted_apart_from_lost_ones() -> None:
    bench = Bench(only({5, 6, 20}, broken))
    samples = [bench.cycle() for _ in range(40)]
    assert [n for n, sample in enumerate(samples) if sample.outcome is Outcome.CORRUPT] == [
        5,
        6,
        20,
    ]
    assert all(is_its_own(sample) for sample in samples if sample.outcome is Outcome.OK)
    counts = bench.link.counts
    assert (counts.lost, counts.late, counts.corrupt) == (0, 0, 3)


@pytest.mark.parametrize("kept", [1, 5, 8, 15, 26])
def test_a_reply_cut_short_costs_only_itself(kept: int) -> None:
    bench = Bench(only({5}, lambda _, reply: [(0, reply[:kept])]))
    samples = [bench.cycle() for _ in range(20)]
    bad = [n for n, sample in enumerate(samples) if sample.outcome is not Outcome.OK]
    assert bad == [5]
    assert all(is_its_own(sample) for sample in samples if sample.outcome is Outcome.OK)
    counts = bench.link.counts
    assert (counts.lost, counts.late, counts.corrupt) == (0, 0, 1)


def test_a_reply_whose_rest_comes_after_the_deadline_is_late_and_not_broken() -> None:
    """An adapter's timer that expires in the middle of it does that."""
    bench = Bench(only({5}, lambda _, reply: [(0, reply[:9]), (PERIOD_NS, reply[9:])]))
    samples = [bench.cycle() for _ in range(20)]
    bad = [n for n, sample in enumerate(samples) if sample.outcome is not Outcome.OK]
    assert bad[0] == 5
    assert bench.link.counts.corrupt == 0
    assert all(is_its_own(sample) for sample in samples if sample.outcome is Outcome.OK)


def test_silence_behind_a_reply_cut_short_is_a_loss() -> None:
    """The remains of the first are no sign of the second."""

    def fate(number: int, reply: bytes) -> list[tuple[int, bytes]]:
        return {5: [(0, reply[:12])], 6: []}.get(number, [(0, reply)])

    bench = Bench(fate)
    samples = [bench.cycle() for _ in range(20)]
    assert [n for n, s in enumerate(samples) if s.outcome is not Outcome.OK] == [5, 6]
    assert (bench.link.counts.lost, bench.link.counts.corrupt) == (1, 1)


@pytest.mark.parametrize("rest_ms", [0.65, 0.95, 1.0])
def test_a_reply_whose_rest_was_late_is_not_counted_again_with_a_later_broken_one(
    rest_ms: float,
) -> None:
    """Whether its rest comes before the next request, after it, or along with its answer."""

    def fate(number: int, reply: bytes) -> list[tuple[int, bytes]]:
        if number == 5:
            return [(0, reply[:9]), (round(rest_ms * MS), reply[9:])]
        return broken(number, reply) if number == 15 else [(0, reply)]

    bench = Bench(fate)
    samples = [bench.cycle() for _ in range(30)]
    assert [n for n, s in enumerate(samples) if s.outcome is not Outcome.OK] == [5, 15]
    counts = bench.link.counts
    assert (counts.lost, counts.late, counts.corrupt) == (1, 1, 1)


def test_a_reply_cut_short_is_broken_also_when_another_begins_before_the_next_request() -> None:
    bench = Bench(only({5}, lambda _, reply: [(0, reply[:9]), (700 * US, reply)]))
    samples = [bench.cycle() for _ in range(20)]
    assert [n for n, s in enumerate(samples) if s.outcome is not Outcome.OK] == [5]
    counts = bench.link.counts
    assert (counts.lost, counts.late, counts.corrupt) == (0, 1, 1)


def test_a_reply_that_has_begun_behind_one_cut_short_is_not_broken_by_that() -> None:
    def fate(number: int, reply: bytes) -> list[tuple[int, bytes]]:
        if number == 5:
            return [(0, reply[:12])]
        return [(0, reply[:12]), (600 * US, reply[12:])] if number == 6 else [(0, reply)]

    bench = Bench(fate)
    samples = [bench.cycle() for _ in range(20)]
    assert [s.outcome for s in samples[5:8]] == [Outcome.LOST, Outcome.LOST, Outcome.OK]
    counts = bench.link.counts
    assert (counts.lost, counts.late, counts.corrupt) == (1, 1, 1)


def test_a_reply_in_two_pieces_is_a_reply() -> None:
    bench = Bench(lambda _, reply: [(0, reply[:9]), (100 * US, reply[9:])])
    samples = [bench.cycle() for _ in range(20)]
    assert all(sample.outcome is Outcome.OK and is_its_own(sample) for sample in samples)


def test_noise_between_replies_is_passed_over() -> None:
    bench = Bench(lambda _, reply: [(0, b"\x00\xff\xff" + reply + b"\xfd\x55")])
    samples = [bench.cycle() for _ in range(20)]
    assert all(sample.outcome is Outcome.OK and is_its_own(sample) for sample in samples)


@pytest.mark.parametrize("noise", ["fffffd00fe000755", "fffffd0001000755", "fffffd0001140055"])
@pytest.mark.parametrize("behind", [False, True])
def test_noise_that_begins_like_a_frame_costs_one_period_at_most(noise: str, behind: bool) -> None:
    """Also where it begins like a joint reply, which may hold headers, of 1800 bytes."""
    made = bytes.fromhex(noise)
    bench = Bench(only({5}, lambda _, reply: [(0, reply + made if behind else made + reply)]))
    samples = [bench.cycle() for _ in range(20)]
    assert [n for n, s in enumerate(samples) if s.outcome is not Outcome.OK] in ([], [5], [6])
    assert all(is_its_own(sample) for sample in samples if sample.outcome is Outcome.OK)


def test_a_refusal_is_no_position() -> None:
    bench = Bench(only({5}, lambda *_: [(0, encode_status(1, 3))]))
    samples = [bench.cycle() for _ in range(10)]
    assert [n for n, sample in enumerate(samples) if sample.outcome is Outcome.CORRUPT] == [5]


def test_a_reply_of_another_servo_is_no_position() -> None:
    def fate(_number: int, reply: bytes) -> list[tuple[int, bytes]]:
        params = reply[9:-2]
        return [(0, encode_status(2, 0, params))]

    bench = Bench(only({5}, fate))
    samples = [bench.cycle() for _ in range(10)]
    assert [n for n, sample in enumerate(samples) if sample.outcome is Outcome.LOST] == [5]


def test_an_alert_is_told_and_the_position_still_valid() -> None:
    bench = Bench(only({5}, lambda _, reply: [(0, encode_status(1, 0x80, reply[9:-2]))]))
    samples = [bench.cycle() for _ in range(10)]
    assert [sample.alert for sample in samples] == [n == 5 for n in range(10)]
    assert all(sample.outcome is Outcome.OK and is_its_own(sample) for sample in samples)


@pytest.mark.parametrize(
    "disturb",
    [
        lambda servo: setattr(servo, "tick_offset", servo.tick_offset - 20),
        lambda servo: setattr(servo, "tick_offset", servo.tick_offset + 20),
    ],
)
def test_a_sample_whose_clock_disagrees_is_not_used(disturb: Callable[[ClockLine], None]) -> None:
    """As a copy from another time would: the length alone cannot tell."""
    bench = Bench()
    for _ in range(10):
        bench.cycle()
    disturb(bench.servo)
    assert bench.cycle().outcome is Outcome.LOST
    assert bench.link.counts.late == 1


@pytest.mark.parametrize("rate", [0.985, 1.015])
def test_a_servo_clock_off_by_a_percent_and_a_half_is_accepted(rate: float) -> None:
    bench = Bench(only(set(range(100, 300)), lost))
    bench.servo.tick_rate = rate
    samples = [bench.cycle() for _ in range(400)]
    bad = [n for n, sample in enumerate(samples) if sample.outcome is not Outcome.OK]
    assert bad == list(range(100, 300))


def test_the_tick_may_wrap() -> None:
    bench = Bench()
    bench.servo.tick_offset = 32768 - 1000 - 10  # wraps ten periods from now
    assert all(bench.cycle().outcome is Outcome.OK for _ in range(20))


def test_a_link_that_paused_works_again() -> None:
    bench = Bench()
    bench.cycle()
    for pause_s in (0.1, 1, 9, 11, 33, 1000):
        bench.clock.wait_until(bench.clock.now_ns() + round(pause_s * 1e9))
        sample = bench.cycle()
        assert sample.outcome is Outcome.OK
        assert is_its_own(sample)


@pytest.mark.parametrize("seed", range(20))
def test_no_mixture_of_troubles_yields_a_wrong_position(seed: int) -> None:
    """A third of the replies meet something; some sampling instants come back, none is wrong."""
    random_ = random.Random(seed)

    def fate(number: int, reply: bytes) -> list[tuple[int, bytes]]:
        if random_.random() > 0.33:
            return [(0, reply)]
        trouble = random_.choice([lost, broken, doubled, late_by(random_.uniform(0.1, 9.0))])
        return trouble(number, reply)

    bench = Bench(fate)
    samples = [bench.cycle() for _ in range(500)]
    good = [sample for sample in samples if sample.outcome is Outcome.OK]
    assert all(is_its_own(sample) for sample in good)
    assert len(good) > 300
    counts = bench.link.counts
    assert counts.cycles == 500 == len(good) + counts.lost + counts.corrupt


def test_a_request_in_place_of_a_collect_gives_the_last_one_up() -> None:
    bench = Bench()
    bench.link.request()
    bench.clock.wait_until(bench.clock.now_ns() + PERIOD_NS)
    assert is_its_own(bench.cycle())
    counts = bench.link.counts
    assert (counts.cycles, counts.lost, counts.late) == (2, 1, 1)


def test_a_collect_without_a_request_is_an_error() -> None:
    bench = Bench()
    with pytest.raises(RuntimeError, match=r"call request\(\) first"):
        bench.link.collect(bench.clock.now_ns() + PERIOD_NS)
    assert bench.cycle().outcome is Outcome.OK
    with pytest.raises(RuntimeError, match=r"call request\(\) first"):
        bench.link.collect(bench.clock.now_ns() + PERIOD_NS)


@pytest.mark.parametrize("goal", [0, 1, -1, 512, -1193, 1193])
def test_a_goal_current_is_a_sync_write_to_one_servo(goal: int) -> None:
    bench = Bench()
    bench.link.send_current(goal)
    bench.link.send_current(goal)
    low, high = (goal & 0xFFFF).to_bytes(2, "little")
    wanted = (Instruction.SYNC_WRITE, 254, bytes([102, 0, 2, 0, 1, low, high]))
    assert bench.servo.written == [wanted, wanted]


def test_registers_are_written_and_read_between_samples() -> None:
    bench = Bench()
    bench.cycle()
    bench.link.request()  # its reply is under way and must not disturb
    register = REGISTERS["torque_enable"]
    assert bench.link.write_register(register, 1, PERIOD_NS) == 1
    assert bench.link.read_register(register, PERIOD_NS) == 1
    assert bench.cycle().outcome is Outcome.OK
    counts = bench.link.counts
    assert (counts.cycles, counts.lost, counts.late) == (2, 0, 0)


def test_a_register_that_is_not_answered_has_no_value() -> None:
    bench = Bench(lost)
    register = REGISTERS["torque_enable"]
    begun = bench.clock.now_ns()
    assert bench.link.read_register(register, 3 * MS) is None
    assert bench.link.write_register(register, 1, 3 * MS) is None
    assert bench.clock.now_ns() == begun + 9 * MS


class Babbling(ClockLine):
    """A bus without a servo whose floating wires are never silent: bytes come at any time."""

    def read(self) -> bytes:
        super().read()
        self.clock.wait_until(self.clock.now_ns() + 20 * US)  # reading takes time too
        return b"\x55"

    def wait(self, deadline_ns: int) -> bool:  # noqa: ARG002 - bytes are there at once
        return True


def test_a_bus_that_is_never_silent_holds_nobody_beyond_the_deadline() -> None:
    """A loop caught here would be cut by a supervisor caught here too, with the torque on."""
    clock = SimulatedClock(start_ns=1_000_000_000)
    link = Link(Babbling(clock), 1)
    link.request()
    deadline = clock.now_ns() + PERIOD_NS
    assert link.collect(deadline).outcome is not Outcome.OK
    assert deadline <= clock.now_ns() < deadline + 100 * US
    begun = clock.now_ns()
    assert link.read_register(REGISTERS["torque_enable"], PERIOD_NS) is None
    assert link.write_register(REGISTERS["torque_enable"], 0, PERIOD_NS) is None
    assert clock.now_ns() < begun + 3 * PERIOD_NS + 200 * US


def test_a_collect_that_comes_too_late_still_finds_the_reply() -> None:
    """After a stall of the machine the reply has long been there."""
    bench = Bench()
    bench.link.request()
    deadline = bench.clock.now_ns() + PERIOD_NS // 2
    bench.clock.wait_until(deadline + 5 * MS)
    assert is_its_own(bench.link.collect(deadline))


def test_the_time_waited_for_a_reply_is_that_of_the_last_request() -> None:
    bench = Bench(only({1}, lost))
    waited = []
    for _ in range(3):
        bench.cycle()
        waited.append(bench.link.waited_ns)
    assert waited == [bench.servo.reply_ns, PERIOD_NS * 3 // 5, bench.servo.reply_ns]


@pytest.mark.parametrize(("address", "end"), [(121, 160), (100, 135), (120, 136), (119, 145)])
def test_a_block_that_cannot_stand_for_the_sample_is_refused(address: int, end: int) -> None:
    """It begins too late, ends too early, or has the length of a plain request."""
    with pytest.raises(ValueError, match=f"a block from {address} to {end} does not contain"):
        Bench().link.widen(address, end)
