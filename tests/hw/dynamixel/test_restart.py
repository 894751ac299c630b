"""A servo that restarts ends the run; stalls of computer or adapter refuse no sample for ever."""

from __future__ import annotations

import random

import pytest

from haptic_wall.hw.clock import SimulatedClock
from haptic_wall.hw.dynamixel.exchange import Exchange
from haptic_wall.hw.dynamixel.registers import TICK_MODULUS
from haptic_wall.hw.errors import ServoLostError, TorqueLostError
from haptic_wall.hw.servo import Outcome
from tests.cases import sampled
from tests.hw.dynamixel.bench import TRUE, Bench
from tests.hw.dynamixel.lines import MS, ClockLine

BOOT_NS = 200 * MS
START_NS = 1_000 * MS
Holds = list[list[tuple[int, int, int]]]


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


class HoldingLine(ClockLine):
    """A servo behind an adapter that holds bytes, in each direction, and keeps their order.

    Args:
        clock: That of the loop.
        holds: Begin, end and delay [ns] of the holds of requests and of replies; without a delay
            all is held until the end.
        chance: Decides which requests are lost.
        loss: Fraction of the requests that are lost.
    """

    def __init__(self, clock: BusyClock, holds: Holds, chance: random.Random, loss: float) -> None:
        super().__init__(clock, reply_ns=100_000)
        self.stalls, self.holds, self.chance, self.loss = clock.stalls, holds, chance, loss
        self._last_ns = [0, 0]

    def write(self, data: bytes) -> None:
        if self.chance.random() >= self.loss:
            super().write(data)

    def asked_ns(self, now_ns: int) -> int:
        return self._through(0, now_ns, 0)

    def heard_ns(self, now_ns: int) -> int:
        return self._through(1, now_ns, 60_000)

    def _through(self, way: int, instant_ns: int, length_ns: int) -> int:
        for begin_ns, end_ns, delay_ns in self.holds[way]:
            if begin_ns <= instant_ns < end_ns:
                instant_ns = instant_ns + delay_ns if delay_ns else end_ns
        self._last_ns[way] = max(self._last_ns[way] + length_ns, instant_ns)
        return self._last_ns[way]


def drive(line: HoldingLine, seconds: float, period_ns: int, *, pipelined: bool) -> list[Outcome]:
    exchange, clock, outcomes = Exchange(line, [1]), line.clock, []
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
        outcomes.append(sample.outcome)
    return outcomes


def stretches(chance: random.Random, seconds: float, most: int) -> list[tuple[int, int]]:
    """Random stretches of time, from 0.1 ms to 3 s."""
    found = []
    for _ in range(chance.randrange(most + 1)):
        begin_ns = START_NS + round(chance.uniform(0, seconds) * 1e9)
        found.append((begin_ns, begin_ns + round(10 ** chance.uniform(5, 9.5))))
    return sorted(found)


def troubled(seed: int, seconds: float) -> HoldingLine:
    """Random stalls of computer and adapter, losses, drift and phase."""
    chance = random.Random(seed)
    many = chance.choice([0, 1, 5, 60])
    holds = [
        [
            (begin_ns, end_ns, chance.choice([0, 1]) * round(10 ** chance.uniform(5, 8.5)))
            for begin_ns, end_ns in stretches(chance, seconds, chance.choice([0, many]))
        ]
        for _ in range(2)
    ]
    clock = BusyClock(stretches(chance, seconds, many))
    line = HoldingLine(clock, holds, chance, chance.choice([0.0, 0.02, 0.5]))
    line.tick_offset = chance.randrange(TICK_MODULUS)
    line.tick_rate = chance.uniform(0.985, 1.015)
    return line


@pytest.mark.parametrize("seed", sampled(range(300), 30))
def test_after_a_stall_no_sample_is_refused_for_ever(seed: int) -> None:
    chance = random.Random(-seed - 1)
    line = troubled(seed, 3.0)
    period_ns = chance.choice([1, 2, 5]) * MS
    last = drive(line, 3.0, period_ns, pipelined=chance.random() < 0.5)[-200:]
    quiet_ns = line.clock.now_ns() - 1000 * MS
    held = any(end_ns > quiet_ns for way in line.holds for _, end_ns, _ in way)
    if not held and all(end_ns < quiet_ns for _, end_ns in line.stalls):
        assert last.count(Outcome.OK) > 50


@pytest.mark.parametrize(
    "phase_ms",
    [0, 204, 32_760, *sampled([5, 150, 1000, 32_600, *range(100, TICK_MODULUS, 1200)], 60)],
)
def test_a_restart_at_any_phase_of_the_clock_ends_a_run_within_a_second(phase_ms: int) -> None:
    """Its registers tell it, which are read every second.

    They are also read after a silence as long as the Bus Watchdog, and refused samples are silence.
    """
    bench = Bench(TRUE, probe_torque=0.0, watchdog_s=1.0)
    bench.servo.start()
    bench.cycle(0.0)
    now_ms = (bench.clock.now_ns() - bench.truth._boot_ns) // MS
    bench.truth._tick = (phase_ms - now_ms - 1000) % TICK_MODULUS
    bench.servo.one.station.forget()
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
        for _ in range(600):
            bench.cycle(0.1)
