"""An oscillation of the wall's own making, and what is done about it, on the simulated servo."""

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from numpy.typing import NDArray

from haptic_wall.controller.detector.backstop_settings import BackstopSettings
from haptic_wall.controller.detector.oscillation import Detector, DetectorSettings
from haptic_wall.controller.detector.own_motion import OwnMotion
from haptic_wall.controller.detector.watch import Watch, WatchSettings
from haptic_wall.controller.laws.wall import Wall
from haptic_wall.controller.logs.reader import LogReader
from haptic_wall.controller.processes.inline import run_inline
from haptic_wall.controller.processes.plan import Ended, Plan
from haptic_wall.controller.processes.run_report import exit_status
from haptic_wall.controller.runtime.telemetry import Row, Telemetry, Word
from haptic_wall.controller.settings.load import load_config
from haptic_wall.controller.theory import critical_stiffness, peak
from haptic_wall.controller.theory.checks import FloatArray
from tests.cases import sampled
from tests.typed import not_none

BASE = (
    "loop.clock=simulated",
    "servo.hand=none",
    "wall.side=both",
    "servo.kick=0.05",
    "servo.coulomb=0",
    "servo.torque_limit=1000",
    "wall.damping=0",
    "safety.max_speed=1000",
)
# Believed 2 ms, in truth 6: the guard allows 0.8 of 4.68, and the truth is stable up to 1.8.
DECEIVED = ("servo.delay=0.006", "model.delay=0.002", "wall.stiffness=10")
ALLOWED = 0.8 * 4.6788
SPRING = Wall(1.0, 0.0, 0.0, "both")
BACKSTOP = BackstopSettings(
    period=1e-3,
    position_step=0.0,
    threshold=0.017,
    small=0.006,
    light=0.005,
    heavy=0.03,
    heaviest=0.02,
    rest_torque=0.1,
    torque_limit=4.1,
)


def play(
    folder: Path, *sets: str, duration: float = 8.0, telemetry: Telemetry | None = None
) -> tuple[Ended, NDArray[np.void]]:
    config = load_config("simulated", (*BASE, *sets)).config
    plan = Plan(config, duration, folder / "a.hwlog", {}, None)
    ended = run_inline(plan, telemetry or Telemetry.create())
    return ended, LogReader.open(plan.log).rows()


@pytest.fixture(scope="module")
def reduced(tmp_path_factory: pytest.TempPathFactory) -> tuple[Ended, NDArray[np.void]]:
    return play(tmp_path_factory.mktemp("reduced"), *DECEIVED)


def test_a_deceived_guard_is_helped_by_reducing_the_wall(
    reduced: tuple[Ended, NDArray[np.void]],
) -> None:
    ended, rows = reduced
    seen = not_none(ended.result)["oscillation"]
    assert ended.stop_reason == "duration"
    assert seen["state"] in ("sustained", "growing")
    assert seen["reduced_to"]["stiffness"] < 0.6
    alarm = round(seen["first_alarm_s"] * 1e3)
    after = rows["stiffness"][alarm - 1 :]
    softer = alarm - 1 + np.flatnonzero(after < 0.99 * rows["stiffness"][0])[0]  # or it was probed
    frequency = math.sqrt(ALLOWED / 0.011951) / math.tau
    assert alarm - 1 <= softer < alarm + 0.6e3 / frequency, "at the next turn, half a cycle at most"
    assert seen["frequency_hz"] == pytest.approx(frequency, rel=0.05)
    at_alarm = np.abs(rows["position"][max(0, alarm - 250) : alarm]).max()
    assert np.abs(rows["position"]).max() < 1.5 * at_alarm
    # The spring that is left has a virtual damping of -K times the delay: lag, age and half a
    # period. Where it rings free of friction, each whole second is smaller than the last.
    left = rows["stiffness"][-1]
    assert 0.011692 - left * 0.0065 > 0.0
    largest = np.abs(rows["position"]).reshape(8, 1000).max(axis=1)
    assert np.all(np.diff(largest[2:]) < 0.0)
    assert largest[-1] < 0.4 * at_alarm


def test_the_report_says_what_is_commanded_in_the_end_and_why(
    reduced: tuple[Ended, NDArray[np.void]],
) -> None:
    ended, rows = reduced
    guard = not_none(ended.result)["guard"]
    assert guard["commanded"]["stiffness"] == rows["stiffness"][-1]
    assert guard["commanded"]["stiffness"] == pytest.approx(
        ALLOWED * not_none(ended.result)["oscillation"]["reduced_to"]["stiffness"], rel=1e-3
    )
    assert any("reduced to" in reason for reason in guard["reasons"])
    json.dumps(ended.result, allow_nan=False)


def test_the_full_wall_comes_back_only_on_request(
    tmp_path: Path, reduced: tuple[Ended, NDArray[np.void]]
) -> None:
    ended, rows = reduced
    left = rows["stiffness"][-1]
    assert left < 0.6 * ALLOWED, "what an alarm took does not come back by itself"
    assert left == pytest.approx(
        ALLOWED * not_none(ended.result)["oscillation"]["reduced_to"]["stiffness"], rel=1e-3
    )
    telemetry = Telemetry.create()

    class Asking(Telemetry):
        """Asks once, when the wall has been reduced for a while."""

        def write(self, row: Row) -> None:
            super().write(row)
            if self.words[Word.HEAD] == 6000:
                self.words[Word.RAISE] = 1

    ended, rows = play(tmp_path, *DECEIVED, telemetry=Asking(telemetry.descriptor))
    stiffness = rows["stiffness"]
    assert stiffness[5990] < 0.6 * ALLOWED
    assert stiffness[6100] == pytest.approx(ALLOWED, rel=1e-3)
    assert ended.stop_reason == "duration"


def test_trip_ends_the_run_by_name(tmp_path: Path) -> None:
    ended, _ = play(tmp_path, *DECEIVED, "safety.on_oscillation=trip")
    assert ended.stop_reason == "trip:oscillation"
    assert exit_status(ended.stop_reason) == 3
    assert not_none(ended.result)["torque_off"]


def test_report_only_tells(tmp_path: Path) -> None:
    ended, rows = play(tmp_path, *DECEIVED, "safety.on_oscillation=report", duration=2.0)
    assert not_none(ended.result)["oscillation"]["first_alarm_s"] < 2.0
    assert np.all(rows["stiffness"] == rows["stiffness"][0])


def test_without_a_guard_it_always_trips(tmp_path: Path) -> None:
    ended, _ = play(tmp_path, *DECEIVED, "guard.mode=off", "safety.on_oscillation=report")
    assert ended.stop_reason == "trip:oscillation"


def test_a_stable_wall_is_left_alone(tmp_path: Path) -> None:
    ended, rows = play(tmp_path, "servo.delay=0.002", "wall.stiffness=10")
    assert not_none(ended.result)["oscillation"]["first_alarm_s"] is None
    assert not_none(ended.result)["oscillation"]["reduced_to"] == {"stiffness": 1.0, "damping": 1.0}
    assert rows["stiffness"][-1] == pytest.approx(ALLOWED, rel=1e-3)


def test_the_measured_torque_is_believed_before_the_one_sent() -> None:
    watch = Watch(WatchSettings(DetectorSettings(1e-3), "report", 0.0))
    watch.passed(1)
    watch.sent(1.0)
    watch.passed(1)
    watch.sample(0.0, SPRING, math.nan)
    assert watch.acted == pytest.approx(0.5), "two periods, the torque acted in one of them"
    assert watch.spanned == 2
    watch.passed(1)
    watch.sample(0.0, SPRING, -0.3)
    assert watch.acted == -0.3


def five_cycles(stiffness: float, rows: NDArray[np.void]) -> FloatArray:
    last = round(5e3 * math.tau * math.sqrt(0.011951 / stiffness))
    amplitudes: FloatArray = np.abs(rows["position"][: last + 1])
    return amplitudes


@pytest.mark.parametrize("share", sampled([0.2, 0.02, 0.7], 3))
def test_passivity_control_holds_what_some_damping_could(tmp_path: Path, share: float) -> None:
    limit = float(critical_stiffness(0.011951, 0.011692, 0.0, 1e-3, 2e-3))
    highest = float(peak(0.011951, 0.011692, 1e-3, 2e-3).stiffness)
    stiffness = share * highest
    assert stiffness > 2 * limit
    sets = ("servo.delay=0.002", f"wall.stiffness={stiffness}", "guard.mode=off")
    ended, rows = play(tmp_path, *sets, "wall.passivity_control=true", duration=3.0)
    assert five_cycles(stiffness, rows).max() < 1.5 * 0.05
    assert not np.any(rows["flags"] & 1), "saturation is no success"
    ended, rows = play(tmp_path, *sets, "safety.on_oscillation=report", duration=3.0)
    assert ended.stop_reason == "trip:oscillation", "and without it"


def test_beyond_the_peak_it_cannot_and_trips(tmp_path: Path) -> None:
    highest = float(peak(0.011951, 0.011692, 1e-3, 2e-3).stiffness)
    ended, rows = play(
        tmp_path,
        "servo.delay=0.002",
        f"wall.stiffness={1.2 * highest}",
        "guard.mode=off",
        "wall.passivity_control=true",
    )
    assert ended.stop_reason == "trip:oscillation"
    assert rows["damping"].max() <= 3.49, "no more damping than at the peak"


def contact_with(
    torque_in: float,
    torque_out: float,
    answer: Literal["reduce", "trip", "report"] = "reduce",
    side: int = 1,
    seconds: float = 0.05,
    deepest: Callable[[Watch], object] | None = None,
) -> Watch:
    """The watch after a contact: 0.1 rad in and out again, with these measured torques [N·m].

    ``deepest`` is called with the watch at the deepest point.
    """
    detector = DetectorSettings(1e-3)
    watch = Watch(WatchSettings(detector, answer, 0.0, side=side, heavy=0.02))
    watch.own = OwnMotion(BACKSTOP, replace(BACKSTOP, bounces=True), side)
    wall = Wall(10.0, 0.0, 0.0, "above" if side == 1 else "below")
    ticks = round(seconds * 1e3)
    way = np.linspace(-0.01, 0.1, ticks)
    for k, depth in enumerate([*way, *way[::-1]]):
        watch.passed(1)
        torque = (torque_in if k < ticks else torque_out) if depth > 0.0 else 0.0
        watch.sample(side * depth, wall, -side * torque)
        if k == ticks and deepest is not None:
            deepest(watch)
    return watch


@pytest.mark.parametrize("side", [1, -1])
def test_a_one_sided_wall_that_gives_more_than_it_took_ends_the_run(side: int) -> None:
    """It takes 0.02 J and gives 0.2 J."""
    assert contact_with(0.2, 2.0, side=side).failed
    assert not contact_with(2.0, 0.2, side=side).failed, "it has taken energy"
    assert not contact_with(2.0, 2.1, side=side).failed, "0.01 J is allowed"


def test_a_contact_whose_first_half_is_forgotten_ends_no_run() -> None:
    """The full wall is asked for, or an alarm is taken back, while the shaft is inside."""
    assert not contact_with(2.0, 0.2, deepest=Watch.raise_again).failed
    assert not contact_with(0.2, 2.0, deepest=Watch.raise_again).failed


def test_a_contact_that_began_without_a_wall_ends_no_run(tmp_path: Path) -> None:
    """The wall comes on, or is changed, around the shaft, and gives what it held."""
    assert not contact_with(0.2, 2.0, deepest=Watch.resume).failed
    ended, rows = play(
        tmp_path, "wall.side=above", "wall.damping=0.2", "wall.stiffness=40", duration=1.0
    )
    assert ended.stop_reason == "duration"
    assert rows["position"][-1] < 0.0


def test_the_energy_of_a_contact_that_lasts_longer_than_a_bounce_is_a_hands() -> None:
    """A bounce of 0.02 kg·m² on 10 N·m/rad lasts 0.14 s."""
    assert not contact_with(0.0, 2.0, seconds=0.4).failed


def test_a_report_ends_no_run_for_energy() -> None:
    assert not contact_with(0.2, 2.0, answer="report").failed


@pytest.mark.parametrize("kick", sampled([0.05, 0.3], 2))
@pytest.mark.parametrize("damping", [0.0, 0.02])
def test_a_wall_within_its_limit_that_dies_slowly_is_left_alone(
    tmp_path: Path, damping: float, kick: float
) -> None:
    """A servo without friction on the guard's own wall loses one or two percent a cycle."""
    sets = (f"servo.kick={kick}", f"wall.damping={damping}", "wall.stiffness=1e6")
    ended, rows = play(tmp_path, *sets)
    seen = not_none(ended.result)["oscillation"]
    assert seen["first_alarm_s"] is None and seen["state"] == "decaying"
    assert set(rows["stiffness"]) == {rows["stiffness"][0]}, "not even probed"


@pytest.mark.parametrize("ticks", [1, 5, 13])
def test_a_change_of_the_stiffness_behind_a_turning_point_gives_no_energy(ticks: int) -> None:
    """The spring stores less from then on: the torque of before is not held against it."""
    count = math.tau / 4096
    detector = Detector(DetectorSettings(1e-3, 0.012, 0.0, 0.0, count, 10.0))
    detector.balance.surface = 0.0
    detector.stiffness, speed, position, turned = 18.7, 0.0, 0.05, 0
    for k in range(600):
        torque, before = -detector.stiffness * position, speed
        speed += torque / 0.012 * 1e-3
        position += speed * 1e-3
        if k > 100 and (turned or before * speed <= 0.0):
            turned += 1
        if turned == ticks:  # as a probe does
            detector.stiffness = 18.7 / 4.0
        detector.update(round(position / count) * count, torque)
        assert not detector.alarm
