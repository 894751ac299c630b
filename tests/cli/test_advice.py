"""Advice fits the command that is asked."""

from pathlib import Path

import pytest

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


def test_short_version_and_help(cli: Cli) -> None:
    assert cli("-V").out.startswith("haptic-wall, version ")
    assert "Commands:" in cli("-h").out
    assert cli("run", "-h").out.startswith("Usage: haptic-wall run ")
