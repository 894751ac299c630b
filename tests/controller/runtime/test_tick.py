"""One period against a scripted servo on the simulated clock: every stage, and every failure."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray

from haptic_wall.controller.detector.settings import WatchSettings
from haptic_wall.controller.detector.watch import Watch
from haptic_wall.controller.guard.schedule import Allowed, GainSchedule, GainTable
from haptic_wall.controller.laws.delay import DelayRing
from haptic_wall.controller.laws.engagement import EngageLimits, Engagement
from haptic_wall.controller.laws.friction import Friction
from haptic_wall.controller.laws.shaped import ShapedLaw
from haptic_wall.controller.laws.velocity import BackwardDifference
from haptic_wall.controller.laws.wall import Wall
from haptic_wall.controller.runtime.changeover import Changeover
from haptic_wall.controller.runtime.checks import Safety, SafetyLimits
from haptic_wall.controller.runtime.gains import Gains
from haptic_wall.controller.runtime.handover import Inbox
from haptic_wall.controller.runtime.safety import Trip
from haptic_wall.controller.runtime.sampler import Sampler
from haptic_wall.controller.runtime.telemetry import (
    FLAG_CONTACT,
    FLAG_OFF,
    FLAG_SATURATED,
    NO_DEAD_MAN,
    Telemetry,
    Word,
)
from haptic_wall.controller.runtime.tick import Tick
from haptic_wall.hw.clock import SimulatedClock
from haptic_wall.hw.servo import Bus, Facts, Outcome, Reading, Servo

PERIOD_NS = 1_000_000
LOST = object()
WAITING = object()


def bin_of(stiffness: float, damping: float, delay: float) -> Allowed:
    return Allowed(stiffness, damping, delay, ceiling=1.0)


class ScriptedServo:
    """Answers with the positions it is given; LOST is no reply, WAITING none yet."""

    facts = Facts("scripted", 0, torque_limit=5.0, torque_step=0.0)

    def __init__(self, clock: SimulatedClock, positions: Iterable[object], age_ns: int = 0) -> None:
        self.clock, self.positions, self.age_ns = clock, list(positions), age_ns
        self.bus = Bus()
        self.sent: list[float] = []
        self.calls: list[str] = []
        self.deadlines: list[int] = []

    def request(self) -> None:
        self.calls.append("request")
        self.asked_ns = self.clock.now_ns()

    def collect(self, deadline_ns: int) -> Reading:
        self.calls.append("collect")
        self.deadlines.append(deadline_ns - self.clock.now_ns())
        position = self.positions.pop(0)
        if position in (LOST, WAITING):
            outcome = Outcome.LOST if position is LOST else Outcome.WAITING
            return Reading(outcome, math.nan, 0, self.asked_ns, math.nan, False)
        began_ns = self.clock.now_ns()
        self.clock.wait_until(self.asked_ns + self.age_ns)
        self.bus.waited_ns = self.clock.now_ns() - began_ns
        assert isinstance(position, float | int)
        return Reading(Outcome.OK, position, 0, self.asked_ns, math.nan, False)

    def write(self, torque: float) -> float:
        self.calls.append("write")
        limited = min(max(torque, -5.0), 5.0)
        self.sent.append(limited)
        return limited


class CountingWatch(Watch):
    """Counts the requests to raise the wall."""

    asked = 0

    def raise_again(self) -> None:
        self.asked += 1
        super().raise_again()


class Rig:
    def __init__(
        self,
        positions: Iterable[object],
        steps: int = 0,
        rungs: Sequence[Allowed] | None = None,
        ages: Sequence[int] = (0,),
        age_ns: int = 0,
        **wall: Any,
    ) -> None:
        self.clock = SimulatedClock(10**9)
        self.servo = ScriptedServo(self.clock, positions, age_ns)
        self.telemetry = Telemetry.create()
        rungs = rungs or [bin_of(wall.get("stiffness", 10.0), wall.get("damping", 0.0), 0.0)]
        self.schedule = GainSchedule(GainTable(rungs), list(ages), [PERIOD_NS], 90.0, 100)
        self.wall = wall.get("law") or Wall(
            0.0, 0.0, 0.0, wall.get("side", "both"), wall.get("clip", math.inf)
        )
        gains = Gains(self.schedule, self.wall, 50)
        pipelined = wall.get("pipelined", False)
        self.watch = CountingWatch(WatchSettings(1e-3))
        self.tick = Tick(
            clock=self.clock,
            servo=cast(Servo, self.servo),
            law=self.wall,
            sampler=Sampler(
                cast(Servo, self.servo),
                BackwardDifference(1e-3),
                PERIOD_NS,
                pipelined=pipelined,
            ),
            gains=gains,
            ring=DelayRing(steps),
            safety=Safety(
                SafetyLimits(
                    *(1000.0, 0.0, 0.5, 10, 3 * PERIOD_NS, PERIOD_NS),
                    driven_speed=wall.get("driven", math.inf),
                )
            ),
            watch=self.watch,
            passivity=None,
            telemetry=self.telemetry,
            period_ns=PERIOD_NS,
            wall_from_start=wall.get("from_start", False),
            inbox=Inbox(self.telemetry),
            changeover=Changeover(0.1, math.inf, 1e-3),
            engagement=Engagement(
                EngageLimits(0.1, 0.0, 3), start_room=wall.get("start_room", math.inf)
            ),
        )
        self.deadline = self.clock.now_ns()

    def run(self, count: int, missed: int = 0) -> Rig:
        for _ in range(count):
            self.deadline += (1 + missed) * PERIOD_NS
            self.clock.wait_until(self.deadline)
            self.tick.run(self.deadline, self.clock.now_ns(), missed)
        return self

    @property
    def rows(self) -> NDArray[np.void]:
        return self.telemetry.read(0)[0]


def on(rig: Rig) -> Rig:
    rig.tick.wall_on()
    return rig


def test_the_torque_is_the_walls() -> None:
    rig = on(Rig([0.1, 0.11, 0.11], stiffness=10.0, damping=0.02)).run(3)
    assert rig.servo.sent == pytest.approx([-1.0, -1.1 - 0.02 * 10.0, -1.1])


def test_order_of_a_cycle_in_both_schedules() -> None:
    assert on(Rig([0.0])).run(1).servo.calls == ["request", "collect", "write"]
    piped = on(Rig([0.0, 0.0], pipelined=True)).run(2)
    assert piped.servo.calls == ["request", *["collect", "write", "request"] * 2]


def test_warm_up_sends_zero() -> None:
    rig = Rig([0.5, 0.5])
    assert rig.run(2).servo.sent == [0.0, 0.0]


def test_delay_counts_periods() -> None:
    rig = on(Rig([0.1, 0.2, 0.3, 0.4], steps=2, stiffness=10.0)).run(4)
    assert rig.servo.sent == pytest.approx([0.0, 0.0, -1.0, -2.0])


def test_skipped_periods_shift_the_delay() -> None:
    rig = on(Rig([0.1, 0.2, 0.3], steps=2, stiffness=10.0)).run(2).run(1, missed=1)
    assert rig.servo.sent == pytest.approx([0.0, 0.0, -2.0]), "what was rendered two periods ago"


def test_skipped_periods_divide_the_difference() -> None:
    rig = on(Rig([0.1, 0.13], stiffness=0.0, damping=0.1)).run(1).run(1, missed=2)
    row = rig.rows[-1]
    assert row["velocity"] == pytest.approx(10.0)
    assert row["missed"] == 2
    assert rig.telemetry.words[Word.MISSED] == 2


def test_a_lost_reading_is_no_position_and_costs_one_period() -> None:
    rig = on(Rig([0.1, LOST, 0.104, 0.106], stiffness=10.0, damping=0.1)).run(4)
    positions = rig.rows["position"]
    velocities = rig.rows["velocity"]
    assert positions == pytest.approx([0.1, 0.1, 0.104, 0.106])
    assert velocities == pytest.approx([0.0, 0.0, 2.0, 2.0])
    assert rig.servo.sent[1] == pytest.approx(-1.0)


def test_before_the_first_reading_nothing_acts() -> None:
    rig = on(Rig([LOST, LOST, 0.1], stiffness=10.0))
    for _ in range(3):
        assert rig.run(1).tick.trip is None
    assert rig.servo.sent == pytest.approx([0.0, 0.0, -1.0])


def test_losses_trip_with_torque_off() -> None:
    rig = on(Rig([0.1] + [LOST] * 4, stiffness=10.0)).run(5)
    assert rig.tick.trip is Trip.LOSSES_IN_ROW
    assert rig.servo.sent[-1] == 0.0


def test_a_broken_torque_trips_with_torque_off() -> None:
    rig = on(Rig([0.1, 0.1], stiffness=10.0)).run(1)
    rig.wall.stiffness = math.nan
    rig.run(1)
    assert rig.tick.trip is Trip.NOT_A_NUMBER
    assert rig.servo.sent[-1] == 0.0


def test_the_cut_flag_stops_every_write() -> None:
    rig = on(Rig([0.1, 0.1], stiffness=10.0)).run(1)
    rig.telemetry.words[Word.CUT] = 1
    rig.run(1)
    assert len(rig.servo.sent) == 1


def test_saturation_and_contact_are_told() -> None:
    rig = on(Rig([0.4, 0.6], stiffness=10.0)).run(2)
    assert [bool(f & FLAG_SATURATED) for f in rig.rows["flags"]] == [False, True]
    assert all(rig.rows["flags"] & FLAG_CONTACT)
    assert rig.rows["torque"][-1] == -5.0


def test_waiting_for_the_bus_is_no_work() -> None:
    rig = on(Rig([0.0, 0.0], age_ns=300_000)).run(2)
    assert rig.rows["bus_ns"][-1] == 300_000
    assert rig.rows["work_ns"][-1] == 0, "a simulated clock stands still while the tick computes"


@pytest.mark.parametrize(
    ("side", "position", "raised"),
    [
        ("above", 0.02, False),
        ("above", 0.002, True),
        ("above", -0.02, True),
        ("below", -0.02, False),
        ("both", 0.009, True),
        ("both", 0.011, False),
    ],
)
def test_stiffer_again_only_where_that_loads_the_spring_with_no_more_than_a_small_torque(
    side: str, position: float, raised: bool
) -> None:
    """10 N·m/rad more, and 0.1 N·m is small."""
    rungs = [bin_of(20.0, 0.0, 0.0), bin_of(10.0, 0.0, 1e-3)]
    rig = on(Rig([position] * 900, rungs=rungs, ages=(0, 500_000), side=side))
    rig.servo.age_ns = 400_000
    rig.run(100)
    rig.servo.age_ns = 0
    rig.run(700)  # more than five windows of a hundred
    assert rig.rows["stiffness"][99] == 10.0
    assert rig.rows["stiffness"][-1] == (20.0 if raised else 10.0)
    assert set(rig.rows["stiffness"][99:]) <= {10.0, 20.0}, "at once: a ramp could run into contact"


def reduced(rig: Rig, scale: float, damping_scale: float) -> Rig:
    """The watch scales the wall from now on."""
    now = rig.watch.backstop.derating
    now.scale, now.damping_scale = scale, damping_scale
    rig.watch.backstop._hold.deep = math.inf
    now.elastic_limit = scale * min(5.0, rig.wall.clip)
    return rig


def test_the_watch_scales_stiffness_and_damping_from_the_tick_in_which_it_says_so() -> None:
    rig = on(Rig([0.1, 0.11, 0.1, 0.11], stiffness=10.0, damping=0.02)).run(2)
    reduced(rig, 0.25, 0.5).run(2)
    assert rig.servo.sent == pytest.approx([-1.0, -1.3, -0.25 + 0.1, -0.275 - 0.1])
    assert rig.rows["stiffness"].tolist() == [10.0, 10.0, 2.5, 2.5]
    assert rig.rows["damping"].tolist() == [0.02, 0.02, 0.01, 0.01]
    assert rig.tick.commanded == (2.5, 0.01)


def test_a_request_to_raise_is_handed_to_the_watch_and_raises_nothing_in_contact() -> None:
    rig = on(Rig([0.1] * 300, rungs=[bin_of(20.0, 0.02, 0.0)], ages=(0,)))
    reduced(rig, 0.25, 0.5).run(20)
    rig.telemetry.words[Word.RAISE] += 1
    rig.run(100)
    assert rig.watch.asked == 1
    assert set(rig.rows["stiffness"]) == {5.0}
    assert set(rig.rows["damping"]) == {0.01}


def test_while_no_reply_is_due_the_torque_is_held_and_nothing_is_lost() -> None:
    """Held with its damping: else that would act in one tick of several."""
    rig = on(Rig([0.1, 0.12, *[WAITING] * 4, 0.12], stiffness=10.0, damping=0.02)).run(7)
    held = -1.2 - 0.02 * 20.0
    assert rig.servo.sent == pytest.approx([-1.0, *[held] * 5, -1.2])
    assert rig.tick.trip is None  # four losses in a row would have tripped
    assert list(rig.rows["outcome"][2:6]) == [Outcome.WAITING] * 4
    assert list(rig.rows["age_ns"][1:6]) == [k * PERIOD_NS for k in range(5)]


def lets_go(rig: Rig) -> Rig:
    """The dead man's limit has passed."""
    rig.telemetry.words[Word.HELD_NS] = rig.clock.now_ns()
    return rig


def holds(rig: Rig) -> Rig:
    rig.telemetry.words[Word.HELD_NS] = NO_DEAD_MAN
    return rig


def test_the_wall_comes_on_in_the_third_unloaded_tick_and_not_before() -> None:
    positions = [0.5, 0.5, 0.5, 0.005, 0.5, 0.005, 0.005, 0.005, 0.1]
    rig = on(Rig(positions, stiffness=10.0, start_room=0.0)).run(9)
    assert rig.servo.sent == pytest.approx([0.0] * 7 + [-0.05, -1.0])
    assert [bool(f & FLAG_OFF) for f in rig.rows["flags"]] == [True] * 7 + [False] * 2
    assert rig.tick.came_on


def test_torque_is_out_in_the_tick_after_the_dead_man_is_let_go() -> None:
    rig = on(Rig([0.1] * 10, stiffness=10.0)).run(2)
    lets_go(rig).run(3)
    assert rig.servo.sent == pytest.approx([-1.0, -1.0, 0.0, 0.0, 0.0])
    assert [bool(f & FLAG_OFF) for f in rig.rows["flags"]] == [False] * 2 + [True] * 3


def test_nothing_that_was_delayed_comes_out_after_the_dead_man_was_let_go() -> None:
    rig = on(Rig([0.1] * 5 + [0.0] * 10, stiffness=10.0, steps=6)).run(5)
    holds(lets_go(rig).run(1)).run(9)
    assert not any(rig.servo.sent)


def test_a_dead_man_that_is_held_again_brings_the_wall_back_only_where_it_is_no_blow() -> None:
    positions = [0.1] * 3 + [0.1] * 5 + [0.009] * 4 + [0.1]
    rig = on(Rig(positions, stiffness=10.0)).run(1)
    lets_go(rig).run(1)
    holds(rig).run(11)
    assert rig.servo.sent == pytest.approx([-1.0] + [0.0] * 9 + [-0.09, -0.09, -1.0])


def test_friction_comes_on_again_after_a_pause() -> None:
    friction = ShapedLaw("friction", Friction(0.5), 0.0)
    rig = on(Rig([0.0] + [0.4] * 10, stiffness=10.0, law=friction)).run(2)
    lets_go(rig).run(1)
    holds(rig).run(5)
    assert rig.servo.sent[1] == pytest.approx(-0.5)
    assert [bool(f & FLAG_OFF) for f in rig.rows["flags"]] == [False] * 2 + [True] * 2 + [False] * 4


def test_what_an_alarm_took_stays_taken_over_a_pause() -> None:
    rig = on(Rig([0.0] * 200, rungs=[bin_of(20.0, 0.02, 0.0)]))
    reduced(rig, 0.25, 0.25).run(20)
    lets_go(rig).run(20)
    holds(rig).run(20)
    assert rig.rows["stiffness"][-1] == 5.0
    assert not rig.rows["flags"][-1] & FLAG_OFF


def test_a_wall_from_the_start_is_where_the_first_good_reading_says() -> None:
    rig = Rig([LOST, 18.8, 18.8, 18.9], stiffness=10.0, from_start=True)
    rig.wall.position = 0.05
    assert on(rig).run(4).wall.position == pytest.approx(18.85)
    assert rig.servo.sent == pytest.approx([0.0, 0.5, 0.5, -0.5])


def test_the_served_interval_goes_on_over_readings_that_failed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    plain, seen = Gains.follow, []

    def follow(self: Gains, age_ns: int, interval_ns: int, may_raise: bool) -> bool:
        seen.append(interval_ns)
        return plain(self, age_ns, interval_ns, may_raise)

    monkeypatch.setattr(Gains, "follow", follow)
    Rig([0.0, LOST, 0.0]).run(3)
    assert seen == [PERIOD_NS, 0, 2 * PERIOD_NS]
