"""The running cycle: what a reply is taken for when replies are lost, late, broken or doubled.

A servo's position is the time it was sampled, in microseconds, so a sample that is not the answer
to its own request shows in its position. The same holds for one servo and for several on a line.
"""

from __future__ import annotations

import random
from collections.abc import Sequence

import pytest

from haptic_wall.hw.clock import SimulatedClock
from haptic_wall.hw.dynamixel.codec import FastReply, encode_fast_status, encode_status
from haptic_wall.hw.dynamixel.exchange import Exchange
from haptic_wall.hw.dynamixel.register_access import Table
from haptic_wall.hw.dynamixel.samples import Sample
from haptic_wall.hw.dynamixel.tables import MODELS
from haptic_wall.hw.dynamixel.wire import Read
from haptic_wall.hw.servo import Outcome
from tests.cases import sampled
from tests.hw.dynamixel.lines import APART, MS, US, ClockLine, Fate, TroubledLine, unharmed

PERIOD_NS = 1 * MS
REGISTERS = MODELS["XM430-W350"].registers
SHAPES: list[tuple[int, Read]] = [(1, "plain"), (2, "sync"), (6, "fast")]
"""Servos on the line, and how they are read"""


class Bench:
    """An exchange at 1 kHz, on the simulated clock, with servos whose position is the time.

    All replies of a cycle meet the same fate, by the cycle's number; ``one_by_one``: each its own.
    """

    def __init__(
        self,
        fate: Fate = unharmed,
        shape: tuple[int, Read] = SHAPES[0],
        *,
        period_ns: int = PERIOD_NS,
        one_by_one: bool = False,
    ) -> None:
        count, way = shape
        replies = 1 if one_by_one or way == "fast" else count
        self.clock = SimulatedClock(start_ns=1_000_000_000)
        self.servo = ClockLine(self.clock)
        self.line = TroubledLine(self.servo, lambda number, reply: fate(number // replies, reply))
        self.exchange = Exchange(self.line, range(1, count + 1))
        self.exchange.select(self.exchange.stations, way)
        self.period_ns = period_ns

    def cycle(self) -> list[Sample]:
        """Request, collect within the period, sleep to its end."""
        begun = self.clock.now_ns()
        self.exchange.request()
        samples = self.exchange.collect(begun + self.period_ns * 3 // 5)
        assert 0 <= self.exchange.waited_ns <= self.clock.now_ns() - begun
        self.clock.wait_until(begun + self.period_ns)
        self.are_their_own(samples)
        return samples

    def run(self, cycles: int) -> list[list[Outcome]]:
        """Outcomes of so many cycles."""
        return [[sample.outcome for sample in self.cycle()] for _ in range(cycles)]

    def pipelined(self, cycles: int) -> list[list[Outcome]]:
        """Collect in each period what was requested in the one before."""
        rows = []
        self.exchange.request()
        for _ in range(cycles):
            self.clock.wait_until(self.clock.now_ns() + self.period_ns)
            samples = self.exchange.collect(self.clock.now_ns() + self.period_ns // 5)
            self.are_their_own(samples)
            rows.append([sample.outcome for sample in samples])
            self.exchange.request()
        return rows

    def are_their_own(self, samples: Sequence[Sample]) -> None:
        """Each position is that of its servo at the instant of its request."""
        for place, sample in enumerate(samples):
            wanted = sample.sampled_ns // US + place * APART
            if self.exchange.way == "plain" and len(samples) > 1 and sample.outcome is Outcome.OK:
                assert 0 <= sample.counts - wanted < self.period_ns // US  # asked in turn
            else:
                assert sample.counts == (wanted if sample.outcome is Outcome.OK else 0)

    def assert_counts(self, lost: int, late: int, corrupt: int) -> None:
        """What was counted of each servo."""
        for station in self.exchange.stations:
            counts = station.counts
            assert (counts.lost, counts.late, counts.corrupt) == (lost, late, corrupt), station.id


@pytest.fixture(params=SHAPES, ids=lambda shape: f"{shape[0]}-{shape[1]}")
def shape(request: pytest.FixtureRequest) -> tuple[int, Read]:
    return request.param  # type: ignore[no-any-return]


def bad(rows: Sequence[Sequence[Outcome]]) -> list[int]:
    """Cycles in which a servo was not heard."""
    return [n for n, row in enumerate(rows) if any(row)]


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


def test_each_sample_is_the_one_that_was_asked_for(shape: tuple[int, Read]) -> None:
    bench = Bench(shape=shape)
    rows = [bench.cycle() for _ in range(50)]
    for n, row in enumerate(rows):
        assert [one.sampled_ns for one in row] == [1_000_000_000 + n * PERIOD_NS] * len(row)
        assert all(one.outcome is Outcome.OK and one.current == -7 for one in row)
    assert bad(Bench(shape=shape).pipelined(50)) == []
    bench.assert_counts(0, 0, 0)
    assert [station.counts.cycles for station in bench.exchange.stations] == [50] * shape[0]


@pytest.mark.parametrize("cycles", [1, 2, 3, 7, 30])
def test_lost_replies_cost_their_own_periods(shape: tuple[int, Read], cycles: int) -> None:
    gone = set(range(5, 5 + cycles))
    bench = Bench(only(gone, lost), shape)
    rows = bench.run(50)
    assert bad(rows) == sorted(gone)
    assert rows[5] == [Outcome.LOST] * shape[0]
    bench.assert_counts(cycles, 0, 0)


@pytest.mark.parametrize("cycles", sampled([0.7, 9.3, 1, 1.5, 2, 3, 5], 3))
@pytest.mark.parametrize("run", [1, 3, 8])
def test_late_replies_are_counted_and_never_used(
    shape: tuple[int, Read], cycles: float, run: int
) -> None:
    delayed = set(range(20, 20 + run))
    bench = Bench(only(delayed, late_by(cycles)), shape)
    assert bad(bench.run(60)) == sorted(delayed)
    bench.assert_counts(run, run, 0)


@pytest.mark.parametrize("cycles", [1, 2, 3])
def test_late_replies_are_never_used_when_pipelined(shape: tuple[int, Read], cycles: int) -> None:
    bench = Bench(only({20, 21, 30}, late_by(cycles)), shape)
    assert bad(bench.pipelined(60)) == [20, 21, 30]
    bench.assert_counts(3, 3, 0)


def test_a_backlog_that_arrives_at_once_yields_only_the_newest(shape: tuple[int, Read]) -> None:
    """A stalled adapter hands on all that it held: in order, and in one piece."""
    stalled = range(20, 26)

    def fate(number: int, reply: bytes) -> list[tuple[int, bytes]]:
        return [((25 - number) * PERIOD_NS if number in stalled else 0, reply)]

    bench = Bench(fate, shape)
    assert bad(bench.run(40)) == [20, 21, 22, 23, 24]
    bench.assert_counts(5, 5, 0)


@pytest.mark.parametrize("periods", sampled([1, 30, *range(2, 30)], 3))
def test_a_reply_up_to_thirty_periods_late_is_known_at_any_rate(
    shape: tuple[int, Read], periods: int
) -> None:
    """At 4 kHz all of them lie within what the tick must tolerate."""
    period_ns = PERIOD_NS // 4
    late = set(range(20, 140, 12))
    fate = only(late, lambda _, reply: [(periods * period_ns + 50 * US, reply)])
    bench = Bench(fate, shape, period_ns=period_ns)
    bench.servo.reply_ns = 50 * US
    assert bad(bench.run(170)) == sorted(late)
    bench.assert_counts(len(late), len(late), 0)


def test_broken_replies_are_counted_apart_from_lost_ones(shape: tuple[int, Read]) -> None:
    bench = Bench(only({5, 6, 20}, broken), shape)
    rows = bench.run(40)
    assert bad(rows) == [5, 6, 20]
    assert rows[5] == [Outcome.CORRUPT] * shape[0]
    bench.assert_counts(0, 0, 3)


@pytest.mark.parametrize(
    ("count", "kept"), [(1, 1), (1, 5), (1, 26), (2, 5), (2, 8), (2, 15), (2, 26)]
)
def test_a_reply_cut_short_costs_only_itself(count: int, kept: int) -> None:
    way: Read = "sync" if count > 1 else "plain"
    bench = Bench(only({5}, lambda _, reply: [(0, reply[:kept])]), (count, way))
    assert bad(bench.run(20)) == [5]


@pytest.mark.parametrize("kept", [30, 40, 60, 68, 88, 127])
def test_of_a_joint_reply_cut_short_the_parts_in_front_are_good(kept: int) -> None:
    bench = Bench(only({5}, lambda _, reply: [(0, reply[:kept])]), (6, "fast"))
    rows = bench.run(20)
    good = (kept - 8) // 21  # the sixth request is for 17 bytes
    assert rows[5] == [Outcome.OK] * good + [Outcome.LOST] * (6 - good)
    assert bad(rows) == [5]


@pytest.mark.parametrize("rest_ms", [0.65, 0.95, 1.0])
@pytest.mark.parametrize("shape", [SHAPES[0], (3, "fast")])
def test_a_reply_whose_rest_comes_after_the_deadline_is_late_and_not_broken(
    shape: tuple[int, Read], rest_ms: float
) -> None:
    """An adapter's timer that expires in the middle of it does that."""
    rest_ns = round(rest_ms * MS)
    bench = Bench(only({5}, lambda _, reply: [(0, reply[:9]), (rest_ns, reply[9:])]), shape)
    assert bad(bench.run(30)) == [5]
    bench.assert_counts(1, 1, 0)


@pytest.mark.parametrize("shape", [SHAPES[0], SHAPES[2]])
@pytest.mark.parametrize(
    "fate",
    [
        lambda _, reply: [(0, reply[:9]), (100 * US, reply[9:])],
        lambda _, reply: [(0, b"\x00\xff\xff" + reply + b"\xfd\x55")],
    ],
    ids=["in two pieces", "between noise"],
)
def test_a_reply_is_found_wherever_it_lies(shape: tuple[int, Read], fate: Fate) -> None:
    assert bad(Bench(fate, shape).run(20)) == []


def test_a_refusal_is_no_position(shape: tuple[int, Read]) -> None:
    bench = Bench(only({5}, lambda _, reply: [(0, encode_status(reply[4] % 254, 3))]), shape)
    rows = bench.run(10)
    assert bad(rows) == [5]
    if shape[1] != "fast":  # that line knows no refused part
        assert rows[5] == [Outcome.CORRUPT] * shape[0]


def test_a_reply_of_another_servo_is_no_position() -> None:
    bench = Bench(only({5}, lambda _, reply: [(0, encode_status(9, 0, reply[9:-2]))]))
    rows = bench.run(10)
    assert (bad(rows), rows[5]) == ([5], [Outcome.LOST])


def test_a_reply_of_a_servo_that_was_not_asked_is_no_position() -> None:
    """At the start one servo of a bus is asked at a time."""
    renamed = only({5}, lambda _, reply: [(0, encode_status(2, 0, reply[9:-2]))])
    bench = Bench(renamed, (3, "sync"), one_by_one=True)
    bench.exchange.select(bench.exchange.stations[:1])
    rows = bench.run(10)
    assert (bad(rows), rows[5]) == ([5], [Outcome.LOST])


def _shares(reply: bytes) -> list[bytes]:
    """Data of the parts of a joint reply of three servos."""
    size = (len(reply) - 8) // 3
    return [reply[at + 2 : at + size - 2] for at in range(8, len(reply), size)]


@pytest.mark.parametrize("way", ["fast", "sync", "plain"])
@pytest.mark.parametrize(
    "names", [(77, 2, 3), (2, 77, 3), (1, 3, 77), (2, 1, 3), (3, 2, 1), (2, 3, 1), (2, 3, 3)]
)
def test_no_answer_is_used_where_one_bears_a_wrong_id(
    names: tuple[int, int, int], way: Read
) -> None:
    """Of three servos, which answer in turn, under these ids: an answer may be another's."""

    def renamed(number: int, reply: bytes) -> list[tuple[int, bytes]]:
        name = names[reply[4] - 1] if number // 3 == 5 else reply[4]
        return [(0, encode_status(name, 0, reply[9:-2]))]

    def joint(number: int, reply: bytes) -> list[tuple[int, bytes]]:
        named = zip(names, _shares(reply), strict=True)
        parts = [FastReply(name, 0, share) for name, share in named]
        return [(0, encode_fast_status(parts) if number == 5 else reply)]

    rows = Bench(joint if way == "fast" else renamed, (3, way), one_by_one=True).run(10)
    assert (bad(rows), rows[5]) == ([5], 3 * [Outcome.LOST])


def test_the_first_part_of_a_joint_reply_is_that_of_the_first_servo() -> None:
    """Under the id of the last one it would be used for it, as the rest of the frame is lost."""

    def broken_off(number: int, reply: bytes) -> list[tuple[int, bytes]]:
        if number != 5:
            return [(0, reply)]
        shares = _shares(reply)
        parts = [FastReply(id_, 0, share) for id_, share in zip((3, 2, 1), shares, strict=True)]
        return [(0, encode_fast_status(parts)[: 8 + (len(reply) - 8) // 3])]

    rows = Bench(broken_off, (3, "fast"), one_by_one=True).run(10)
    assert bad(rows) == [5]
    assert all(outcome is not Outcome.OK for outcome in rows[5])


def test_an_alert_is_told_and_the_position_still_valid() -> None:
    bench = Bench(only({5}, lambda _, reply: [(0, encode_status(1, 0x80, reply[9:-2]))]))
    samples = [sample for _ in range(10) for sample in bench.cycle()]
    assert [sample.alert for sample in samples] == [n == 5 for n in range(10)]
    assert all(sample.outcome is Outcome.OK for sample in samples)


@pytest.mark.parametrize("ticks", [-20, 20])
def test_a_sample_whose_clock_disagrees_is_not_used(shape: tuple[int, Read], ticks: int) -> None:
    """As a copy from another time would: the length alone cannot tell."""
    bench = Bench(shape=shape)
    bench.run(10)
    bench.servo.tick_offset += ticks
    assert bench.run(1) == [[Outcome.LOST] * shape[0]]
    bench.assert_counts(1, 1, 0)


@pytest.mark.parametrize("seed", sampled(range(40), 8))
@pytest.mark.parametrize("shape", [*SHAPES, (3, "sync"), (3, "fast")])
def test_no_mixture_of_troubles_yields_a_wrong_position(shape: tuple[int, Read], seed: int) -> None:
    """A third of the replies meet something; some sampling instants come back, none is wrong."""
    count, _ = shape
    random_ = random.Random(seed)
    share = 0.33 if count == 1 else 0.1

    def truncated(_number: int, reply: bytes) -> list[tuple[int, bytes]]:
        return [(0, reply[: random_.randrange(len(reply))])]

    def swapped(_number: int, reply: bytes) -> list[tuple[int, bytes]]:
        return [(50 * US, reply)]  # behind the one after it

    def fate(number: int, reply: bytes) -> list[tuple[int, bytes]]:
        if random_.random() > share:
            return [(0, reply)]
        fates = [lost, broken, doubled, truncated, swapped, late_by(random_.uniform(0.1, 9.0))]
        return random_.choice(fates)(number, reply)

    bench = Bench(fate, shape, one_by_one=True)
    rows = bench.run(300)
    for place, station in enumerate(bench.exchange.stations):
        good = [row[place] for row in rows].count(Outcome.OK)
        counts = station.counts
        assert good > 150
        assert counts.cycles == 300 == good + counts.lost + counts.corrupt


def test_registers_are_written_and_read_between_samples(shape: tuple[int, Read]) -> None:
    bench = Bench(shape=shape)
    bench.run(1)
    for station in bench.exchange.stations:
        bench.exchange.request()  # its replies are under way and must not disturb
        table = Table(bench.exchange, station, "", REGISTERS)
        assert table.try_write("torque_enable", 1, (PERIOD_NS,)) == 1
        assert table.try_read("torque_enable", (PERIOD_NS,)) == 1
    assert bad(bench.run(1)) == []
    bench.assert_counts(0, 0, 0)


@pytest.mark.parametrize("late_ms", [0.7, 3, 200, 400])
def test_no_late_sample_is_a_registers_value_nor_the_reverse(
    shape: tuple[int, Read], late_ms: float
) -> None:
    """Every second reply comes late: of samples and of registers, in turn."""
    bench = Bench(lambda n, reply: [(round(late_ms * MS) if n % 2 else 0, reply)], shape)
    bench.servo.registers[:147] = bytes(range(1, 148))
    tables = [Table(bench.exchange, one, "", REGISTERS) for one in bench.exchange.stations]
    for number in range(60):
        bench.cycle()
        name = ("led", "drive_mode", "temperature_limit")[number % 3]
        found = tables[number % shape[0]].try_read(name, (3 * MS,))
        assert found in (None, REGISTERS[name].address + 1)


def test_a_register_that_is_not_answered_has_no_value() -> None:
    bench = Bench(lost)
    (station,) = bench.exchange.stations
    table = Table(bench.exchange, station, "", REGISTERS)
    begun = bench.clock.now_ns()
    assert table.try_read("torque_enable", (3 * MS,)) is None
    assert table.try_write("torque_enable", 1, (3 * MS,)) is None
    assert bench.clock.now_ns() == begun + 6 * MS


class Babbling(ClockLine):
    """A bus without a servo whose floating wires are never silent: bytes come at any time."""

    def read(self) -> bytes:
        super().read()
        self.clock.wait_until(self.clock.now_ns() + 20 * US)  # reading takes time too
        return b"\x55"

    def wait(self, deadline_ns: int) -> bool:  # noqa: ARG002 - bytes are there at once
        return True


@pytest.mark.parametrize("way", ["fast", "sync"])
def test_a_bus_that_is_never_silent_holds_nobody_beyond_the_deadline(way: Read) -> None:
    """A loop caught here would be cut by a supervisor caught here too, with the torque on."""
    clock = SimulatedClock(start_ns=1_000_000_000)
    exchange = Exchange(Babbling(clock), [1, 2])
    exchange.select(exchange.stations, way)
    exchange.request()
    deadline = clock.now_ns() + PERIOD_NS
    assert not any(one.outcome is Outcome.OK for one in exchange.collect(deadline))
    assert deadline <= clock.now_ns() < deadline + 100 * US
    begun, table = clock.now_ns(), Table(exchange, exchange.stations[0], "", REGISTERS)
    assert table.try_read("torque_enable", (PERIOD_NS,)) is None
    assert table.try_write("torque_enable", 0, (PERIOD_NS,)) is None
    assert clock.now_ns() < begun + 3 * PERIOD_NS + 200 * US


def test_a_collect_that_comes_too_late_still_finds_the_reply(shape: tuple[int, Read]) -> None:
    """After a stall of the machine the reply has long been there."""
    bench = Bench(shape=shape)
    bench.exchange.request()
    deadline = bench.clock.now_ns() + PERIOD_NS // 2
    bench.clock.wait_until(deadline + 5 * MS)
    samples = bench.exchange.collect(deadline)
    bench.are_their_own(samples)
    assert all(sample.outcome is Outcome.OK for sample in samples)


def test_a_wider_block_is_read_around_the_sample_of_each_in_turn(shape: tuple[int, Read]) -> None:
    bench = Bench(shape=shape)
    wide = 147 - 64
    bench.exchange.lengths.widen(64, 147)
    bench.servo.registers[64:120] = bytes(range(64, 120))
    for asked in bench.exchange.stations:
        bench.run(1)
        assert bench.exchange.lengths.is_free(wide)
        bench.exchange.request(wide, asked)
        samples = bench.exchange.collect(bench.clock.now_ns() + PERIOD_NS)
        bench.are_their_own(samples)
        assert all(sample.outcome is Outcome.OK for sample in samples)
        assert asked.block[:56] == bytes(range(64, 120))
        lengths = {len(each.block) for each in bench.exchange.stations if each is not asked}
        assert len(asked.block) == wide and lengths <= {16, 17}


@pytest.mark.parametrize("way", ["fast", "sync"])
@pytest.mark.parametrize("later_us", sampled([100, 0, 900, 1100, 2500], 4))
def test_a_copy_of_a_reply_costs_nothing_and_is_counted_as_late(way: Read, later_us: int) -> None:
    """Of one reply in the sixth cycle of three servos."""
    copied = only({5 if way == "fast" else 15}, lambda _, r: [(0, r), (later_us * US, r)])
    bench = Bench(copied, (3, way), one_by_one=True)
    assert bad(bench.run(40)) == []
    counts = [station.counts for station in bench.exchange.stations]
    assert [one.late for one in counts] == ([1, 1, 1] if way == "fast" else [1, 0, 0])
    assert all(one.lost == one.corrupt == 0 for one in counts)
