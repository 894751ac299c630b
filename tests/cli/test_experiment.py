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
from haptic_wall.controller.settings.load import Loaded, load_config
from tests.support.program import Cli
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


def test_the_law_of_an_axis_is_changed_for_that_axis(cli: Cli) -> None:
    words = ["sweep", "emulated-arm", "--axis", "elbow", "--virtual-damping=0", "--delay-steps=0"]
    advice = "--set axes.elbow.wall.law=wall"
    assert f"give {advice};" in cli.refused(*words)
    config = load_config("emulated-arm", [advice.split()[1]]).config
    assert config.each["elbow"].wall.law == "wall"
