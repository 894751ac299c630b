"""``presets`` and ``config`` answer what can be set, in what unit, and what is in force."""

import json
import os
from pathlib import Path
from types import ModuleType

import pytest
from click.testing import CliRunner

from haptic_wall.controller.cli import config, presets
from haptic_wall.controller.cli.main import main
from haptic_wall.controller.settings.fields import fields
from haptic_wall.controller.settings.load import load_config, preset_names


def answer(module: ModuleType, *arguments: str) -> str:
    result = CliRunner().invoke(module.command, arguments, catch_exceptions=False)
    assert result.exit_code == 0
    return result.stdout


def test_presets_are_listed_one_a_line() -> None:
    lines = answer(presets).splitlines()
    assert [line.split()[0] for line in lines] == preset_names()
    assert all(len(line.split()) > 5 for line in lines)


def test_presets_as_json() -> None:
    listed = json.loads(answer(presets, "--json"))["presets"]
    assert [preset["name"] for preset in listed] == preset_names()


@pytest.mark.parametrize("name", preset_names())
def test_config_as_json_holds_every_field_and_its_effective_value(name: str) -> None:
    listed = json.loads(answer(config, name, "--json"))
    effective = load_config(name).config
    assert listed["servo"] == effective.servo.kind
    assert list(listed["fields"]) == list(fields())
    assert listed["fields"]["wall.stiffness"]["value"] == effective.wall.stiffness
    assert listed["fields"]["wall.stiffness"]["unit"] == "N·m/rad"


def test_config_says_where_a_value_comes_from() -> None:
    listed = json.loads(answer(config, "simulated", "--json", "--set", "wall.damping=0.5"))
    origin = {path: field["from"] for path, field in listed["fields"].items()}
    assert origin["wall.damping"] == "--set"
    assert origin["wall.stiffness"] == "preset simulated"
    assert origin["guard.margin"] == "default"


def test_config_as_text_names_value_unit_range_and_meaning() -> None:
    text = " ".join(answer(config, "simulated").split())
    assert "wall.stiffness 8 N·m/rad preset simulated Requested stiffness K," in text
    assert "(a number above 0 and below 1)" in text
    assert all(path in text for path in fields())


def test_config_shows_bounds_of_the_belief_and_marks_what_is_not_used() -> None:
    lines = answer(config, "xm430-w350").splitlines()
    (inertia,) = [line for line in lines if "  model.inertia" in line]
    assert "0.011951 (0.007967 to 0.017927)" in inertia
    unused = [line[2:].split()[0] for line in lines if line.startswith("- ")]
    assert unused == [each.path for each in fields().values() if "hardware" not in each.used_by]
    assert {"servo.inertia", "servo.hand"} < set(unused)


@pytest.mark.parametrize("command", ["run", "config", "doctor", "identify", "delay"])
def test_a_configuration_that_is_a_pipe_is_refused_at_once(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    command: str,
) -> None:
    """Else every command waits for whoever writes to it."""
    monkeypatch.chdir(tmp_path)
    os.mkfifo("a.yaml")
    assert main([command, "a.yaml"]) == 2
    assert "CONFIG a.yaml: cannot be read: it is a pipe, not a file" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["a.yaml"]
