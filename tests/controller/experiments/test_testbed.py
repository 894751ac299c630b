import os
import pickle
import signal
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from haptic_wall.controller.errors import UserError
from haptic_wall.controller.experiments import testbed
from haptic_wall.controller.experiments.testbed import (
    ExperimentInterruptedError,
    ExperimentTrippedError,
    Testbed,
)
from haptic_wall.controller.laws.program import Phase
from haptic_wall.controller.logs.writer import append_end
from haptic_wall.controller.processes.plan import Ended, Plan
from haptic_wall.controller.processes.run import run
from haptic_wall.controller.runtime.safety import Trip
from haptic_wall.controller.settings.load import load_config
from haptic_wall.hw.errors import Problem, ServoLostError
from tests.typed import not_none

LINEAR = ("servo.coulomb=0", "servo.counts_per_rev=0", "loop.clock=simulated", "servo.hand=none")


def bed(folder: Path, *sets: str) -> Testbed:
    return Testbed(load_config("simulated", (*LINEAR, *sets)).config, folder)


def test_a_released_shaft_swings_as_its_spring_says(tmp_path: Path) -> None:
    config = load_config("simulated", LINEAR).config
    stiffness = 2.0
    played = bed(tmp_path).play(
        "swing",
        [
            Phase(5.0, 10.0, 0.2, 0.05, speed=0.2, still_s=0.05, still_band=1e-6),
            Phase(2.0, stiffness),
        ],
    )
    swing = played.rows["position"][played.rows["phase"] == 1]
    origin = played.rows["position"][0]
    crossings = np.flatnonzero(np.diff(np.sign(swing - origin)))
    period = 2 * np.mean(np.diff(crossings)) * 1e-3
    assert period == pytest.approx(
        2 * np.pi * np.sqrt(not_none(config.servo.inertia) / stiffness), rel=0.01
    )
    assert swing[0] - origin == pytest.approx(0.05, abs=1e-3)
    assert played.log.exists()


@pytest.mark.parametrize("stalled", [True, False])
def test_a_motion_that_a_stall_has_ended_is_repeated_once(
    stalled: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs: list[bool] = []

    def stalling(plan: Plan, tell: Callable[[str], None]) -> Ended:
        ended = run(plan, tell)
        runs.append(True)
        if len(runs) > 1:
            return ended
        result = {**not_none(ended.result), "stalled": "this computer stalled" if stalled else ""}
        return replace(ended, stop_reason=Trip.OVERSPEED, result=result)

    monkeypatch.setattr(testbed, "run", stalling)
    if stalled:
        assert bed(tmp_path).play("one", [Phase(0.01)]).repeated == Trip.OVERSPEED
    else:
        with pytest.raises(ExperimentTrippedError):
            bed(tmp_path).play("one", [Phase(0.01)])
    assert len(runs) == 1 + stalled


@pytest.mark.parametrize(("preset", "runs"), [("emulated-ideal", 2), ("xm430-w350", 1)])
def test_only_an_emulated_servo_that_does_not_answer_is_started_again(
    preset: str, runs: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A machine may stall its emulator; a real servo's cable may be loose."""
    begun: list[str] = []

    def silent(plan: Plan, _tell: Callable[[str], None]) -> Ended:
        begun.append(str(plan.log))
        raise ServoLostError("stopped answering", advice="look at its cable")

    monkeypatch.setattr(testbed, "run", silent)
    told: list[str] = []
    with pytest.raises(ServoLostError, match="stopped answering"):
        Testbed(load_config(preset).config, tmp_path, told.append).play("one", [Phase(0.1)])
    assert len(begun) == runs
    assert any("once more" in each for each in told) == (runs == 2)


def test_a_ctrl_c_that_comes_when_the_loop_is_just_over_is_not_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(path: Path, report: Mapping[str, Any], *changes: Any) -> None:
        os.kill(os.getpid(), signal.SIGINT)
        append_end(path, report, *changes)

    monkeypatch.setattr("haptic_wall.controller.processes.run.append_end", interrupted)
    with pytest.raises(ExperimentInterruptedError):
        bed(tmp_path).play("whole", [Phase(0.01)])
    assert (tmp_path / "whole.hwlog").exists()


# What the recorder monitor says of a log whose rows were lost; not all of it names the file.
CUT_SHORT = [
    (3, "the log is incomplete (more rows waited to be written than memory holds): it lacks 3"),
    (1, "the log is incomplete (no recorder wrote its end): it lacks 1 of 90 rows"),
    (None, "part of the log is lost (it.hwlog: Input/output error)"),
]


def cut_short(monkeypatch: pytest.MonkeyPatch, lacking: int | None, warning: str) -> None:
    def run_and_lose(plan: Plan, tell: Callable[[str], None]) -> Ended:
        return replace(run(plan, tell), warnings=[warning], lacking=lacking)

    monkeypatch.setattr(testbed, "run", run_and_lose)


@pytest.mark.parametrize(("lacking", "warning"), CUT_SHORT)
def test_a_log_that_was_cut_short_is_no_measurement(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, lacking: int | None, warning: str
) -> None:
    cut_short(monkeypatch, lacking, warning)
    with pytest.raises(UserError, match="so nothing is measured from it") as error:
        bed(tmp_path).play("it", [Phase(0.05)])
    assert warning in str(error.value)
    assert str(tmp_path / "it.hwlog") in str(error.value)
    assert (tmp_path / "it.hwlog").exists()


def test_a_trip_comes_whole_out_of_another_process() -> None:
    problem, gap = Problem("too fast", advice="slow down"), Problem("gap")
    error = pickle.loads(pickle.dumps(ExperimentTrippedError(Trip.OVERSPEED, problem, gap)))
    assert (error.stop_reason, error.problem, error.fault) == ("trip:overspeed", problem, gap)
    assert str(error) == "trip:overspeed: too fast; slow down"


def test_a_trip_says_whether_its_log_can_be_measured_from(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(ExperimentTrippedError) as whole:
        bed(tmp_path, "safety.max_speed=0.5").play("fast", [Phase(1.0, torque=1.0)])
    assert whole.value.fault is None
    cut_short(monkeypatch, *CUT_SHORT[0])
    with pytest.raises(ExperimentTrippedError) as cut:
        bed(tmp_path, "safety.max_speed=0.5").play("fast", [Phase(1.0, torque=1.0)])
    assert "it lacks 3), so nothing is measured from it" in str(cut.value.fault)
    assert cut.value.stop_reason == "trip:overspeed"
