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
from tests.cli.caller import Cli

pytestmark = pytest.mark.usefixtures("undrawn")

QUICK = ("--set", "loop.clock=simulated")


@pytest.mark.whole
def test_delay_reports_value_and_error_and_leaves_its_files(cli: Cli, tmp_path: Path) -> None:
    out = tmp_path / "new"
    status, said, err = cli(
        "delay", "simulated", *QUICK, "--set", "servo.delay=0.0012",
        "--out", out, "--json",
    )  # fmt: skip
    assert status == 0
    report = json.loads(said)
    assert report["value"] == pytest.approx(0.0012, abs=4 * report["stderr"])
    assert json.loads((out / "delay.json").read_text()) == report
    assert (out / "delay.hwlog").exists()
    assert "motions of about" in err


def test_an_interrupt_ends_with_130_and_no_traceback(
    cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object) -> NoReturn:
        raise ExperimentInterruptedError(
            "interrupted", advice="steps.hwlog holds the recorded rows"
        )

    monkeypatch.setattr(Testbed, "play", interrupted)
    status, said, err = cli("delay", "simulated", *QUICK, "--out", tmp_path)
    assert (status, said) == (130, "")
    assert "interrupted; steps.hwlog holds the recorded rows" in err


@pytest.mark.parametrize(
    ("command", "more"),
    [
        ("delay", ()),
        ("sweep", ("--virtual-damping=0.02,0.04", "--delay-steps=0")),
    ],
)
def test_a_servo_that_is_lost_on_the_way_ends_with_4(
    command: str, more: tuple[str, ...], cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def lost(*_: object) -> NoReturn:
        raise ExperimentTrippedError(
            Trip.SERVO_LOST, "the port is gone", Problem("3 rows are missing")
        )

    monkeypatch.setattr(Testbed, "play", lost)
    status, _, err = cli(command, "simulated", *QUICK, "--out", tmp_path, *more)
    assert status == 4
    assert "trip:servo_lost: the port is gone" in err


def test_hardware_without_a_torque_limit_is_not_moved(cli: Cli, tmp_path: Path) -> None:
    config = tmp_path / "bed.yaml"
    config.write_text(
        "servo: {backend: dynamixel, port: /dev/none, baud: 4000000, model: XM430-W350}\n"
        "model: {inertia: 0.012, damping: 0.01, coulomb: 0.09, delay: 0.001, torque_gain: 1}\n"
    )
    assert "servo.torque_limit: found none" in cli.refused("delay", config, "--out", tmp_path)
