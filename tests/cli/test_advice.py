"""Advice fits the command that is asked, and completion knows what can be set."""

from pathlib import Path

import click
import pytest

from haptic_wall.controller.cli import main as program
from haptic_wall.controller.settings.fields import fields
from tests.cli.caller import Cli


@pytest.mark.parametrize(
    ("arguments", "advice"),
    [
        (["run", "--stiffness", "20"], "a setting is changed with --set PATH=VALUE"),
        (["boundary", "--inertai", "1"], "did you mean --inertia or --load-inertia?"),
        (["log", "x", "--stiffness", "20"], "`haptic-wall log --help` lists options and arguments"),
        (
            ["emulate", "--stiffness", "20"],
            "`haptic-wall emulate --help` lists options and arguments",
        ),
        (["delay", "--delay-steps", "x"], "wanted a whole number from 0"),
        (["map", "--delay-steps", "0,-1"], "wanted a whole number from 0"),
        (["sweep", "simulated", "--delay-steps=0.5"], "wanted a whole number from 0"),
        (["scan", "--port", "/dev/null"], "no serial port, wanted the adapter's device"),
        (["run", "--log", "-"], "--log -: found standard output, wanted a file"),
    ],
)
def test_advice_fits_the_command(
    cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], advice: str
) -> None:
    monkeypatch.chdir(tmp_path)
    message = cli.refused(*arguments)
    assert advice in message
    assert message.startswith("haptic-wall: ")


@pytest.mark.parametrize(("command", "expected"), [("run", set(fields())), ("emulate", None)])
def test_completion_knows_the_paths_of_set(command: str, expected: set[str] | None) -> None:
    context = click.Context(program.haptic_wall, info_name="haptic-wall")
    found = program.haptic_wall.get_command(context, command)
    (option,) = [each for each in found.params if each.name == "sets"]
    every = {item.value.rstrip("=") for item in option.shell_complete(context, "")}
    assert expected is None or every == expected
    some = {item.value for item in option.shell_complete(context, "servo.in")}
    assert some == {"servo.inertia="}


def test_completion_knows_the_presets() -> None:
    context = click.Context(program.haptic_wall, info_name="haptic-wall")
    (config,) = [
        p for p in program.haptic_wall.get_command(context, "run").params if p.name == "config"
    ]
    found = config.shell_complete(context, "emulated-p")
    assert [item.value for item in found if item.type == "plain"] == ["emulated-port"]
    assert [item.type for item in found if item.type != "plain"] == ["file"]


def test_short_version_and_help(cli: Cli) -> None:
    assert cli("-V").out.startswith("haptic-wall, version ")
    assert "Commands:" in cli("-h").out
    assert cli("run", "-h").out.startswith("Usage: haptic-wall run ")
