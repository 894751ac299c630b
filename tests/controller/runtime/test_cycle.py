"""One period against scripted servos on the simulated clock: every stage, and every failure."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from haptic_wall.controller.detector.settings import WatchSettings
from haptic_wall.controller.detector.watch import Watch
from haptic_wall.controller.guard.schedule import Allowed, GainSchedule, GainTable
from haptic_wall.controller.laws.delay import DelayRing
from haptic_wall.controller.laws.engagement import Engagement
from haptic_wall.controller.laws.friction import Friction
from haptic_wall.controller.laws.shaped import ShapedLaw
from haptic_wall.controller.laws.velocity import BackwardDifference
from haptic_wall.controller.laws.wall import Wall
from haptic_wall.controller.runtime.axis import Axis, Tick
from haptic_wall.controller.runtime.changeover import Changeover
from haptic_wall.controller.runtime.checks import Safety, SafetyLimits
from haptic_wall.controller.runtime.cycle import Cycle
from haptic_wall.controller.runtime.gains import Gains
from haptic_wall.controller.runtime.handover import Inbox
from haptic_wall.controller.runtime.safety import Trip
from haptic_wall.controller.runtime.telemetry import (
    FLAG_CONTACT,
    FLAG_OFF,
    FLAG_SATURATED,
    NO_DEAD_MAN,
    Telemetry,
    Word,
)
from haptic_wall.hw.clock import SimulatedClock
from haptic_wall.hw.servo import BusCounts, Check, Facts, Outcome, Reading, Traffic

PERIOD_NS = 1_000_000
LOST = object()


def bin_of(stiffness: float, damping: float, delay: float) -> Allowed:
    return Allowed(stiffness, damping, delay, ceiling=1.0)


class ScriptedBus:
    """Answers with the positions it is given; LOST is no reply.

    Each servo has a script of its own.
    """

    def __init__(
        self, clock: SimulatedClock, scripts: Sequence[Iterable[object]], age_ns: int = 0
    ) -> None:
        self.clock, self.scripts, self.age_ns = clock, [list(one) for one in scripts], age_ns
        self.facts = [Facts("scripted", 0, torque_limit=5.0, torque_step=0.0)] * len(scripts)
        self.traffic = Traffic([BusCounts() for _ in scripts])
        self.trouble = ""
        self.given_up: Callable[[], bool] = lambda: False
        self.frames: list[list[float]] = []
        self.calls: list[str] = []

    @property
    def sent(self) -> list[float]:
        """Torques of the first servo."""
        return [frame[0] for frame in self.frames]

    def health(self) -> list[tuple[float, float]]:
        return []

    def start(self) -> list[list[Check]]:
        return [[] for _ in self.scripts]

    def request(self) -> None:
        self.calls.append("request")
        self.asked_ns = self.clock.now_ns()

    def collect(self, deadline_ns: int) -> list[Reading]:  # noqa: ARG002
        self.calls.append("collect")
        return [self._reading(script.pop(0)) for script in self.scripts]

    def _reading(self, position: object) -> Reading:
        if position is LOST:
            return Reading(Outcome.LOST, math.nan, 0, self.asked_ns, math.nan, False)
        began_ns = self.clock.now_ns()
        self.clock.wait_until(self.asked_ns + self.age_ns)
        self.traffic.waited_ns = self.clock.now_ns() - began_ns
        assert isinstance(position, float | int)
        return Reading(Outcome.OK, position, 0, self.asked_ns, math.nan, False)

    def write(self, torques: Sequence[float]) -> list[float]:
        self.calls.append("write")
        self.frames.append([min(max(torque, -5.0), 5.0) for torque in torques])
        return self.frames[-1]

    def stop(self) -> bool:
        return True

    def close(self) -> None:
        pass


class Rig:
    """A cycle over servos with the same wall; one by default."""

    def __init__(
        self,
        positions: Iterable[object],
        *others: Iterable[object],
        age_ns: int = 0,
        **given: Any,
    ) -> None:
        self.clock = SimulatedClock(10**9)
        scripts = (positions, *others)
        self.bus = ScriptedBus(self.clock, scripts, age_ns)
        self.telemetry = Telemetry.create(len(scripts))
        self.inbox = Inbox(self.telemetry)
        self.axes = [made_axis(self.telemetry, self.inbox, **given) for _ in scripts]
        self.axis = self.axes[0]
        self.watch, self.wall = self.axis.watch, self.axis.law
        pipelined = given.get("pipelined", False)
        words = self.telemetry.words
        self.cycle = Cycle(
            *(self.clock, self.bus, self.axes, words, self.inbox, PERIOD_NS), pipelined=pipelined
        )
        self.deadline = self.clock.now_ns()

    def run(self, count: int, missed: int = 0) -> Rig:
        for _ in range(count):
            self.deadline += (1 + missed) * PERIOD_NS
            self.clock.wait_until(self.deadline)
            self.cycle.run(self.deadline, self.clock.now_ns(), missed)
        return self

    @property
    def rows(self) -> NDArray[np.void]:
        """Of the first servo."""
        return self.telemetry.read(0)[0][:, 0]


def made_axis(
    telemetry: Telemetry,
    inbox: Inbox,
    steps: int = 0,
    allowed: Sequence[Allowed] | None = None,
    ages: Sequence[int] = (0,),
    refusals: int = 0,
    **wall: Any,
) -> Axis:
    allowed = allowed or [bin_of(wall.get("stiffness", 10.0), wall.get("damping", 0.0), 0.0)]
    schedule = GainSchedule(GainTable(allowed), list(ages), [PERIOD_NS], 90.0, 100)
    law = wall.get("law") or Wall(0.0, 0.0, 0.0, wall.get("side", "both"))
    limits = SafetyLimits(
        *(wall.get("max_speed", 1000.0), 0.0, 0.5, 10, 3 * PERIOD_NS, PERIOD_NS, refusals),
    )
    return Axis(
        law=law,
        velocities=BackwardDifference(1e-3),
        velocity_filter=None,
        gains=Gains(schedule, law, 50),
        ring=DelayRing(steps),
        safety=Safety(limits),
        watch=Watch(WatchSettings(1e-3)),
        passivity=None,
        telemetry=telemetry,
        period_ns=PERIOD_NS,
        torque_limit=5.0,
        wall_from_start=wall.get("from_start", False),
        inbox=inbox,
        changeover=Changeover(0.1, math.inf, 1e-3),
        engagement=Engagement(0.1, 0.0, 3, start_room=wall.get("start_room", math.inf)),
    )


def on(rig: Rig) -> Rig:
    rig.cycle.wall_on()
    return rig


def test_the_torque_is_the_walls() -> None:
    rig = on(Rig([0.1, 0.11, 0.11], stiffness=10.0, damping=0.02)).run(3)
    assert rig.bus.sent == pytest.approx([-1.0, -1.1 - 0.02 * 10.0, -1.1])


def test_order_of_a_cycle_in_both_schedules() -> None:
    assert on(Rig([0.0])).run(1).bus.calls == ["request", "collect", "write"]
    piped = on(Rig([0.0, 0.0], pipelined=True)).run(2)
    assert piped.bus.calls == ["request", *["collect", "write", "request"] * 2]


def test_warm_up_sends_zero() -> None:
    rig = Rig([0.5, 0.5])
    assert rig.run(2).bus.sent == [0.0, 0.0]


def test_the_delay_counts_periods_the_skipped_ones_too() -> None:
    rig = on(Rig([0.1, 0.2, 0.3, 0.4], steps=2, stiffness=10.0)).run(3).run(1, missed=1)
    assert rig.bus.sent == pytest.approx([0.0, 0.0, -1.0, -3.0]), "rendered two periods ago"


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
    assert rig.bus.sent[1] == pytest.approx(-1.0)


def test_before_the_first_reading_nothing_acts() -> None:
    rig = on(Rig([LOST, LOST, 0.1], stiffness=10.0))
    for _ in range(3):
        assert rig.run(1).cycle.trip is None
    assert rig.bus.sent == pytest.approx([0.0, 0.0, -1.0])


def test_the_cut_flag_stops_every_write() -> None:
    rig = on(Rig([0.1, 0.1], stiffness=10.0)).run(1)
    rig.telemetry.words[Word.CUT] = 1
    rig.run(1)
    assert len(rig.bus.sent) == 1


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
    allowed = [bin_of(20.0, 0.0, 0.0), bin_of(10.0, 0.0, 1e-3)]
    rig = on(Rig([position] * 900, allowed=allowed, ages=(0, 500_000), side=side))
    rig.bus.age_ns = 400_000
    rig.run(100)
    rig.bus.age_ns = 0
    rig.run(700)  # more than five windows of a hundred
    assert rig.rows["stiffness"][99] == 10.0
    assert rig.rows["stiffness"][-1] == (20.0 if raised else 10.0)
    assert set(rig.rows["stiffness"][99:]) <= {10.0, 20.0}, "at once: a ramp could run into contact"


def reduced(rig: Rig, scale: float, damping_scale: float) -> Rig:
    """The watch scales the wall from now on."""
    now = rig.watch.backstop.wall.derating
    now.scale, now.damping_scale = scale, damping_scale
    now.soft_to = math.inf
    now.elastic_limit = scale * 5.0
    return rig


def test_the_watch_scales_stiffness_and_damping_from_the_tick_in_which_it_says_so() -> None:
    rig = on(Rig([0.1, 0.11, 0.1, 0.11], stiffness=10.0, damping=0.02)).run(2)
    reduced(rig, 0.25, 0.5).run(2)
    assert rig.bus.sent == pytest.approx([-1.0, -1.3, -0.25 + 0.1, -0.275 - 0.1])
    assert rig.rows["stiffness"].tolist() == [10.0, 10.0, 2.5, 2.5]
    assert rig.rows["damping"].tolist() == [0.02, 0.02, 0.01, 0.01]
    assert rig.axis.commanded == (2.5, 0.01)


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
    assert rig.bus.sent == pytest.approx([0.0] * 7 + [-0.05, -1.0])
    assert [bool(f & FLAG_OFF) for f in rig.rows["flags"]] == [True] * 7 + [False] * 2
    assert rig.axis.came_on


def test_torque_is_out_in_the_tick_after_the_dead_man_is_let_go() -> None:
    rig = on(Rig([0.1] * 10, stiffness=10.0)).run(2)
    lets_go(rig).run(3)
    assert rig.bus.sent == pytest.approx([-1.0, -1.0, 0.0, 0.0, 0.0])
    assert [bool(f & FLAG_OFF) for f in rig.rows["flags"]] == [False] * 2 + [True] * 3


def test_nothing_that_was_delayed_comes_out_after_the_dead_man_was_let_go() -> None:
    rig = on(Rig([0.1] * 5 + [0.0] * 10, stiffness=10.0, steps=6)).run(5)
    holds(lets_go(rig).run(1)).run(9)
    assert not any(rig.bus.sent)


def test_a_dead_man_that_is_held_again_brings_the_wall_back_only_where_it_is_no_blow() -> None:
    positions = [0.1] * 3 + [0.1] * 5 + [0.009] * 4 + [0.1]
    rig = on(Rig(positions, stiffness=10.0)).run(1)
    lets_go(rig).run(1)
    holds(rig).run(11)
    assert rig.bus.sent == pytest.approx([-1.0] + [0.0] * 9 + [-0.09, -0.09, -1.0])


def test_friction_comes_on_again_after_a_pause() -> None:
    friction = ShapedLaw("friction", Friction(0.5, 0.0), 0.0)
    rig = on(Rig([0.0] + [0.4] * 10, stiffness=10.0, law=friction)).run(2)
    lets_go(rig).run(1)
    holds(rig).run(5)
    assert rig.bus.sent[1] == pytest.approx(-0.5)
    assert [bool(f & FLAG_OFF) for f in rig.rows["flags"]] == [False] * 2 + [True] * 2 + [False] * 4


def test_what_an_alarm_took_stays_taken_over_a_pause() -> None:
    rig = on(Rig([0.0] * 200, allowed=[bin_of(20.0, 0.02, 0.0)]))
    reduced(rig, 0.25, 0.25).run(20)
    lets_go(rig).run(20)
    holds(rig).run(20)
    assert rig.rows["stiffness"][-1] == 5.0
    assert not rig.rows["flags"][-1] & FLAG_OFF


def test_a_wall_from_the_start_is_where_the_first_good_reading_says() -> None:
    rig = Rig([LOST, 18.8, 18.8, 18.9], stiffness=10.0, from_start=True)
    rig.wall.position = 0.05
    assert on(rig).run(4).wall.position == pytest.approx(18.85)
    assert rig.bus.sent == pytest.approx([0.0, 0.5, 0.5, -0.5])


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


@pytest.mark.parametrize(
    ("passed", "counted"),
    [(0.2, 0.5), (0.95, 1.0), (1.05, 1.0), (1.5, 1.5), (2.93, 3.0), (3.4, 3.4)],
)
def test_the_velocity_is_over_the_time_that_really_passed(passed: float, counted: float) -> None:
    axis = Rig([]).axis
    for position, at_ns in ((0.0, 10), (0.01, 10 + round(passed * PERIOD_NS))):
        axis.torque(Reading(Outcome.OK, position, 0, at_ns, 0.1, False), Tick())
    assert axis.velocity == pytest.approx(0.01 / (counted * 1e-3))


def test_a_jump_that_goes_away_is_refused_and_one_that_stays_trips_after_three_periods() -> None:
    away = on(Rig([0.0, 0.1, 0.1, 0.0, 0.0], refusals=3, max_speed=15.0)).run(5)
    assert list(away.rows["outcome"]) == [0, Outcome.REFUSED, Outcome.REFUSED, 0, 0]
    assert not any(away.rows["position"])
    assert away.axis.safety.refused == 2
    assert away.cycle.trip is None
    stays = on(Rig([0.0, *[0.1] * 4], refusals=3, max_speed=15.0)).run(5)
    assert list(stays.rows["outcome"]) == [0, *[Outcome.REFUSED] * 3, 0]
    assert stays.cycle.trip is Trip.OVERSPEED


# Several axes


@pytest.mark.parametrize("count", [1, 2, 6])
def test_each_axis_renders_its_own_wall_in_one_frame(count: int) -> None:
    rig = on(Rig(*([0.01 * n, 0.02 * n] for n in range(1, 1 + count)), stiffness=10.0)).run(2)
    assert rig.bus.calls == ["request", "collect", "write"] * 2
    for k, frame in enumerate(rig.bus.frames):
        assert frame == pytest.approx([-0.1 * (k + 1) * n for n in range(1, 1 + count)])
    positions = rig.telemetry.read(0)[0]["position"].T
    for n, found in enumerate(positions, start=1):
        assert found == pytest.approx([0.01 * n, 0.02 * n])


@pytest.mark.parametrize("count", [1, 2, 6])
@pytest.mark.parametrize(
    ("end", "trip"),
    [([LOST] * 4, Trip.LOSSES_IN_ROW), ([math.nan], Trip.NOT_A_NUMBER), ([9.0], Trip.OVERSPEED)],
)
def test_an_axis_that_is_lost_or_trips_sends_zero_to_all_in_the_same_frame(
    count: int, end: list[object], trip: Trip
) -> None:
    ticks = 2 + len(end)
    others: list[list[object]] = [[0.1] * ticks] * (count - 1)
    rig = on(Rig(*others, [0.1, 0.1, *end], stiffness=10.0))
    rig.run(ticks - 1)
    assert rig.cycle.trip is None
    assert rig.bus.frames[-1] == pytest.approx([-1.0] * count), "one lost reading costs no torque"
    rig.run(1)
    assert rig.cycle.trip is trip
    assert rig.bus.frames[-1] == [0.0] * count
    assert [axis.trip for axis in rig.axes] == [None] * (count - 1) + [trip]
    named = rig.telemetry.words[Word.STOP_AXIS]
    assert named == (count if count > 1 else 0)
    assert rig.rows["torque"][-1] == 0.0


def test_all_axes_count_the_oldest_sample_and_the_longest_interval(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """An interval that has not ended hides no longer one, and no shorter one shortens the mean."""
    counted: list[tuple[float, float]] = []
    follow = Gains.follow

    def counts(gains: Gains, age_ns: int, interval_ns: int, may_raise: bool) -> bool:
        counted.append((age_ns / PERIOD_NS, interval_ns / PERIOD_NS))
        return follow(gains, age_ns, interval_ns, may_raise)

    monkeypatch.setattr(Gains, "follow", counts)
    on(Rig([0.0] * 6, [0.0, LOST, 0.0, LOST, LOST, 0.0])).run(6)
    assert counted[::2] == counted[1::2]
    assert counted[::2] == [(0, 1), (1, 0), (0, 2), (1, 0), (2, 0), (0, 3)]
    counted.clear()
    on(Rig([0.0, 0.0, LOST, 0.0, LOST, 0.0], [0.0, LOST, 0.0, LOST, 0.0, 0.0])).run(6)
    assert [interval for _, interval in counted[::2]] == [1, 0, 2, 2, 2, 2]
