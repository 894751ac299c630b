"""An oscillation of the wall's own making, and what is done about it, on the simulated servo."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from haptic_wall.controller.detector.settings import WatchSettings
from haptic_wall.controller.detector.watch import Watch
from haptic_wall.controller.laws.wall import Wall
from haptic_wall.controller.logs.reader import LogReader
from haptic_wall.controller.processes.inline import run_inline
from haptic_wall.controller.processes.plan import Ended, Plan
from haptic_wall.controller.processes.run_report import exit_status
from haptic_wall.controller.runtime.telemetry import FLAG_RAISED, Telemetry, Word
from haptic_wall.controller.settings.load import load_config
from haptic_wall.controller.theory import critical_stiffness
from haptic_wall.controller.theory.boundary import chain_peak
from haptic_wall.controller.theory.chain import one_mass
from haptic_wall.controller.theory.checks import FloatArray
from tests.cases import sampled
from tests.support.trial import Case, WallAsked
from tests.support.truth import Truth
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
    assert rows["stiffness"][-1] < 0.6 * ALLOWED, "it does not come back by itself"
    assert guard["commanded"]["stiffness"] == pytest.approx(
        ALLOWED * not_none(ended.result)["oscillation"]["reduced_to"]["stiffness"], rel=1e-3
    )
    assert any("reduced to" in reason for reason in guard["reasons"])
    json.dumps(ended.result, allow_nan=False)


def test_the_full_wall_comes_back_only_on_request(tmp_path: Path) -> None:
    telemetry = Telemetry.create()

    class Asking(Telemetry):
        """Asks once, when the wall has been reduced for a while."""

        def write(self, *values: float) -> None:
            super().write(*values)
            if self.words[Word.HEAD] == 6000:
                self.words[Word.RAISE] = 1

    ended, rows = play(tmp_path, *DECEIVED, telemetry=Asking(telemetry.descriptor))
    stiffness = rows["stiffness"]
    assert stiffness[5990] < 0.6 * ALLOWED
    assert stiffness[6100] == pytest.approx(ALLOWED, rel=1e-3)
    assert np.count_nonzero(rows["flags"] & FLAG_RAISED) == 1
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


def test_the_measured_torque_is_believed_before_the_one_sent() -> None:
    watch = Watch(WatchSettings(1e-3))
    watch.passed(1)
    watch.sent(1.0)
    watch.sample(0.0, SPRING, math.nan, 1)
    assert watch.acted == pytest.approx(0.5), "two periods, the torque acted in one of them"
    assert watch.spanned == 2
    watch.sample(0.0, SPRING, -0.3, 1)
    assert watch.acted == -0.3


def five_cycles(stiffness: float, rows: NDArray[np.void]) -> FloatArray:
    last = round(5e3 * math.tau * math.sqrt(0.011951 / stiffness))
    amplitudes: FloatArray = np.abs(rows["position"][: last + 1])
    return amplitudes


@pytest.mark.parametrize("share", sampled([0.2, 0.02, 0.7], 3))
def test_passivity_control_holds_what_some_damping_could(tmp_path: Path, share: float) -> None:
    limit = float(critical_stiffness(0.011951, 0.011692, 0.0, 1e-3, 2e-3))
    highest = float(chain_peak(one_mass(0.011951, 0.011692)[0], 1e-3, 2e-3).stiffness[0])
    stiffness = share * highest
    assert stiffness > 2 * limit
    sets = ("servo.delay=0.002", f"wall.stiffness={stiffness}", "guard.mode=off")
    ended, rows = play(tmp_path, *sets, "wall.passivity_control=true", duration=3.0)
    assert five_cycles(stiffness, rows).max() < 1.5 * 0.05
    assert not np.any(rows["flags"] & 1), "saturation is no success"
    ended, rows = play(tmp_path, *sets, "safety.on_oscillation=report", duration=3.0)
    assert ended.stop_reason == "trip:oscillation", "and without it"


def test_beyond_the_peak_it_cannot_and_trips(tmp_path: Path) -> None:
    highest = float(chain_peak(one_mass(0.011951, 0.011692)[0], 1e-3, 2e-3).stiffness[0])
    ended, rows = play(
        tmp_path,
        "servo.delay=0.002",
        f"wall.stiffness={1.2 * highest}",
        "guard.mode=off",
        "wall.passivity_control=true",
    )
    assert ended.stop_reason == "trip:oscillation"
    assert rows["damping"].max() <= 3.49, "no more damping than at the peak"


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
    assert seen["reduced_to"] == {"stiffness": 1.0, "damping": 1.0}
    assert set(rows["stiffness"]) == {rows["stiffness"][0]}, "not even probed"


def test_passivity_control_stabilises_the_fastest_rigid_servo_of_a_belief() -> None:
    """Its wall swings 1.7 times as fast as the believed servo's, and more with late damping."""
    inertia, damping, gain, delay = 0.00121, 0.00366, 2.0, 0.005
    dampings = np.linspace(0.0, 1.5 * inertia / (delay + 1e-3), 200)
    limits = critical_stiffness(inertia, damping, dampings, 1e-3, delay)
    virtual = 0.7 * dampings[np.argmax(limits)]
    stiffness = 1.05 * float(np.interp(virtual, dampings, limits))
    truth = Truth(inertia=inertia, damping=damping, torque_gain=gain, delay=delay)
    wall = WallAsked(stiffness / gain, virtual / gain)
    control = ("wall.passivity_control=true",)
    found = Case("xl330-m288", truth, wall, position=0.1, duration_s=2.5, law=control).run("report")
    assert 0.5 * np.ptp(found.output[-300:]) < 0.005
    assert math.isnan(found.first_alarm_s)
