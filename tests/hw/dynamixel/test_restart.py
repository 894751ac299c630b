"""A servo is said to have restarted if it has, and never because computer or adapter stalled."""

from __future__ import annotations

import random
import struct
from dataclasses import dataclass, field

import pytest

from haptic_wall.hw.clock import SimulatedClock
from haptic_wall.hw.dynamixel.codec import Parser, encode_status
from haptic_wall.hw.dynamixel.exchange import Exchange
from haptic_wall.hw.dynamixel.registers import TICK_MODULUS
from haptic_wall.hw.dynamixel.samples import ServoClock
from haptic_wall.hw.errors import ServoLostError, TorqueLostError
from haptic_wall.hw.servo import Outcome
from tests.cases import sampled
from tests.hw.dynamixel.bench import TRUE, Bench
from tests.hw.dynamixel.lines import MS

BOOT_NS = 200 * MS
START_NS = 1_000 * MS


class BusyClock(SimulatedClock):
    """Each reading takes some microseconds, so that a stall may begin between any two."""

    __slots__ = ("stalls",)

    def __init__(self, stalls: list[tuple[int, int]]) -> None:
        super().__init__(START_NS)
        self.stalls = stalls
        """Beginnings and ends of the computer's stalls [ns]"""

    def now_ns(self) -> int:
        self.wait_until(self._now + 3_000)
        for begin_ns, end_ns in self.stalls:
            if begin_ns <= self._now < end_ns:
                self.wait_until(end_ns)
        return self._now


@dataclass
class HoldingLine:
    """A servo behind an adapter that holds bytes, in each direction, and keeps their order.

    Attributes:
        holds: Begin, end and delay [ns] of the holds of requests and of replies; without a delay
            all is held until the end.
        restarts: When the servo restarts [ns]; its clock begins at 0.
    """

    clock: BusyClock
    holds: tuple[list[tuple[int, int, int]], list[tuple[int, int, int]]]
    restarts: list[int]
    chance: random.Random
    tick: int = 0
    rate: float = 1.0
    loss: float = 0.0
    replies: list[tuple[int, bytes]] = field(default_factory=list)
    asked: list[tuple[int, bytes]] = field(default_factory=list)
    parser: Parser = field(default_factory=Parser)
    began_ns: int | None = None
    """When the first reply since a restart was received [ns]"""

    def _through(self, way: int, instant_ns: int) -> int:
        for begin_ns, end_ns, delay_ns in self.holds[way]:
            if begin_ns <= instant_ns < end_ns:
                instant_ns = instant_ns + delay_ns if delay_ns else end_ns
        return instant_ns

    def write(self, data: bytes) -> None:
        before = self.asked[-1][0] if self.asked else 0
        arrives_ns = max(before, self._through(0, self.clock._now))
        self.asked.append((arrives_ns, data))
        booted = [at for at in self.restarts if at <= arrives_ns]
        if (booted and arrives_ns < booted[-1] + BOOT_NS) or self.chance.random() < self.loss:
            return
        passed_ms = (arrives_ns - (booted[-1] if booted else 0)) * self.rate / MS
        tick = (int(passed_ms) + (0 if booted else self.tick)) % TICK_MODULUS
        (frame,) = self.parser.feed(data)
        size = frame.params[2]
        body = struct.pack("<HHhhii", tick, 0, 0, 0, 0, arrives_ns // 1_000).ljust(size, b"\0")
        before = self.replies[-1][0] if self.replies else 0
        comes_ns = max(before + 60_000, self._through(1, arrives_ns + 100_000))
        if booted and self.began_ns is None:
            self.began_ns = comes_ns
        self.replies.append((comes_ns, encode_status(1, 0, body)))

    def read(self) -> bytes:
        now_ns = self.clock._now
        here = [data for at, data in self.replies if at <= now_ns]
        self.replies = [each for each in self.replies if each[0] > now_ns]
        return b"".join(here)

    def wait(self, deadline_ns: int) -> bool:
        first = min((at for at, _ in self.replies), default=deadline_ns)
        self.clock.wait_until(min(first, deadline_ns))
        now_ns = self.clock.now_ns()
        return any(at <= now_ns for at, _ in self.replies)

    def close(self) -> None: ...


class CountingClock(ServoClock):
    refused = 0
    """Requests in succession"""
    sent_ns = 0

    def __init__(self, line: HoldingLine) -> None:
        super().__init__()
        self.line = line
        self.old: tuple[int, int] | None = None
        """The last accepted tick before a restart, and when it was requested [ns]"""
        self.telling: set[int] = set()
        """Ticks since that no held reply of the old clock would have"""

    def accept(self, tick: int, sent_ns: int, now_ns: int) -> bool:
        accepted = super().accept(tick, sent_ns, now_ns)
        self.refused = 0 if accepted else self.refused + (sent_ns != self.sent_ns)
        self.sent_ns = sent_ns
        if self.line.began_ns is None or now_ns < self.line.began_ns:
            self.old = (tick, sent_ns) if accepted else self.old
        elif self.old is not None:
            held_ms = 1.05 * (now_ns - self.old[1]) / MS + 250
            if (tick - self.old[0] + 10) % TICK_MODULUS > held_ms:
                self.telling.add(tick)
            elif accepted:
                self.old = None
        return accepted


@dataclass
class Run:
    """What came of it."""

    named: bool = False
    """The servo was said to have restarted"""
    refused: int = 0
    """Samples refused in succession until then"""
    telling: int = 0
    """Samples that show the restart"""
    outcomes: list[Outcome] = field(default_factory=list)


def drive(line: HoldingLine, seconds: float, period_ns: int, *, pipelined: bool) -> Run:
    exchange, clock, run = Exchange(line, [1]), line.clock, Run()
    (station,) = exchange.stations
    station.clock = servo_clock = CountingClock(line)
    station.accept = servo_clock.accept
    end_ns = START_NS + round(seconds * 1e9)
    if pipelined:
        exchange.request()
    while (begun_ns := clock.now_ns()) < end_ns:
        if pipelined:
            clock.wait_until(begun_ns + period_ns)
            (sample,) = exchange.collect(clock.now_ns() + period_ns // 5)
            exchange.request()
        else:
            exchange.request()
            (sample,) = exchange.collect(begun_ns + period_ns * 4 // 5)
            clock.wait_until(begun_ns + period_ns)
        run.outcomes.append(sample.outcome)
        if servo_clock.restarted:
            run.named, run.refused = True, servo_clock.refused
            break
    run.telling = len(servo_clock.telling)
    return run


def stretches(chance: random.Random, seconds: float, most: int) -> list[tuple[int, int]]:
    """Random stretches of time, from 0.1 ms to 3 s."""
    found = []
    for _ in range(chance.randrange(most + 1)):
        begin_ns = START_NS + round(chance.uniform(0, seconds) * 1e9)
        found.append((begin_ns, begin_ns + round(10 ** chance.uniform(5, 9.5))))
    return sorted(found)


def troubled(
    seed: int, seconds: float, restarts: list[int], *, stalled: bool = True
) -> HoldingLine:
    """Random stalls of computer and adapter, losses, drift and phase."""
    chance = random.Random(seed)
    many = chance.choice([0, 1, 5, 60]) if stalled else 0
    holds = [
        [
            (begin_ns, end_ns, chance.choice([0, 1]) * round(10 ** chance.uniform(5, 8.5)))
            for begin_ns, end_ns in stretches(chance, seconds, chance.choice([0, many]))
        ]
        for _ in range(2)
    ]
    clock = BusyClock(stretches(chance, seconds, many))
    return HoldingLine(
        clock,
        (holds[0], holds[1]),
        restarts,
        chance,
        tick=chance.randrange(TICK_MODULUS),
        rate=chance.uniform(0.985, 1.015),
        loss=chance.choice([0.0, 0.02, 0.5]),
    )


@pytest.mark.parametrize("seed", sampled(range(3000), 100))
def test_no_stall_is_a_restart(seed: int) -> None:
    chance = random.Random(-seed - 1)
    line = troubled(seed, 3.0, [])
    period_ns = chance.choice([1, 2, 5]) * MS
    run = drive(line, 3.0, period_ns, pipelined=chance.random() < 0.5)
    assert not run.named
    last = run.outcomes[-200:]
    held = any(end_ns > line.clock._now - 1000 * MS for way in line.holds for _, end_ns, _ in way)
    if not held and all(end < line.clock._now - 1000 * MS for _, end in line.clock.stalls):
        assert last.count(Outcome.OK) > 50  # and none is refused for ever


@pytest.mark.parametrize("stalled", [False, True])
@pytest.mark.parametrize("seed", sampled(range(1000), 50))
def test_each_restart_is_told_by_three_samples(seed: int, *, stalled: bool) -> None:
    """Not if the new clock reads what a held reply would: no tick tells them apart."""
    chance = random.Random(-seed - 1)
    at_ns = START_NS + round(chance.uniform(0.1, 1.0) * 1e9)
    line = troubled(seed, 2.0, [at_ns], stalled=stalled)
    run = drive(line, 5.0, chance.choice([1, 2, 5]) * MS, pipelined=chance.random() < 0.5)
    assert run.named or run.telling < 3
    if run.named and not stalled:
        assert run.refused == 3


@pytest.mark.parametrize(
    "phase_ms",
    [0, 204, 32_760, *sampled([5, 150, 1000, 32_600, *range(100, TICK_MODULUS, 300)], 60)],
)
def test_a_restart_at_any_phase_of_the_clock_ends_a_run_within_a_second(phase_ms: int) -> None:
    """Where the clock does not tell it, the servo's registers do, which are read every second.

    They are also read after a silence as long as the Bus Watchdog, and refused samples are silence.
    """
    bench = Bench(TRUE, probe_torque=0.0, watchdog_s=1.0)
    bench.servo.start()
    bench.cycle(0.0)
    now_ms = (bench.clock.now_ns() - bench.truth._boot_ns) // MS
    bench.truth._tick = (phase_ms - now_ms - 1000) % TICK_MODULUS
    bench.servo._one.station.forget()
    for _ in range(1000):
        bench.cycle(0.0)
    bench.truth.reboot(bench.clock.now_ns())
    with pytest.raises(TorqueLostError):
        for _ in range((BOOT_NS + 1000 * MS) // MS):
            bench.cycle(0.1)


@pytest.mark.parametrize("watchdog_s", [0.04, 0.1, 0.2, 0.5])
def test_a_restart_is_named_where_it_outlasts_the_watchdog(watchdog_s: float) -> None:
    bench = Bench(TRUE, probe_torque=0.0, watchdog_s=watchdog_s)
    bench.servo.start()
    bench.cycle(0.1)
    bench.truth.reboot(bench.clock.now_ns())
    with pytest.raises(ServoLostError, match="restart"):
        for _ in range(300):
            bench.cycle(0.1)
