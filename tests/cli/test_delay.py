"""``haptic-wall delay`` reports, writes its files, and ends as it should."""

import json
from pathlib import Path
from typing import NoReturn

import pytest

from haptic_wall.controller.experiments.testbed import (
    ExperimentInterruptedError,
    ExperimentTrippedError,
    Testbed,
)
from haptic_wall.controller.runtime.safety import Trip
from haptic_wall.hw.errors import Problem
from tests.support.program import Cli

pytestmark = pytest.mark.usefixtures("undrawn")

DELAY = ("delay", "simulated", "--set=loop.clock=simulated")
SWEEP = ("sweep", *DELAY[1:], "--virtual-damping=0.02,0.04", "--delay-steps=0")
LOST = ExperimentTrippedError(Trip.SERVO_LOST, "the port is gone", Problem("3 rows are missing"))


@pytest.mark.whole
def test_delay_reports_value_and_error_and_leaves_its_files(cli: Cli, tmp_path: Path) -> None:
    out = tmp_path / "new"
    report = cli.json(*DELAY, "--set=servo.delay=0.00137", "--set=delay.steps=3", "--out", out)
    assert report["value"] == pytest.approx(0.00437, abs=3 * report["stderr"])
    assert report["stderr"] < 2e-5
    assert report["parts"]["inserted"] == pytest.approx(0.003, abs=1e-5)
    device = report["parts"]["device"]
    assert device["value"] == pytest.approx(0.00137, abs=3 * device["stderr"])
    assert report["model_delay"]["low"] < 0.00137 < report["model_delay"]["high"]
    assert json.loads((out / "delay.json").read_text()) == report
    assert (out / "delay.hwlog").exists()


@pytest.mark.parametrize(
    ("words", "error", "status", "said"),
    [
        (
            DELAY,
            ExperimentInterruptedError("interrupted", advice="a.hwlog holds the recorded rows"),
            130,
            "interrupted; a.hwlog holds the recorded rows",
        ),
        (DELAY, LOST, 4, "trip:servo_lost: the port is gone"),
        (SWEEP, LOST, 4, "trip:servo_lost: the port is gone"),
        (DELAY, ExperimentTrippedError(Trip.OVERSPEED, "fast"), 3, "trip:overspeed: fast"),
    ],
)
def test_what_ends_an_experiment_is_its_exit_status_and_its_answer(
    words: tuple[str, ...],
    error: Exception,
    status: int,
    said: str,
    cli: Cli,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def play(*_: object) -> NoReturn:
        raise error

    monkeypatch.setattr(Testbed, "play", play)
    answer = cli(*words, "--out", tmp_path / "a")
    assert answer.status == status
    assert said in answer.err and "Traceback" not in answer.err
    if words is SWEEP:
        return  # it answers with the points that it has
    assert answer.out == ""
    found = cli.json(*words, "--out", tmp_path / "b", status=status)
    assert set(found) == {"error", "field", "advice", "exit_status"}
    assert (found["error"].startswith(said), found["exit_status"]) == (True, status)
