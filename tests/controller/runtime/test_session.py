"""The whole controller on the simulated clock: deterministic, stable where the guard says so."""

import math
from itertools import count
from pathlib import Path
from typing import NoReturn

import numpy as np
import pytest

from haptic_wall.controller.errors import ConfigError
from haptic_wall.controller.runtime.cycle import Cycle
from haptic_wall.controller.runtime.gains import Gains
from haptic_wall.controller.runtime.telemetry import (
    FLAG_OFF,
    FLAG_SATURATED,
    NO_DEAD_MAN,
    Telemetry,
    Word,
)
from haptic_wall.controller.settings.load import load_config
from haptic_wall.controller.theory import critical_stiffness
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.hw.clock import SimulatedClock
from haptic_wall.hw.dynamixel.group import DynamixelGroup
from haptic_wall.hw.errors import UnfitServoError
from tests.cases import sampled
from tests.support.program import Cli
from tests.support.simulated_run import Rows, session
from tests.typed import not_none

LINEAR = ["servo.coulomb=0", "servo.hand=none", "wall.side=both", "servo.counts_per_rev=0"]
LINEAR += ["servo.torque_step=0", "servo.torque_limit=100"]


def stalls(
    clock: SimulatedClock, after: int, seconds: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Let a tick last so long, after so many others."""
    plain, ticks = Gains.follow, count()

    def follow(self: Gains, age_ns: int, interval_ns: int, may_raise: bool) -> bool:
        if next(ticks) == after:
            clock.wait_until(clock.now_ns() + round(seconds * 1e9))
        return plain(self, age_ns, interval_ns, may_raise)

    monkeypatch.setattr(Gains, "follow", follow)


def heights(rows: Rows) -> tuple[float, float]:
    """Largest distance from the wall in the first and in the last quarter."""
    position: FloatArray = rows["position"]
    distance = np.abs(position)
    quarter = len(distance) // 4
    return distance[:quarter].max(), distance[-quarter:].max()


@pytest.mark.usefixtures("undrawn")
def test_the_report_of_a_simulated_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cli: Cli
) -> None:
    monkeypatch.chdir(tmp_path)
    report = cli.json("run", "simulated", "--set=loop.clock=simulated", "--duration=0.5")
    assert report["ticks"] == 500
    assert report["missed_ticks"] == 0
    assert report["rate_hz"] == pytest.approx(1000.0)
    assert report["bus"] is None
    assert report["oscillation"]["state"] == "quiet"
    delay = report["delay_s"]
    assert delay["measured"] == 0.0
    assert delay["total"] == delay["inserted"] + delay["device"]
    assert report["stop_reason"] == "duration"
    assert (tmp_path / report["log"]).exists()
    assert (tmp_path / report["plot"]).exists()


@pytest.mark.parametrize("steps", sampled([3, 0], 2))
@pytest.mark.parametrize("lag", sampled([0.0004, 0.0], 2))
def test_motion_decays_below_the_exact_limit_and_grows_above(steps: int, lag: float) -> None:
    inertia, damping, virtual = 0.011951, 0.011692, 0.03
    limit = float(critical_stiffness(inertia, damping, virtual, 1e-3, steps * 1e-3 + lag))
    for factor, grows in ((0.97, False), (1.03, True)):
        _, rows = session(
            "simulated",
            *LINEAR,
            "guard.mode=off",
            f"delay.steps={steps}",
            f"servo.delay={lag}",
            f"wall.stiffness={factor * limit}",
            f"wall.damping={virtual}",
            "servo.kick=0.001",
            "safety.max_speed=1e6",
            duration=6.0,
        )
        first, last = heights(rows)
        assert bool(last > first) is grows, f"{factor} of the limit"


def test_the_driver_on_a_bus_in_memory_renders_the_same_wall() -> None:
    _, plain = session("simulated", "servo.kick=-0.1", duration=5.0)
    result, bus = session("emulated-ideal", "servo.kick=-0.1", duration=2.7)
    assert (
        not_none(result.bus)["lost"]
        == not_none(result.bus)["late"]
        == not_none(result.bus)["corrupt"]
        == 0
    )
    assert 0.0 < not_none(result.delay)["measured"] < 0.5e-3
    assert bus["position"].max() == pytest.approx(plain["position"].max(), abs=0.01)
    assert bus["torque"].min() == pytest.approx(plain["torque"].min(), rel=0.05)


@pytest.mark.parametrize("rate", sampled([500, 250, 1000], 3))
@pytest.mark.parametrize("schedule", ["immediate", "pipelined"])
def test_rates_and_schedules_on_a_bus_in_memory(rate: int, schedule: str) -> None:
    result, rows = session(
        "emulated-ideal",
        f"loop.rate_hz={rate}",
        f"servo.schedule={schedule}",
        duration=0.4,
    )
    assert result.stop_reason == "duration"
    assert result.ticks == round(0.4 * rate)
    assert not_none(result.bus)["lost"] == not_none(result.bus)["late"] == 0
    ages = rows["age_ns"] * rate / 1e9
    if schedule == "pipelined":
        assert np.all((ages > 0.9) & (ages < 1.2)), "a period old, and counted"
    else:
        assert np.all(ages < 0.5)


def test_a_stop_before_the_start_never_switches_the_torque_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def start(_: object) -> NoReturn:
        raise AssertionError("started")

    monkeypatch.setattr(DynamixelGroup, "start", start)
    telemetry = Telemetry.create()
    telemetry.words[Word.STOP] = 1
    result, _ = session("emulated-ideal", telemetry=telemetry)
    assert result.stop_reason == "interrupted"
    assert result.torque_off, "and read back"


def test_an_end_in_the_warm_up_counts_no_ticks() -> None:
    telemetry = Telemetry.create()

    def stop(_: object) -> None:
        telemetry.words[Word.STOP] = 1

    result, _ = session("emulated-ideal", telemetry=telemetry, tell=stop)
    assert (result.stop_reason, result.ticks, result.elapsed_s) == ("interrupted", 0, 0.0)
    assert telemetry.words[Word.TICKS] == 0


@pytest.mark.parametrize("stalled", sampled([500, 499, 999, 700], 2))
def test_every_period_is_a_tick_or_missed(stalled: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Wherever a stall falls: in the warm-up's last tick, the first or the last of the run."""
    clock = SimulatedClock()
    stalls(clock, stalled, 7.3e-3, monkeypatch)
    result, rows = session("emulated-ideal", duration=0.5, clock=clock, warm_up=True)
    assert result.ticks + result.missed == round(result.elapsed_s * result.grid_hz)
    assert (result.missed > 0) is (stalled >= 500)
    assert [row for row in rows["missed"] if row] == [result.missed or 6]


def test_a_torque_lost_in_a_stall_beyond_the_end_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = SimulatedClock()
    stalls(clock, 2399, 3.0, monkeypatch)
    result, _ = session("emulated-ideal", clock=clock)
    assert result.ticks == 1900 and result.missed > 2900
    assert result.stop_reason == "trip:torque_lost"


def test_the_wall_waits_for_a_shaft_that_was_pushed_into_it() -> None:
    """A lean during the warm-up: the wall must not strike a shaft that it comes on around."""
    telemetry = Telemetry.create()
    told: list[str] = []

    def tell(text: str) -> None:
        told.append(text)
        if "turn the shaft" in text:
            telemetry.words[Word.STOP] = 1

    sets = ["loop.warm_up_s=3", "servo.hand=lean", "servo.kick=-0.001"]
    result, rows = session("emulated-ideal", *sets, telemetry=telemetry, tell=tell, warm_up=True)
    assert "turn the shaft below 0.0° (0.00 turns)" in told[-1]
    assert (result.stop_reason, result.ticks) == ("interrupted", 0)
    assert rows["position"][-1] > 0.0
    assert not np.any(rows["torque"])
    assert not result.wall_came_on


@pytest.mark.parametrize("preset", ["simulated", "emulated-ideal"])
@pytest.mark.parametrize("turns", sampled([-3, 3], 2))
def test_a_two_sided_wall_does_not_come_on_three_turns_away(preset: str, turns: int) -> None:
    told: list[str] = []
    sets = ["wall.side=both", f"servo.kick={turns * math.tau}", "servo.hand=none"]
    result, rows = session(preset, *sets, duration=1.0, tell=told.append, warm_up=True)
    assert len(rows) >= 1000
    assert not rows["torque"].any()
    assert (result.stop_reason, result.ticks, result.wall_came_on) == ("duration", 0, False)
    assert "turn the shaft to within 0.72° of 0.0° (0.00 turns)" in result.waited_for
    assert f"({turns:.2f} turns)" in told[-2] and f"({turns:.2f} turns)" in told[-1]


@pytest.mark.parametrize("preset", sampled(["emulated-ideal", "simulated"], 2))
def test_a_wall_from_the_start_is_on_the_turn_where_the_shaft_stands(preset: str) -> None:
    told: list[str] = []
    sets = ["wall.reference=start", "wall.position=0.3", "servo.kick=18.8"]
    result, rows = session(preset, *sets, duration=3.2, tell=told.append, warm_up=True)
    assert result.wall_came_on
    surface = rows["position"][0] + 0.3
    pushed = rows[rows["torque"] < 0.0]
    assert pushed["position"].min() > surface - 0.002
    assert rows["position"].max() > surface + 0.1, "the hand found it there"
    assert "(3.09 turns), the shaft at" in told[-1] and told[-1].endswith("(3.04 turns)")


@pytest.mark.parametrize("reference", ["absolute", "start"])
def test_travel_trips(reference: str) -> None:
    position = 0.0 if reference == "absolute" else 0.1
    sets = [f"wall.reference={reference}", f"wall.position={position}"]
    result, rows = session("simulated", *sets, "safety.travel=[-1.5, 0.2]", "servo.hand=none")
    assert result.stop_reason == "duration"
    result, rows = session(
        "simulated", *sets, f"safety.travel=[-1.5, {position + 0.02}]", duration=5.0
    )
    assert result.stop_reason == "trip:travel"
    assert result.message.endswith(f"rad; allowed is -1.5 to {position + 0.02:g}")
    assert rows["torque"][-1] == 0.0
    assert result.torque_off


def test_a_wall_that_waits_comes_on_without_a_blow_when_the_shaft_is_brought_to_it() -> None:
    """A hand brings the shaft from beyond a quarter turn, and goes slowly through the surface."""
    sets = ["wall.side=both", "wall.stiffness=2", "servo.kick=-1.6"]
    result, rows = session("emulated-ideal", *sets, "safety.engage_torque=0.2", duration=1.8)
    assert result.wall_came_on
    assert result.ticks == 1800, "time counts from when the wall comes on"
    assert abs(rows["torque"][0]) <= 0.2 + 0.02 * 5.0, "the spring's part, and the damper's"


@pytest.mark.parametrize(
    ("preset", "more"),
    sampled(
        [
            ("simulated", ("wall.passivity_control=true", "delay.steps=3")),
            ("simulated", ()),
            ("emulated-ideal", ()),
            ("emulated-ideal", ("wall.passivity_control=true", "delay.steps=3")),
        ],
        4,
    ),
)
def test_a_dead_man_let_go_inside_the_wall(
    preset: str, more: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Let go when the hand is deepest, held again at once: the wall waits until it is out."""
    plain, telemetry = Cycle.run, Telemetry.create()
    let_go: list[int] = []

    def run(self: Cycle, deadline_ns: int, woke_ns: int, missed: int) -> None:
        depth = self.axes[0].position
        if self.ticks and telemetry.words[Word.MISSED] == 0 and depth > 0.08 and not let_go:
            let_go.append(self.ticks)
            telemetry.words[Word.HELD_NS] = 0
        elif let_go and self.ticks > let_go[0] + 20:
            telemetry.words[Word.HELD_NS] = NO_DEAD_MAN
        plain(self, deadline_ns, woke_ns, missed)

    monkeypatch.setattr(Cycle, "run", run)
    result, rows = session(preset, *more, duration=7.0, telemetry=telemetry)
    assert result.stop_reason == "duration"
    off = (rows["flags"] & FLAG_OFF) != 0
    at = let_go[0]
    assert off[at], "in the very tick"
    assert not np.any(rows["torque"][off])
    back = at + int(np.argmin(off[at:]))
    assert back > at + 300, "held again 20 ms later, but inside"
    rest = rows[back - 49 : back + 1]
    stiffness: FloatArray = rest["stiffness"]
    away: FloatArray = rest["position"]
    assert np.all(stiffness * away <= 0.1), "for 50 ticks, that one counted"
    assert not np.any(off[back:])
    torque: FloatArray = rows["torque"]
    assert torque[back:].min() < -0.5, "and it pushes again"
    assert not_none(result.oscillation)["state"] == "quiet"


@pytest.mark.parametrize(
    ("side", "kick", "goal"),
    sampled([("both", 18.8, "to within"), ("below", -18.8, "above"), ("above", 18.8, "below")], 3),
)
def test_a_wall_that_never_came_on_is_the_first_line_of_the_report(
    side: str,
    kick: float,
    goal: str,
    tmp_path: Path,
    cli: Cli,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    sets = f"wall.side={side}", f"servo.kick={kick}", "loop.clock=simulated"
    run = ["run", "emulated-ideal", "--duration=0.2", "--no-plot", *(f"--set={x}" for x in sets)]
    monkeypatch.chdir(tmp_path)
    status, out, said = cli(*run)
    assert status == 3
    assert out.startswith("run         THE WALL NEVER CAME ON: at ")
    assert f"turn the shaft {goal}" in " ".join(out.split())
    assert "2.99 turns" in said
    assert cli.json(*run, status=3)["wall_came_on"] is False


def test_a_configured_sample_age_counts_where_it_is_the_larger() -> None:
    result, _ = session("emulated-ideal", "delay.steps=2", "guard.sample_age=0.0015", duration=0.2)
    assert not_none(result.delay)["measured"] == 0.0015
    assert not_none(result.delay)["total"] == pytest.approx(
        0.002 + 0.0015 + not_none(result.delay)["device"]
    )
    result, _ = session("emulated-ideal", "delay.steps=2", "guard.sample_age=0.00001", duration=0.2)
    assert not_none(result.delay)["measured"] > 0.00001


def test_an_error_in_the_loop_ends_with_torque_off_and_a_name(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def broken(*_: object, **__: object) -> NoReturn:
        raise ZeroDivisionError("boom")

    monkeypatch.setattr(Gains, "follow", broken)
    result, _ = session("emulated-ideal")
    assert result.stop_reason == "trip:internal_error"
    assert "ZeroDivisionError: boom (in broken, test_session.py line" in result.message
    assert result.torque_off


FIRST = ("wall.stiffness=7", "wall.damping=0.04")


def test_the_clip_limits_the_wall_and_leaves_the_guard_its_stiffness() -> None:
    """The servo's own limit, lowered to the same, leaves less: a count commands too much of it."""
    result, rows = session("emulated-ideal", *FIRST, "wall.torque_clip=0.2", duration=2.7)
    assert result.stop_reason == "duration"
    assert not_none(result.guard)["commanded"]["stiffness"] == 7.0
    for torque in (rows["wall_torque"], rows["torque"]):
        assert 0.2 - 0.005 < np.abs(torque).max() <= 0.2, "less than a current unit below it"
    assert np.any(rows["flags"] & FLAG_SATURATED)
    result, _ = session("emulated-ideal", *FIRST, "servo.torque_limit=0.2", duration=0.1)
    assert not_none(result.guard)["commanded"]["stiffness"] < 7.0
    assert not_none(result.guard)["binding"] == "quantisation"


def test_a_servo_that_seems_to_turn_the_wrong_way_is_told_its_sign() -> None:
    sets = ["wall.law=stops", "wall.low=-2", "wall.high=0.4", "servo.hand=none"]
    sets += ["servo.offset=0.2", "servo.kick=1.8", "axes={one: {}, two: {servo: {id: 2}}}"]
    result, _ = session("emulated-ideal", *sets, duration=0.3)
    assert result.waited_for.endswith(
        "with servo.sign=-1 the shaft would be at -102.9° (-0.29 turns), where the wall may come on"
    )


def test_a_clip_below_the_smallest_torque_is_refused() -> None:
    told: list[str] = []
    for model in ("XM430-W350", "XL330-M288"):
        sets = f"servo.model={model}", "wall.torque_clip=0.003", "servo.probe_torque=0"
        with pytest.raises(UnfitServoError, match=r"torque_clip is 0.003 N.m, but the smallest"):
            session("emulated-ideal", *sets, tell=told.append)
    assert told == [], "before the torque is on"


def test_a_wall_that_drives_the_shaft_trips_near_the_models_no_load_speed() -> None:
    """Damping below zero, and friction believed so large that the detector sees nothing."""
    sets: tuple[str, ...] = ("wall.side=both", "guard.mode=off", "servo.hand=none")
    sets += ("wall.damping=-0.1", "servo.kick=0.5", "servo.coulomb=0.001", "wall.stiffness=0.3")
    sets += ("model.coulomb={value: 0.5, low: 0, high: 0.5}",)
    sets += ("model.damping={value: 0.3, low: 0.01, high: 0.3}",)
    result, rows = session("emulated-ideal", *sets)
    assert result.stop_reason == "trip:overspeed"
    assert result.message.endswith("for 10 ms, driven by the torque; at most 3.85 is allowed")
    assert 3.85 < float(result.message.split()[0]) < 4.5
    position: FloatArray = rows["position"]
    assert np.abs(np.diff(position)).max() < 1e-3 * 6.0
    assert rows["torque"][-1] == 0.0
    unlimited, _ = session("emulated-ideal", *sets, "safety.max_speed=1000")
    assert unlimited.stop_reason == "duration"


@pytest.mark.parametrize("kind, grows", [("none", True), ("notch", False)])
def test_a_notch_renders_a_damping_that_would_make_a_link_vibrate(kind: str, grows: bool) -> None:
    """Twice the ceiling without it; the guard is off, so that both walls are as asked."""
    link = ["servo.load_inertia=0.003", "servo.transmission_stiffness=200"]
    link += ["servo.transmission_damping=0.028", "servo.kick=0.01", "servo.delay=0.001"]
    wall = [
        "wall.stiffness=30",
        "wall.damping=0.4",
        "guard.mode=off",
        f"wall.velocity_filter={kind}",
    ]
    wall += ["wall.velocity_hz=46", "safety.on_oscillation=report"]
    _, rows = session("simulated", *LINEAR, *link, *wall, duration=1.0)
    first, last = heights(rows)
    assert bool(last > first) is grows
    assert bool(last < 0.1 * first) is not grows


def test_the_law_none_reads_and_sends_nothing() -> None:
    sets = ["wall.law=none", "wall.damping=0.1", "wall.passivity_control=true", "servo.hand=push"]
    result, rows = session("simulated", *sets, duration=3.0)
    assert result.stop_reason == "duration"
    assert result.wall_came_on
    assert not rows["torque"].any()
    assert not rows["oscillation"].any()
    assert rows["position"].max() > 0.1
    parts = "wall.parts=[{law: none}, {law: spring}]"
    with pytest.raises(ConfigError, match="found a none in part 0"):
        load_config("simulated", ["wall.law=sum", parts])
