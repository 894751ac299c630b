"""With ``--json`` an error is one object too, of one style for every command."""

import json
from pathlib import Path
from typing import Any, NoReturn

import pytest

from haptic_wall.controller.experiments.testbed import ExperimentTrippedError
from haptic_wall.controller.runtime.safety import Trip
from tests.cli.caller import Cli

ROOT = Path(__file__).parents[2]


def failed(cli: Cli, *arguments: str) -> dict[str, Any]:
    """The object on standard output, of what is said on standard error."""
    status, out, err = cli(*arguments, "--json")
    found: dict[str, Any] = json.loads(out)
    assert set(found) == {"error", "field", "advice", "exit_status"}
    assert found["exit_status"] == status
    assert f"haptic-wall: {found['error'].splitlines()[0]}" in err
    return found


@pytest.mark.parametrize(
    ("arguments", "field", "advice", "status"),
    [
        (["run", "--duration=5s"], "--duration", "such as 2.5, or inf", 2),
        (["run", "--set=wall.stifness=3"], "wall.stifness", "did you mean wall.stiffness?", 2),
        (["config", "simulatd"], "CONFIG", "xl330-m288, xm430-w350", 2),
        (["run", "--plot=a.svg"], "--plot", "wanted one ending in .png: pictures are PNG", 2),
        (["log"], "LOG", "lists options and arguments", 2),
        (["log", "nowhere"], "LOG", "wanted a log of run", 2),
        (["boundary"], "--inertia", "give it, or a CONFIG", 2),
        (["scan", "--port="], "--port", "wanted a serial device such as /dev/ttyUSB0", 2),
        (
            ["presets", "--nosuch"],
            "--nosuch",
            "`haptic-wall presets --help` lists options and arguments",
            2,
        ),
        (
            ["run", "--stiffness=2"],
            "--stiffness",
            "a setting is changed with --set PATH=VALUE; did you mean --witness?",
            2,
        ),
        (["boundary", "--inertai=1"], "--inertai", "did you mean --inertia or --load-inertia?", 2),
        (["boundary", "--rate=3"], "--rate", "--help` lists options and arguments", 2),
        (["delay"], "CONFIG", "`haptic-wall delay --help` lists options and arguments", 2),
        (["zwidth"], "CONFIG", "`haptic-wall zwidth --help` lists options and arguments", 2),
        (["map", "--delay-steps=-1"], "--delay-steps", "a whole number from 0, up to 1000", 2),
        (["sweep", "--delay-steps=.5"], "--delay-steps", "a whole number from 0, up to 1000", 2),
        (["map", "x", "--workers=x"], "--workers", "found x, wanted a whole number from 1", 2),
        (["scan", "--port=/dev/null"], "--port", "the adapter's device, such as /dev/ttyUSB0", 2),
        (["run", "--log=-"], "--log", "wanted a file's name", 2),
        (["rnu"], None, "did you mean run?", 2),
        (
            ["run", "xm430-w350", "--set=servo.port=/dev/ttyNONE", "--log=a", "--plot=b"],
            None,
            "--link /dev/ttyNONE`).",
            4,
        ),
    ],
)
def test_an_error_is_an_object(
    cli: Cli,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    field: str | None,
    advice: str,
    status: int,
) -> None:
    monkeypatch.chdir(tmp_path)
    found = failed(cli, *arguments)
    assert (found["field"], found["exit_status"]) == (field, status)
    assert (found["advice"] or found["error"]).endswith(advice)
    assert not list(tmp_path.iterdir())


def test_a_trip_that_ends_an_experiment_is_one_too(
    cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def tripped(*_: object, **_named: object) -> NoReturn:
        raise ExperimentTrippedError(Trip.OVERSPEED, "too fast")

    monkeypatch.setattr("haptic_wall.controller.experiments.delay.measure_delay", tripped)
    found = failed(cli, "delay", "simulated", f"--out={tmp_path}")
    assert found["error"].startswith("trip:overspeed: ")
    assert found["exit_status"] == 3


def test_without_json_nothing_is_on_standard_output(cli: Cli) -> None:
    cli.refused("run", "--duration=-1")
