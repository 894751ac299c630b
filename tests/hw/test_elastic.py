"""A loop and its bus wait for each other: no stall of either is seen in the time they share."""

import heapq
import random
from collections.abc import Iterator

import pytest

from haptic_wall.hw.elastic import (
    COUPLED,
    DEBT_S,
    OFFSET,
    UNTIL,
    WAITED,
    WORDS,
    BusClock,
    ElasticClock,
)

MS = 1_000_000
REPLY_NS = 100_000
"""From an instruction to its reply"""


class Pair:
    """A loop and a bus, each on one look at a fake system clock; stalls come at any look."""

    def __init__(self, seed: int, period_ns: int, often: float, longest_ns: int) -> None:
        self.chance = random.Random(seed)
        self.often, self.longest_ns = often, longest_ns
        self.real = self.chance.randrange(10**15)
        self.stalls_ns = 0
        self.period_ns = period_ns
        self.words = memoryview(bytearray(8 * WORDS)).cast("q")
        self.loop = ElasticClock(self.words, period_ns, lambda: self.real, lambda _: None)
        self.bus = BusClock(self.words, lambda: self.real)
        self.to_bus: list[int] = []  # when each frame arrives, on the system's clock
        self.to_loop: list[int] = []
        self.looks: dict[str, list[int]] = {"loop": [0], "bus": [0]}
        self.worst: dict[str, int] = dict.fromkeys(("reply", "lateness", "apart"), 0)
        self.bus_dead, self.dies_at, self.seen_dying = False, -1, False

    def look(self, who: str) -> int:
        now = (self.loop if who == "loop" else self.bus).now_ns()
        assert now >= self.looks[who][-1], "time does not go back"
        if who == "bus" and self.words[COUPLED]:
            assert now <= max(self.words[UNTIL], self.looks[who][-1]), "no further than promised"
        self.looks[who].append(now)
        return now

    def run(self, periods: int) -> None:
        actors = [self.as_loop(periods), self.as_bus()]
        queue = [(self.real, 0), (self.real, 1)]
        while queue:
            self.real, number = heapq.heappop(queue)
            pause = next(actors[number], None)
            if pause is None:
                if number == 0:
                    return
                continue
            if self.chance.random() < self.often:
                stall = self.chance.randrange(self.longest_ns)
                self.stalls_ns += stall
                pause += stall
            heapq.heappush(queue, (self.real + pause, number))

    def as_loop(self, periods: int) -> Iterator[int]:
        """Yield pauses: a request, its reply, a goal, and sleep to the next deadline."""
        loop, period_ns = self.loop, self.period_ns
        loop.engage()
        deadline = self.look("loop") + period_ns
        for number in range(periods):
            if number == self.dies_at:
                self.bus_dead = True
                self.words[COUPLED] &= not self.seen_dying
            loop.promise(deadline)
            while (left := deadline - self.look("loop")) > 0:
                yield left
            woke = self.looks["loop"][-1]
            self.worst["lateness"] = max(self.worst["lateness"], woke - deadline)
            yield 20_000
            self.look("loop")
            loop.sent(10)
            self.to_bus.append(self.real + self.chance.randrange(5_000, 60_000))
            loop.expect(woke + period_ns * 4 // 5)
            while not (self.to_loop and self.to_loop[0] <= self.real):
                yield 15_000
                self.look("loop")
                if self.bus_dead and self.looks["loop"][-1] > woke + period_ns:
                    return
            self.to_loop.clear()
            self.worst["reply"] = max(self.worst["reply"], self.look("loop") - woke)
            loop.got(25)
            yield 100_000
            self.look("loop")
            loop.sent(14)
            self.to_bus.append(-self.real - self.chance.randrange(5_000, 60_000))
            yield 10_000
            self.look("loop")
            deadline += period_ns

    def as_bus(self) -> Iterator[int]:
        """Yield pauses: as the server, which sleeps to its next event or bytes."""
        taken = given = 0
        due: int | None = None
        while not self.bus_dead:
            now = self.look("bus")
            if due is not None:  # both are awake
                apart = abs(now - self.looks["loop"][-1])
                self.worst["apart"] = max(self.worst["apart"], apart)
            if due is not None and due <= now:
                due, given = None, given + 25
                self.to_loop.append(self.real + self.chance.randrange(5_000, 60_000))
            if self.to_bus and abs(self.to_bus[0]) <= self.real:
                goal = self.to_bus.pop(0) < 0
                taken += 14 if goal else 10
                due = due if goal else now + REPLY_NS
            self.bus.report(taken, given, due)
            yield 15_000


@pytest.mark.parametrize("period_ns", [MS, 2 * MS, 10 * MS])
@pytest.mark.parametrize(("often", "longest_ns"), [(0.0, 1), (0.002, 100 * MS), (0.2, 5 * MS)])
def test_a_stall_of_either_is_not_in_their_time(
    period_ns: int, often: float, longest_ns: int, thorough: bool
) -> None:
    for seed in range(200 if thorough else 1):
        pair = Pair(seed, period_ns, often, longest_ns)
        begun, periods = pair.real, 60
        pair.run(periods)
        taken_out = pair.words[OFFSET]
        assert pair.look("loop") + taken_out == pair.real, "all that passed is in one of them"
        assert taken_out <= pair.stalls_ns
        assert pair.words[WAITED] <= taken_out
        assert pair.worst["lateness"] < period_ns, "no period is missed"
        assert pair.worst["apart"] <= 0.6 * period_ns
        assert often > 0.1 or pair.worst["reply"] <= 0.8 * period_ns, "no reply is lost"
        passed = pair.real - begun - taken_out
        assert passed == pytest.approx(periods * period_ns, abs=1.5 * period_ns)


@pytest.mark.parametrize("seen", [False, True])
def test_a_dead_bus_is_waited_for_no_longer_than_the_patience(seen: bool) -> None:
    pair = Pair(3, MS, 0.0, 1)
    pair.dies_at, pair.seen_dying = 20, seen  # by the supervisor
    begun = pair.real
    pair.run(100)
    waited_s = (pair.real - begun) * 1e-9 - 0.02
    assert waited_s == pytest.approx(0.0 if seen else DEBT_S, abs=0.01)


def test_outside_of_a_run_it_is_the_systems_clock() -> None:
    pair = Pair(5, MS, 0.0, 1)
    for clock in (pair.loop, pair.bus):
        assert clock.now_ns() == pair.real
        pair.real += 10 * 10**9
        assert clock.now_ns() == pair.real
