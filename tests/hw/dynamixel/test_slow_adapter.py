"""An adapter that keeps replies back for periods: one request over several, and losses are losses.

The real driver on an emulated bus in memory behind an adapter's latency timer; the truth is looked
at from outside.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import pytest

from haptic_wall.hw.clock import SimulatedClock
from haptic_wall.hw.dynamixel.tables import MODELS
from haptic_wall.hw.emulated.adapter import Adapter
from haptic_wall.hw.emulated.bus import EmulatedBus
from haptic_wall.hw.emulated.memory_line import MemoryLine
from haptic_wall.hw.emulated.servo import EmulatedServo
from haptic_wall.hw.errors import ServoLostError, TorqueLostError
from haptic_wall.hw.servo import Check, Outcome, Reading
from tests.cases import sampled
from tests.hw.dynamixel.bench import BAUD, SETTINGS, TRUE
from tests.support.one_servo import OneServo

MS = 1_000_000
TIMER_MS = 16
CALM = replace(TRUE, position=0.0, coulomb=0.5)
"""So much friction that small torques do not move it"""


@dataclass
class Slow:
    """A started servo behind an adapter, driven period by period."""

    timer_ms: float = TIMER_MS
    period_ms: float = 1.0
    phase_ms: float = 0.0
    watchdog_s: float = 0.04
    pipelined: bool = True
    torque: float = 0.1
    clock: SimulatedClock = field(default_factory=SimulatedClock)
    readings: list[Reading] = field(default_factory=list)
    checks: list[Check] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.truth = EmulatedServo(MODELS["XM430-W350"], 1, 48, CALM, start_ns=0, baud=BAUD)
        adapter = Adapter(round(self.timer_ms * MS), 62, round(self.phase_ms * MS))
        self.bus = EmulatedBus([self.truth], baud=BAUD, start_ns=0, adapter=adapter)
        settings = replace(
            SETTINGS,
            period_s=self.period_ms * 1e-3,
            probe_torque=0.0,
            watchdog_s=self.watchdog_s,
        )
        self.servo = OneServo.driven(settings, MemoryLine(self.bus, self.clock))
        self.checks = self.servo.start()
        self.next_ns = self.clock.now_ns()
        if self.pipelined:
            self.servo.request()

    def run(self, periods: int) -> list[Reading]:
        """So many ticks; what each read."""
        first = len(self.readings)
        for _ in range(periods):
            self.next_ns += round(self.period_ms * MS)
            self.clock.wait_until(self.next_ns)
            if not self.pipelined:
                self.servo.request()
            deadline_ns = self.clock.now_ns() + round(0.8 * self.period_ms * MS)
            self.readings.append(self.servo.collect(deadline_ns))
            self.servo.write(self.torque)
            if self.pipelined:
                self.servo.request()
        return self.readings[first:]

    def stall(self, ms: float) -> None:
        """Let the loop stand still."""
        self.clock.wait_until(self.clock.now_ns() + round(ms * MS))
        self.next_ns = self.clock.now_ns()

    @property
    def outcomes(self) -> list[Outcome]:
        return [reading.outcome for reading in self.readings]


@pytest.mark.parametrize("period_ms", sampled([1.0, 2.0], 2))
@pytest.mark.parametrize("pipelined", [True, False])
@pytest.mark.parametrize("phase_ms", sampled([0.35, 0.0, 15.95, 5.9, 11.1], 2))
def test_each_reply_is_waited_for_and_none_is_lost(
    period_ms: float, pipelined: bool, phase_ms: float
) -> None:
    slow = Slow(period_ms=period_ms, pipelined=pipelined, phase_ms=phase_ms)
    slow.run(round(1000 / period_ms))
    assert set(slow.outcomes) == {Outcome.OK, Outcome.WAITING}
    counts = slow.servo.counts
    assert (counts.lost, counts.late, counts.corrupt) == (0, 0, 0)
    # One sample with each expiry of the timer; the schedule may lose one to the grid at each end.
    assert counts.cycles == slow.outcomes.count(Outcome.OK)
    assert counts.cycles == pytest.approx(1000 / TIMER_MS, abs=2)


def test_the_start_says_what_was_found_and_what_to_do() -> None:
    slow = Slow()
    (check,) = (check for check in slow.checks if check.name == "adapter reply")
    assert check.found.startswith("16.0 ms")
    assert "one sample in 16 periods" in check.found
    assert "latency timer to 1 ms" in check.found
    assert check.wanted == "at most 1.8 ms"
    assert slow.servo.traffic.reply_s == pytest.approx(0.016, abs=0.0002)


def test_a_stalled_machine_at_the_start_makes_no_slow_adapter() -> None:
    """One long reply in three is the machine's: the median is not."""
    slow = Slow(timer_ms=1)
    slow.servo.stop()
    slow.bus.inject("late:ms=12,way=reply,every=3", slow.clock.now_ns())
    slow.checks = slow.servo.start()
    assert slow.servo.traffic.reply_s == 0.0
    (check,) = (check for check in slow.checks if check.name == "adapter reply")
    assert float(check.found.split("longest ")[1].split()[0]) >= 12


def test_a_lost_reply_is_one_loss_and_the_next_one_is_used() -> None:
    slow = Slow()
    slow.run(100)
    slow.bus.inject("drop:times=1,way=reply", slow.clock.now_ns())
    after = [reading.outcome for reading in slow.run(100)]
    assert after.count(Outcome.LOST) == 1
    lost = after.index(Outcome.LOST)
    assert Outcome.OK in after[lost + 1 : lost + 1 + TIMER_MS + 2]
    assert slow.servo.counts.lost == 1
    # Given up well after it could have come, and long before two more would have.
    gap = lost - max(k for k in range(lost) if after[k] is Outcome.OK)
    assert TIMER_MS < gap < 2 * TIMER_MS


def test_a_reply_that_comes_after_it_was_given_up_is_never_used() -> None:
    slow = Slow()
    slow.run(100)
    slow.bus.inject("late:ms=40,times=1,way=reply", slow.clock.now_ns())
    after = slow.run(150)
    assert slow.servo.counts.lost == 1
    assert slow.servo.counts.late == 1
    good = [reading.sampled_ns for reading in after if reading.outcome is Outcome.OK]
    assert good == sorted(set(good))


def test_a_servo_that_falls_silent_ends_the_run_soon() -> None:
    slow = Slow()
    slow.run(100)
    began_ns = slow.clock.now_ns()
    slow.bus.inject("unplug", began_ns)
    with pytest.raises(ServoLostError, match="no longer answers"):
        slow.run(1000)
    # Two replies given up, and the looks at the Bus Watchdog.
    assert slow.clock.now_ns() - began_ns < 150 * MS


def test_a_stall_under_torque_that_trips_the_watchdog_ends_the_run() -> None:
    slow = Slow(torque=0.1)
    slow.run(100)
    slow.stall(70)
    with pytest.raises(TorqueLostError, match="heard nothing for"):
        slow.run(2)
