"""The log of a run tells what the run told: the state and the first alarm, to the tick."""

import contextlib
import json
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from haptic_wall.controller.cli.detect import command
from haptic_wall.controller.cli.main import haptic_wall, main
from tests.cases import sampled

BASE = ("loop.clock=simulated", "servo.hand=none", "servo.kick=0.05", "servo.coulomb=0")
DECEIVED = (*BASE, "wall.side=both", "servo.delay=0.006", "model.delay=0.002", "wall.damping=0")


def both(
    folder: Path, capsys: pytest.CaptureFixture[str], *sets: str, duration: float = 3
) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any]]:
    words = [word for text in sets for word in ("--set", text)]
    log = folder / "a.hwlog"
    arguments = ["--duration", str(duration), "--log", str(log), "--no-plot", "--json"]
    with contextlib.suppress(SystemExit):
        main(["run", "simulated", *words, *arguments])
    ran = json.loads(capsys.readouterr().out)
    done = CliRunner().invoke(command, [str(log), "--json"], catch_exceptions=False)
    return ran["oscillation"], json.loads(done.stdout), ran


@pytest.mark.parametrize(
    "more",
    sampled(
        [
            "safety.on_oscillation=trip",
            "safety.on_oscillation=report",
            "safety.on_oscillation=reduce",
            "safety.on_oscillation=reduce wall.side=above servo.hand=lean",
            "safety.on_oscillation=reduce servo.counts_per_rev=0 delay.steps=1",
            "safety.on_oscillation=reduce wall.passivity_control=true",
            "safety.on_oscillation=reduce servo.hand=push wall.reference=start",
            "servo.gravity=0.8 servo.gravity_angle=1.57 servo.kick=0.3",
        ],
        8,
    ),
)
def test_detect_on_the_log_says_what_the_run_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], more: str
) -> None:
    seen, found, ran = both(tmp_path, capsys, *DECEIVED, *more.split())
    assert found["state"] == seen["state"]
    assert found["first_alarm_s"] == seen["first_alarm_s"]
    assert found["frequency_hz"] == seen["frequency_hz"]
    assert found["amplitude_rad"] == seen["amplitude_rad"]
    if ran["stop_reason"] == "trip:oscillation":
        last_s = (found["samples"] - 1) * found["period_s"]
        assert seen["first_alarm_s"] == pytest.approx(last_s), "the log holds the alarm's own row"


def test_the_growth_of_a_log_is_that_of_its_csv(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of the envelope in both."""
    _, found, _ = both(tmp_path, capsys, *DECEIVED, "safety.on_oscillation=report")
    runner, path = CliRunner(), tmp_path / "a.csv"
    log = ["log", str(tmp_path / "a.hwlog"), "--csv", str(path)]
    runner.invoke(haptic_wall, log, catch_exceptions=False)
    done = runner.invoke(command, [str(path), "--json"], catch_exceptions=False)
    assert found["growth_per_s"] == pytest.approx(json.loads(done.stdout)["growth_per_s"], rel=0.02)


def test_a_hand_on_a_stable_wall_is_as_quiet_in_the_log(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    seen, found, _ = both(tmp_path, capsys, "loop.clock=simulated")
    assert found["state"] == seen["state"] == "quiet"
    assert found["frequency_hz"] is found["amplitude_rad"] is found["growth_per_s"] is None


def test_with_other_values_it_is_judged_by_those(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _, found, _ = both(tmp_path, capsys, *DECEIVED, "safety.on_oscillation=report")
    log = str(tmp_path / "a.hwlog")
    done = CliRunner().invoke(command, [log, "--inertia", "0.1", "--json"], catch_exceptions=False)
    judged = json.loads(done.stdout)
    assert judged["known"]["inertia"] == pytest.approx(0.1)
    assert judged["first_alarm_s"] != found["first_alarm_s"]
