"""Changes of a running wall on the simulated clock: when they are made, and what stays right."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from haptic_wall.controller.errors import UserError
from haptic_wall.controller.runtime.changeover import (
    Changeover,
    Obstacle,
)
from haptic_wall.controller.runtime.session_result import Result
from haptic_wall.controller.runtime.telemetry import (
    FLAG_CHANGED,
    FLAG_CONTACT,
    FLAG_OFF,
    Word,
)
from haptic_wall.controller.settings.changes import changed
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.settings.load import load_config
from tests.cases import sampled
from tests.support.changed_walls import ChangedRun


def wall(*sets: str) -> Config:
    given = ("loop.clock=simulated", "servo.hand=push", "wall.stiffness=8", *sets)
    return load_config("simulated", given).config


def deep(config: Config, position: float) -> bool:
    return position > config.wall.position + 0.05


def run_with(
    *changes: Sequence[str], sets: Sequence[str] = (), seconds: float = 6.0, wait: int = 5000
) -> tuple[ChangedRun, Any, Result]:
    """Ask for each change where the shaft is deep in the wall, one after the other."""
    left = list(changes)

    def ask(row: int, config: Config, position: float) -> Sequence[str]:
        return left.pop(0) if left and row > 500 and deep(config, position) else ()

    run = ChangedRun(wall(*sets), ask, wait)
    result, rows = run.run(seconds)
    assert not left, "the shaft was deep in the wall"
    return run, rows, result


def test_less_stiffness_goes_down_a_ramp_in_contact() -> None:
    run, rows, result = run_with(("wall.stiffness=4",))
    (asked,) = run.asked
    assert asked.row < asked.tick + 100
    assert rows["flags"][asked.row] & FLAG_CHANGED
    assert rows["flags"][asked.row] & FLAG_CONTACT
    steps = np.diff(rows["wall_torque"][asked.tick : asked.row + 1])
    assert np.abs(steps).max() < 0.2 and rows["stiffness"][asked.row] == 4.0
    assert len(set(rows["stiffness"][asked.tick : asked.row])) > 5, "a ramp"
    assert result.guard is not None and result.guard["requested"]["stiffness"] == 4.0
    assert result.guard["commanded"]["stiffness"] == 4.0


def test_more_stiffness_waits_until_its_spring_would_be_unloaded() -> None:
    run, rows, _ = run_with(("wall.stiffness=16",))
    (asked,) = run.asked
    assert asked.row > asked.tick + 100
    assert asked.obstacle is Obstacle.ENERGY
    assert set(rows["stiffness"][600 : asked.row]) == {8.0}
    assert set(rows["stiffness"][asked.row :]) == {16.0}
    assert max(0.0, rows["position"][asked.row]) ** 2 * 0.5 * 8.0 <= 1e-4


def test_the_jump_of_the_torque_is_judged_with_the_filtered_velocity(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    heard: list[float] = []
    obstacle = Changeover.obstacle

    def hears(self: Changeover, *given: Any) -> Obstacle:
        heard.append(given[-1])
        return obstacle(self, *given)

    monkeypatch.setattr(Changeover, "obstacle", hears)
    low_pass = "wall.velocity_filter=lowpass", "wall.velocity_hz=20"
    _, rows, _ = run_with(("wall.damping=0.03",), sets=("wall.side=both", *low_pass), seconds=3.0)
    assert heard
    assert not set(heard) & set(rows["velocity"][rows["velocity"] != 0.0])


def test_what_finds_no_moment_is_not_made_and_the_stiffness_stays() -> None:
    run, rows, result = run_with(
        ("wall.stiffness=16",), sets=("servo.hand=lean", "wall.side=both"), wait=300
    )
    (asked,) = run.asked
    assert asked.row == -1 and asked.withdrawn
    assert not (rows["flags"] & FLAG_CHANGED).any()
    assert set(rows["stiffness"][600:]) == {8.0}
    assert result.guard is not None and result.guard["requested"]["stiffness"] == 8.0


def test_the_stiffness_goes_down_before_the_damping_and_the_delay() -> None:
    run, rows, _ = run_with(
        ("wall.stiffness=2", "wall.damping=0", "delay.steps=3"), sets=("wall.damping=0.05",)
    )
    (asked,) = run.asked
    assert asked.row > 0
    before = rows[600 : asked.row]
    assert set(before["damping"]) == {0.05} and before["stiffness"].min() < 5.0
    assert set(rows["damping"][asked.row :]) == {0.0}
    delay = rows["delay_s"]
    assert delay[asked.row] - delay[asked.row - 1] == pytest.approx(3e-3)


def test_no_pair_of_old_and_new_values_ever_acts() -> None:
    run, rows, _ = run_with(("wall.stiffness=16", "wall.damping=0.05"))
    (asked,) = run.asked
    pairs = set(zip(rows["stiffness"][600:].tolist(), rows["damping"][600:].tolist(), strict=True))
    assert asked.row > 0 and pairs == {(8.0, 0.02), (16.0, 0.05)}


def test_a_changed_wall_is_clamped_as_one_from_the_start() -> None:
    request = ("wall.stiffness=1e6", "wall.damping=0.03", "delay.steps=2")
    run, _, changed_late = run_with(request)
    none = ChangedRun(wall(*request), lambda _row, _config, _position: ())
    from_start, _ = none.run(1.0)
    assert run.asked[0].row > 0
    assert changed_late.guard is not None and from_start.guard is not None
    for name in ("requested", "commanded", "limit", "binding", "reasons"):
        assert changed_late.guard[name] == from_start.guard[name]
    assert changed_late.delay == from_start.delay


def test_a_wall_is_moved_toward_the_shaft_only_out_of_its_way() -> None:
    run, rows, _ = run_with(("wall.position=-0.05",))
    (asked,) = run.asked
    assert asked.obstacle in (Obstacle.ENERGY, Obstacle.TORQUE)
    assert rows["position"][asked.row] < 0.0
    inside = rows["position"][asked.row :] > -0.05
    assert ((rows["flags"][asked.row :] & FLAG_CONTACT) > 0).tolist() == inside.tolist()


def test_a_position_counts_from_the_start_where_the_first_one_did() -> None:
    run, rows, _ = run_with(
        ("wall.position=0.12",), sets=("wall.reference=start", "wall.position=0.1")
    )
    (asked,) = run.asked
    assert run.config.start_position == 0.0
    surface = rows["position"][0] + 0.12
    inside = rows["position"][asked.row :] > surface
    assert ((rows["flags"][asked.row :] & FLAG_CONTACT) > 0).tolist() == inside.tolist()


def test_another_law_begins_with_its_own_numbers() -> None:
    run, rows, result = run_with(
        ("wall.law=detents", "wall.count=12"), ("wall.law=spring",), seconds=12.0
    )
    assert [each.row > 0 for each in run.asked] == [True, True]
    assert run.asked[1].new.wall.count is None
    assert result.stop_reason == "duration" and result.guard is not None
    last = rows[-1]
    torque = -8.0 * last["position"] - 0.02 * last["velocity"]
    assert last["wall_torque"] == pytest.approx(torque)


@pytest.mark.parametrize(
    "change",
    [
        "loop.rate_hz=500",
        "model.delay=0",
        "guard.mode=off",
        "safety.engage_torque=5",
        "wall.stifness=3",
    ],
)
def test_what_a_running_wall_keeps_is_refused_by_name(change: str) -> None:
    with pytest.raises(UserError) as refused:
        changed(wall(), [change])
    assert refused.value.problem.field == change.partition("=")[0]


def test_what_an_alarm_reduced_stays_reduced() -> None:
    """Nothing but less stiffness is taken while the wall is softer after an oscillation."""
    left = [
        ("wall.stiffness=400",),
        ("wall.damping=0.1",),
        ("delay.steps=1",),
        ("wall.stiffness=20",),
    ]
    at: list[int] = []

    def ask(row: int, _config: Config, _position: float) -> Sequence[str]:
        if not at and row > 3000:
            at.append(row)
        return left.pop(0) if left and at else ()

    # The servo is five milliseconds later than believed: the guard allows what oscillates.
    config = load_config(
        "simulated",
        [
            "loop.clock=simulated",
            "wall.side=both",
            "wall.stiffness=60",
            "servo.hand=none",
            "servo.kick=0.03",
            "servo.delay=0.006",
            "model.delay=0",
        ],
    ).config
    run = ChangedRun(config, ask, 200)
    result, rows = run.run(6.0)
    assert result.oscillation is not None
    reduced = result.oscillation["reduced_to"]["stiffness"]
    assert reduced < 1.0
    assert [each.row > 0 for each in run.asked] == [False, False, False, True]
    assert all(each.obstacle is Obstacle.REDUCED for each in run.asked[:3])
    before, after = rows["stiffness"][run.asked[3].tick - 1], rows["stiffness"][-1]
    assert after == pytest.approx(20.0 * reduced) and after < before


def test_a_wall_that_the_dead_man_holds_off_is_changed_at_once_and_comes_on_by_the_rule() -> None:
    def ask(row: int, config: Config, position: float) -> Sequence[str]:
        words = run._telemetry.words
        if row > 500 and deep(config, position) and not run.asked:
            words[Word.HELD_NS] = 0
            return ("wall.law=spring", "wall.stiffness=2")
        if run.asked and row == run.asked[0].tick + 50:
            words[Word.HELD_NS] = (1 << 63) - 1
        return ()

    run = ChangedRun(wall(), ask)
    _, rows = run.run(6.0)
    (asked,) = run.asked
    assert asked.row < asked.tick + 30 and rows["flags"][asked.row] & FLAG_OFF
    on = np.flatnonzero((rows["flags"][asked.row :] & FLAG_OFF) == 0)[0] + asked.row
    assert on > asked.row + 50 and 2.0 * abs(rows["position"][on]) <= 0.1


def test_passivity_control_counts_no_energy_for_a_change() -> None:
    """A spring that vanishes gives nothing back: a deficit stays, with the damping against it."""
    run, rows, _ = run_with(
        ("wall.position=0.3",),
        sets=("wall.passivity_control=true", "wall.damping=0.05", "safety.engage_torque=1"),
    )
    (asked,) = run.asked
    assert asked.row > 0
    injected = rows["damping"][asked.row - 2 : asked.row + 4] - 0.05
    assert injected.min() == injected.max() > 0.1


@pytest.mark.parametrize("side", sampled(["above", "both"], 2))
def test_a_law_that_is_changed_every_third_of_a_second_is_found_to_oscillate(side: str) -> None:
    """The evidence of the backstop stays: else such a wall swung by 4 rad, and nobody told."""
    sets = (
        "wall.side=both",
        "servo.hand=none",
        "servo.kick=0.15",
        "servo.delay=0.012",
        "model.delay=0.001",
        "safety.max_speed=1000",
        "safety.engage=at-once",
    )
    last = [0]

    def ask(row: int, now: Config, position: float) -> Sequence[str]:
        inside = position > 0.01 or side == "both"
        if row < last[0] + 300 or not inside:
            return ()
        last[0] = row
        other = now.wall.law == "spring"
        return ("wall.law=wall", f"wall.side={side}") if other else ("wall.law=spring",)

    run = ChangedRun(wall(*sets), ask)
    result, _ = run.run(4.0)
    assert any(each.row >= 0 for each in run.asked)
    seen = result.oscillation
    assert seen is not None and seen["first_alarm_s"] is not None
    assert seen["reduced_to"]["stiffness"] < 1.0
