"""Before a real servo moves by itself, a person at a terminal is asked."""

import sys
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import NoReturn

import click
import pytest
from click.testing import CliRunner

from haptic_wall.controller.cli import experiment
from haptic_wall.controller.cli.main import main
from haptic_wall.controller.settings.load import Loaded, load_config
from tests.typed import not_none

REAL, EMULATED = load_config("xm430-w350"), load_config("emulated-ideal")


def ask(loaded: Loaded, *, yes: bool) -> None:
    experiment.Asked(loaded, None, None, yes).may_move()


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What was asked; the answer is no."""
    questions: list[str] = []

    def confirm(question: str, **_options: object) -> NoReturn:
        questions.append(question)
        raise click.Abort

    monkeypatch.setattr(click, "confirm", confirm)
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(isatty=lambda: True))
    return questions


def test_who_sits_before_a_real_servo_is_asked(asked: list[str]) -> None:
    with pytest.raises(click.Abort):
        ask(REAL, yes=False)
    assert len(asked) == 1 and not_none(REAL.config.servo.port) in asked[0]


def test_nobody_else_is(asked: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    ask(REAL, yes=True)
    ask(EMULATED, yes=False)
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(isatty=lambda: False))
    ask(REAL, yes=False)
    assert not asked


@pytest.mark.parametrize("command", ["delay", "identify", "sweep"])
def test_every_experiment_that_moves_asks_before_it_opens_the_port(
    command: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def stop(asked: experiment.Asked) -> NoReturn:
        assert asked.config.servo.kind == "hardware" and not asked.yes
        raise click.Abort

    monkeypatch.setattr(experiment.Asked, "may_move", stop)
    monkeypatch.chdir(tmp_path)
    options = ["--virtual-damping=0.02", "--delay-steps=0"] if command == "sweep" else []
    module = import_module(f"haptic_wall.controller.cli.{command}")
    result = CliRunner().invoke(module.command, ["xm430-w350", *options])
    assert result.exit_code == 1 and isinstance(result.exception, SystemExit)


@pytest.mark.parametrize("command", ["map", "sweep", "commission", "zwidth", "acceptance"])
def test_what_measures_walls_refuses_another_law(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [command, "simulated", "--set", "wall.law=spring", "--out", str(tmp_path / "out")]
    if command == "sweep":
        words += ["--virtual-damping=0", "--delay-steps=0"]
    assert main(words) == 2
    said = capsys.readouterr().err
    assert "found spring, wanted wall: only walls" in said
    assert "give --set wall.law=wall;" in said
    assert not (tmp_path / "out").exists()


def test_the_law_of_an_axis_is_changed_for_that_axis(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["sweep", "emulated-arm", "--axis", "elbow", "--virtual-damping=0", "--delay-steps=0"]
    assert main(words) == 2
    advice = "--set axes.elbow.wall.law=wall"
    assert f"give {advice};" in capsys.readouterr().err
    config = load_config("emulated-arm", [advice.split()[1]]).config
    assert config.each["elbow"].wall.law == "wall"
